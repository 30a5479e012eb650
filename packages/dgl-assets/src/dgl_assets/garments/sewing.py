"""Sew flat panels together into one surface.

Sewing is by identity: a seam is one row of vertices, and every panel that names it uses those very
vertices. Seams meet at junctions, which are single vertices. A seam of a front and a back panel
closes the garment; a seam of one panel stays an open edge.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dgl_assets.garments.meshing import mesh_outline, resample_polyline


@dataclass(frozen=True, kw_only=True)
class Curve:
    """A seam line as it is drawn, before it is divided into edges."""

    start: str
    """Name of the first junction."""
    end: str
    """Name of the last junction."""
    points: np.ndarray
    """Dense polyline [m], shape (N, 2), pattern frame."""
    is_even: bool = False
    """Divide into an even number of edges, so that a vertex lies at its middle."""


@dataclass(frozen=True, kw_only=True)
class Seam:
    """A row of vertices on the edge of one or more panels."""

    start: str
    """Name of the first junction."""
    end: str
    """Name of the last junction."""
    points: np.ndarray
    """Positions [m], shape (N, 2), N >= 2, both junctions included, pattern frame."""


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A flat piece of cloth."""

    name: str
    """Unique name."""
    layer: int
    """+1 front (upper), -1 back (lower), +2 a flap: folded onto the front layer, face down."""
    edges: tuple[str, ...]
    """Seam names counter-clockwise seen from above; a leading "-" walks the seam backwards."""
    pins: dict[str, np.ndarray]
    """Named points inside that become vertices [m], each of shape (2,), pattern frame."""


@dataclass(frozen=True, kw_only=True)
class SewnSurface:
    """The result of sewing."""

    flat: np.ndarray
    """Vertex positions [m], shape (V, 2), float64, pattern frame."""
    faces: np.ndarray
    """Triangles, shape (F, 3), int32, normals outward: counter-clockwise from above on the front
    layer, clockwise on the back layer and on flaps."""
    layers: np.ndarray
    """+1 front or flap, -1 back, 0 shared by front and back, per vertex, shape (V,), int8."""
    face_panels: np.ndarray
    """Index into `panels` per face, shape (F,), int8."""
    panels: tuple[str, ...]
    """Panel names."""
    junctions: dict[str, int]
    """Vertex id of each junction."""
    seams: dict[str, np.ndarray]
    """Vertex ids along each seam, junctions included, int32."""
    pins: dict[str, int]
    """Vertex id of each pin."""


def divide_curves(curves: dict[str, Curve], *, spacing: float) -> dict[str, Seam]:
    """Divide curves into edges of about `spacing` [m]."""
    seams = {}
    for name, curve in curves.items():
        length = np.linalg.norm(np.diff(curve.points, axis=0), axis=1).sum()
        count = max(1, round(length / spacing))
        if curve.is_even:
            count = max(2, 2 * round(length / spacing / 2))
        points = resample_polyline(curve.points, count)
        seams[name] = Seam(start=curve.start, end=curve.end, points=points)
    return seams


def trace_outline(curves: dict[str, Curve], panel: Panel) -> np.ndarray:
    """Join the curves around a panel, counter-clockwise [m], shape (N, 2)."""
    steps = ((edge.removeprefix("-"), -1 if edge.startswith("-") else 1) for edge in panel.edges)
    return np.concatenate([curves[name].points[::step] for name, step in steps])


def measure_area(curves: dict[str, Curve], panels: tuple[Panel, ...]) -> float:
    """Compute the area of all panels together [m^2]."""
    total = 0.0
    for panel in panels:
        x, y = trace_outline(curves, panel).T
        total += float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2
    return total


def sew_panels(seams: dict[str, Seam], panels: tuple[Panel, ...], *, spacing: float) -> SewnSurface:
    """Mesh every panel and join them along their common seams.

    Args:
        seams: Seams by name.
        panels: Panels whose edges name those seams.
        spacing: Target edge length [m].

    Returns:
        The sewn surface.

    Raises:
        ValueError: If a panel names an unknown seam, or its edges do not close.
        MeshingError: If a panel cannot be filled.
    """
    junctions: dict[str, int] = {}
    positions: list[np.ndarray] = []
    seam_ids: dict[str, np.ndarray] = {}
    count = 0
    for name, seam in seams.items():
        ends = []
        for junction, point in ((seam.start, seam.points[0]), (seam.end, seam.points[-1])):
            if junction not in junctions:
                junctions[junction] = count
                positions.append(point[None])
                count += 1
            ends.append(junctions[junction])
        inner = np.arange(count, count + len(seam.points) - 2)
        positions.append(seam.points[1:-1])
        count += len(inner)
        seam_ids[name] = np.concatenate([[ends[0]], inner, [ends[1]]]).astype(np.int32)

    faces, face_panels, pins = [], [], {}
    touched = [set(), set()]  # vertex ids of the front and of the back layer
    for index, panel in enumerate(panels):
        outline_ids = _walk_edges(panel, seam_ids)
        outline = np.concatenate(positions)[outline_ids]
        pin_points = np.array(list(panel.pins.values())).reshape(-1, 2)
        points, triangles = mesh_outline(outline, spacing=spacing, pins=pin_points)
        inner = np.arange(count, count + len(points) - len(outline))
        count += len(inner)
        positions.append(points[len(outline) :])
        ids = np.concatenate([outline_ids, inner])
        pins.update(zip(panel.pins, inner[: len(panel.pins)].tolist(), strict=True))
        faces.append(ids[triangles if panel.layer == 1 else triangles[:, ::-1]])
        face_panels.append(np.full(len(triangles), index))
        touched[panel.layer < 0].update(ids.tolist())

    layers = np.zeros(count, dtype=np.int8)
    layers[sorted(touched[0])] += 1
    layers[sorted(touched[1])] -= 1
    return SewnSurface(
        flat=np.concatenate(positions),
        faces=np.concatenate(faces).astype(np.int32),
        layers=layers,
        face_panels=np.concatenate(face_panels).astype(np.int8),
        panels=tuple(panel.name for panel in panels),
        junctions=junctions,
        seams=seam_ids,
        pins=pins,
    )


def _walk_edges(panel: Panel, seam_ids: dict[str, np.ndarray]) -> np.ndarray:
    """Vertex ids around a panel, each once."""
    runs = []
    for edge in panel.edges:
        name = edge.removeprefix("-")
        if name not in seam_ids:
            raise ValueError(
                f"panel {panel.name} names seam {name}; expected one of {sorted(seam_ids)}"
            )
        runs.append(seam_ids[name][::-1] if edge.startswith("-") else seam_ids[name])
    for run, following in zip(runs, runs[1:] + runs[:1], strict=True):
        if run[-1] != following[0]:
            raise ValueError(f"edges of panel {panel.name} must join end to end; got {panel.edges}")
    return np.concatenate([run[:-1] for run in runs])
