"""Report of an import."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing.topology import compute_edge_table

EVEN_EDGES = (8 / 13, 18 / 13)
"""Shortest and longest edge that count as even, over the spacing: 8 and 18 mm at 13 mm."""
EVEN_ANGLE = 20.0
"""Smallest angle of an even triangle [degrees]."""


@dataclass(frozen=True, kw_only=True)
class ImportReport:
    """Folder and facts of an imported asset, and assumptions of the import."""

    folder: Path
    """`<out>/<category>/<name>`."""
    name: str
    category: str
    subtype: str
    source: str
    """Origin."""
    source_id: str
    """Name of its file at the origin."""
    licence: str
    unit: float
    """Length of a unit of the file [m]."""
    scale: float
    """Factor from the file's units to the asset, unit and reduction together [m]."""
    up: str
    """Up axis of the file."""
    vertex_count: int
    face_count: int
    area: float
    """Of the unstrained cloth, all layers [m^2]."""
    extent: tuple[float, float, float]
    """Of the bounding box [m]."""
    openings: int
    even_edges: float
    """Share of edges between 8 and 18 mm, at other spacings in proportion."""
    even_angles: float
    """Share of triangles without an angle below 20 degrees."""
    landmarks: tuple[str, ...]
    has_texture: bool
    is_laid_flat: bool
    """A simulation has laid it flat."""
    assumptions: tuple[str, ...]
    """Findings, assumptions, repairs and parts left out, in order."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "folder": str(self.folder)}


def measure_evenness(
    vertices: np.ndarray, faces: np.ndarray, *, spacing: float
) -> tuple[float, float]:
    """Measure how even a mesh is.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Triangles, shape (F, 3), int.
        spacing: Target edge length [m].

    Returns:
        Share of edges within `EVEN_EDGES`, and of triangles with no angle below `EVEN_ANGLE`.
    """
    pairs = compute_edge_table(faces).pairs
    lengths = np.linalg.norm(vertices[pairs[:, 0]] - vertices[pairs[:, 1]], axis=1) / spacing
    corners = vertices[faces]
    sides = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
    a, b, c = np.sort(sides, axis=1).T  # the smallest angle is opposite to a
    cosine = (b**2 + c**2 - a**2) / np.maximum(2 * b * c, 1e-300)
    angles = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    is_even = (lengths >= EVEN_EDGES[0]) & (lengths <= EVEN_EDGES[1])
    return float(is_even.mean()), float((angles >= EVEN_ANGLE).mean())
