"""Make baseball caps: a crown of five or six panels and a visor.

Landmarks are exact correspondences: `brim` (the grasp point, on the visor near the crown),
`brim_tip`, `left_brim`, `right_brim` (on the visor), `left_visor_end`, `right_visor_end` (on the
crown's edge), `crown_top` (the button), `front`, `back`, `left`, `right` on the edge of the crown,
and in the middle of the panels `left_front_panel`, `right_front_panel`, `left_side_panel`,
`right_side_panel`, `left_back_panel`, `right_back_panel`.
"""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from dgl_assets.garments.garment import Garment
from dgl_assets.garments.hats.cap_parameters import CapParameters
from dgl_assets.garments.hats.oval import compute_oval
from dgl_assets.garments.hats.visor import PHI_END, Visor
from dgl_assets.garments.shell_meshing import DiskMesh, DiskSurface, mesh_disk

CATEGORY = "Baseball_Cap"
SPACING = 0.0114
"""Default edge length [m]; the reason is in the README."""

_MERIDIANS = 180
_SEAMS = {
    6: (0.0, np.pi / 3, 2 * np.pi / 3, np.pi, -2 * np.pi / 3, -np.pi / 3),
    5: (np.pi / 3, 2 * np.pi / 3, np.pi, -2 * np.pi / 3, -np.pi / 3),
}
_PANELS = {
    6: ("right_front", "right_side", "right_back", "left_back", "left_side", "left_front", "visor"),
    5: ("front", "right_side", "right_back", "left_back", "left_side", "visor"),
}
_SIDES = {"front": 0.0, "right": np.pi / 2, "back": np.pi, "left": -np.pi / 2}
_PANEL_MIDDLES = {
    f"{hand}_{part}_panel": (0.62, sign * angle)
    for part, angle in (("front", np.pi / 6), ("side", np.pi / 2), ("back", 5 * np.pi / 6))
    for hand, sign in (("left", -1), ("right", 1))
}
_VISOR_PINS = {"brim": (0.0, 0.30), "left_brim": (-0.5, 0.55), "right_brim": (0.5, 0.55)}
"""Points of the visor: share of its half width, share of the way to its edge."""


def make_cap(parameters: CapParameters, *, spacing: float, name: str) -> Garment:
    """Make a baseball cap.

    Args:
        parameters: Measures.
        spacing: Target edge length [m].
        name: Name of the garment.

    Returns:
        An elastic shell: one surface whose one boundary is the edge of the crown behind and of the
        visor in front. Canonical coordinates are (c sin a, -c cos a, 1) with the angle a around the
        crown, 0 at the front and 4/9 pi at the ends of the visor, and c: 0 at the button, 1 at the
        edge of the crown, 1.9 at the tip of the visor.

    Raises:
        MeshingError: If it cannot be filled at this spacing.
    """
    p = parameters
    surface = _make_crown(p)
    seams = _SEAMS[p.panel_count]
    marks = (*_SIDES.values(), p.visor_half_angle, -p.visor_half_angle)
    pins = tuple(_PANEL_MIDDLES.values())
    mesh = mesh_disk(surface, spacing=spacing, marks=marks, seams=seams, pins=pins)
    crown = surface.evaluate(mesh.rows, mesh.angles)
    inner = _cut_inner_edge(mesh, p)
    crown_angles = _warp_angle(mesh.angles, p.visor_half_angle)
    visor = Visor(p, crown[inner], crown_angles[inner])
    flat = visor.make_mesh(spacing=0.96 * spacing, pins=tuple(_VISOR_PINS.values()))
    own = flat.points[len(inner) :]  # the first are vertices of the crown's edge
    ids = np.concatenate([inner, len(crown) + np.arange(len(own))])
    vertices = np.concatenate([crown, visor.lift(own)])
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = (vertices - [*(low + high)[:2] / 2, low[2]]).astype(np.float32)

    polar = np.column_stack([mesh.rows, crown_angles])
    polar = np.concatenate([polar, visor.to_polar(own)])
    landmarks = _collect_landmarks(mesh, inner)
    landmarks |= {name: int(ids[k]) for name, k in zip(_VISOR_PINS, flat.pins, strict=True)}
    landmarks["brim_tip"] = int(ids[flat.tip])
    return Garment(
        name=name,
        category=CATEGORY,
        vertices=vertices,
        faces=np.concatenate([mesh.faces, ids[flat.faces]]).astype(np.int32),
        rest_vertices=vertices,
        canonical=_to_canonical(polar),
        face_panels=_choose_panels(mesh, p, visor_count=len(flat.faces)),
        panels=_PANELS[p.panel_count],
        landmarks=landmarks,
        parameters={key: float(value) for key, value in asdict(p).items()},
        wall_thickness=p.wall_thickness,
    )


def _make_crown(p: CapParameters) -> DiskSurface:
    angles = np.arange(_MERIDIANS) * (2 * np.pi / _MERIDIANS)
    oval = compute_oval(p.head_girth, p.head_ratio, angles)
    frontness = ((1 + np.cos(angles)) / 2) ** 1.5
    exponent = p.back_exponent + (p.front_exponent - p.back_exponent) * frontness  # (J,)
    turn = np.linspace(0, np.pi / 2, 400)[:, None]
    inward = np.sin(turn) ** (2 / exponent)  # (M, J)
    height = np.cos(turn) ** (2 / exponent)
    flat = _compute_flat_panels(angles, p.panel_count)
    radius = inward * oval * (1 - p.gore_flatness * (1 - inward**4) * (1 - flat))
    x = radius * np.sin(angles)
    y = -radius * np.cos(angles) - p.top_shift * height
    edge = _compute_edge_height(oval * np.sin(angles), angles, p)
    return DiskSurface([np.stack([x, y, edge + (p.crown_height - edge) * height], axis=2)])


def _compute_flat_panels(angles: np.ndarray, panel_count: int) -> np.ndarray:
    """Distance of flat panels from the axis, relative to their seams, shape (J,)."""
    seams = np.sort(np.mod(_SEAMS[panel_count], 2 * np.pi))
    following = np.concatenate([seams[1:], [seams[0] + 2 * np.pi]])
    turn = np.where(angles < seams[0], angles + 2 * np.pi, angles)
    k = np.searchsorted(seams, turn, side="right") - 1
    half = (following[k] - seams[k]) / 2
    flat = np.cos(half) / np.cos(turn - seams[k] - half)
    return np.maximum(flat, 0.87)  # a wide front panel is not flat across


def _compute_edge_height(x: np.ndarray, angles: np.ndarray, p: CapParameters) -> np.ndarray:
    """Height of the crown's edge [m], shape (J,): a parabola across where the visor is sewn on."""
    turn = np.abs((angles + np.pi) % (2 * np.pi) - np.pi)
    end = compute_oval(p.head_girth, p.head_ratio, np.array([p.visor_half_angle]))
    end = end * np.sin(p.visor_half_angle)
    return np.where(turn < p.visor_half_angle, p.front_rise * (1 - (x / end) ** 2), 0.0)


def _cut_inner_edge(mesh: DiskMesh, p: CapParameters) -> np.ndarray:
    """Ids of the crown's edge that the visor is sewn to, left (-x) to right."""
    angles = mesh.angles[mesh.rim]
    on_visor = mesh.rim[np.abs(angles) < p.visor_half_angle + 1e-6]
    return on_visor[np.argsort(mesh.angles[on_visor])]


def _warp_angle(angles: np.ndarray, visor_half_angle: float) -> np.ndarray:
    """Canonical angle: seams and sides stay, the ends of the visor come to `PHI_END`."""
    own = [0.0, np.pi / 3, visor_half_angle, np.pi / 2, np.pi]
    canonical = [0.0, np.pi / 3, PHI_END, np.pi / 2, np.pi]
    return np.sign(angles) * np.interp(np.abs(angles), own, canonical)


def _to_canonical(polar: np.ndarray) -> np.ndarray:
    c, a = polar.T
    return np.column_stack([c * np.sin(a), -c * np.cos(a), np.ones(len(c))]).astype(np.float32)


def _choose_panels(mesh: DiskMesh, p: CapParameters, *, visor_count: int) -> np.ndarray:
    """Panel of each face, shape (F,), int8."""
    flat = np.column_stack([mesh.rows * np.sin(mesh.angles), -mesh.rows * np.cos(mesh.angles)])
    x, y = flat[mesh.faces].mean(axis=1).T
    sector = (np.arctan2(x, -y) // (np.pi / 3) % 6).astype(np.int8)
    if p.panel_count == 5:  # the first and last sectors are the wide front
        sector = np.where(sector == 5, 0, sector).astype(np.int8)
    return np.concatenate([sector, np.full(visor_count, p.panel_count, dtype=np.int8)])


def _collect_landmarks(mesh: DiskMesh, inner: np.ndarray) -> dict[str, int]:
    landmarks = {"crown_top": 0, "left_visor_end": int(inner[0]), "right_visor_end": int(inner[-1])}
    landmarks |= dict(zip(_PANEL_MIDDLES, mesh.pins, strict=True))
    for side, angle in _SIDES.items():
        turn = np.abs((mesh.angles[mesh.rim] - angle + np.pi) % (2 * np.pi) - np.pi)
        landmarks[side] = int(mesh.rim[np.argmin(turn)])
    return landmarks
