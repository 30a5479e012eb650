"""Make bowl hats: bucket, bowler, cloche, boater, sun hat.

Landmarks are exact correspondences: `crown_top`; `left`, `right`, `front`, `back` on the brim's
edge, and the same after `crown_` at the seam of brim and crown; `left_brim`, `right_brim`,
`front_brim`, `back_brim` in the middle of the brim; `left_wall`, `right_wall`, `front_wall`,
`back_wall` half way up the crown.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from dgl_assets.garments.garment import Garment
from dgl_assets.garments.hats.bowl_parameters import BowlHatParameters
from dgl_assets.garments.hats.oval import compute_oval
from dgl_assets.garments.shell_meshing import DiskSurface, mesh_disk

CATEGORY = "Bowl_Hat"
SPACING = 0.0104
"""Default edge length [m]; the reason is in the README."""

_PANELS = ("crown", "brim")
_MERIDIANS = 180
_SIDES = {"front": 0.0, "right": np.pi / 2, "back": np.pi, "left": -np.pi / 2}
_PINS = {
    "crown_top": (0.0, 0.0),
    **{f"{side}_wall": (0.6, angle) for side, angle in _SIDES.items()},
    **{f"{side}_brim": (1.5, angle) for side, angle in _SIDES.items()},
}


def make_bowl_hat(parameters: BowlHatParameters, *, spacing: float, name: str) -> Garment:
    """Make a bowl hat.

    Args:
        parameters: Measures.
        spacing: Target edge length [m].
        name: Name of the garment.

    Returns:
        An elastic shell: one surface whose one boundary is the edge of the brim. Canonical
        coordinates are (c sin a, -c cos a, 1) with the angle a around the crown, 0 at the front,
        and c: 0 at the top of the crown, 1 at the seam of the brim, 2 at its edge.

    Raises:
        MeshingError: If it cannot be filled at this spacing.
    """
    surface = _make_surface(parameters)
    mesh = mesh_disk(
        surface,
        spacing=spacing,
        marks=tuple(_SIDES.values()),
        rings=(1.0,),
        pins=tuple(_PINS.values()),
    )
    vertices = surface.evaluate(mesh.rows, mesh.angles)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - [*(low + high)[:2] / 2, low[2]]).astype(np.float32)
    c, a = mesh.rows, mesh.angles
    canonical = np.column_stack([c * np.sin(a), -c * np.cos(a), np.ones(len(vertices))])
    landmarks = dict(zip(_PINS, mesh.pins, strict=True))
    for prefix, row in (("crown_", 1.0), ("", 2.0)):
        on_ring = np.flatnonzero(np.abs(mesh.rows - row) < 1e-9)
        for side, angle in _SIDES.items():
            turn = np.abs((mesh.angles[on_ring] - angle + np.pi) % (2 * np.pi) - np.pi)
            landmarks[f"{prefix}{side}"] = int(on_ring[np.argmin(turn)])
    return Garment(
        name=name,
        category=CATEGORY,
        vertices=vertices,
        faces=mesh.faces,
        rest_vertices=vertices,
        canonical=canonical.astype(np.float32),
        face_panels=(mesh.rows[mesh.faces].mean(axis=1) > 1).astype(np.int8),
        panels=_PANELS,
        landmarks=landmarks,
        parameters={key: float(value) for key, value in asdict(parameters).items()},
        wall_thickness=parameters.wall_thickness,
    )


def _make_surface(p: BowlHatParameters) -> DiskSurface:
    angles = np.arange(_MERIDIANS) * (2 * np.pi / _MERIDIANS)
    oval = compute_oval(p.head_girth, p.head_ratio, angles)
    outward = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=1)  # (J, 3)

    turn = np.linspace(0, np.pi / 2, 400)[:, None]
    inward = np.sin(turn) ** (2 / p.crown_exponent)  # share of the oval, 0 at the pole
    height = np.cos(turn) ** (2 / p.crown_exponent)
    radius = inward * (1 - p.crown_taper * height) * oval  # (M, J)
    crown = radius[..., None] * outward
    dent = np.exp(-((crown[..., 0] / 0.022) ** 2)) * np.clip(1 - inward**3, 0, None)
    crown[..., 2] = p.crown_height * height - p.top_dent * dent

    t = np.linspace(0, 1, 60)
    slope = p.brim_slope + p.brim_curve * t
    run = np.concatenate([[0.0], np.cumsum((np.cos(slope[1:]) + np.cos(slope[:-1])) / 2)])
    fall = np.concatenate([[0.0], np.cumsum((np.sin(slope[1:]) + np.sin(slope[:-1])) / 2)])
    step = p.brim_width / (len(t) - 1)
    brim = (oval + run[:, None] * step)[..., None] * outward
    bend = p.side_curl * np.sin(angles) ** 2 + p.wave_height * np.cos(3 * angles - p.wave_phase)
    brim[..., 2] = -fall[:, None] * step + (t**1.5)[:, None] * bend
    return DiskSurface([crown, brim])
