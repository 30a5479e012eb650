"""Small solids for pictures: turned profiles, lofted sections, rounded boxes; smooth normals."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from dgl_assets.robots._frames import AXIS_X, AXIS_Y, rotation_about, transform


@dataclass(frozen=True, kw_only=True)
class Solid:
    """A closed triangle mesh of one material."""

    material: str
    vertices: np.ndarray
    """Positions [m], shape (V, 3), link frame."""
    faces: np.ndarray
    """Vertex indices, shape (F, 3), counter-clockwise from outside."""

    def moved(self, T: np.ndarray) -> "Solid":
        """Apply a rigid transform (4, 4)."""
        vertices = self.vertices @ T[:3, :3].T + T[:3, 3]
        return Solid(material=self.material, vertices=vertices, faces=self.faces)

    def shifted(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        """Translate [m]."""
        return self.moved(transform((x, y, z)))

    def mirrored_x(self) -> "Solid":
        """Reflect in x, turning the faces so that they stay outward."""
        return Solid(
            material=self.material,
            vertices=self.vertices * np.array([-1.0, 1.0, 1.0]),
            faces=self.faces[:, ::-1],
        )


@dataclass(frozen=True, kw_only=True)
class Section:
    """A rounded rectangle across z: from an ellipse (`power` 2) towards a box (large `power`)."""

    z: float
    """Height [m]."""
    hx: float
    """Half width along x [m]."""
    hy: float
    """Half width along y [m]."""
    cx: float = 0.0
    """Centre x [m]."""
    cy: float = 0.0
    """Centre y [m]."""
    power: float = 2.0
    """Exponent of the superellipse."""


def turn(material: str, profile: Sequence[tuple[float, float]], segments: int = 16) -> Solid:
    """Turn a profile of (radius, z) [m] about z; it should start and end on the axis."""
    return loft(material, [Section(z=z, hx=r, hy=r) for r, z in profile], segments)


def loft(material: str, sections: Sequence[Section], segments: int = 20) -> Solid:
    """Join sections of rising z (or any simple order) and close both ends with flat caps."""
    angles = np.arange(segments) * 2 * np.pi / segments
    c, s = np.cos(angles), np.sin(angles)
    rings = []
    for sec in sections:
        e = 2.0 / sec.power
        x = sec.cx + sec.hx * np.sign(c) * np.abs(c) ** e
        y = sec.cy + sec.hy * np.sign(s) * np.abs(s) ** e
        rings.append(np.column_stack([x, y, np.full(segments, sec.z)]))
    ends = [np.array([[sec.cx, sec.cy, sec.z]]) for sec in (sections[0], sections[-1])]
    vertices = np.vstack([*rings, *ends])

    i = np.arange(segments)
    j = (i + 1) % segments
    faces = []
    for k in range(len(sections) - 1):
        a, b = k * segments, (k + 1) * segments
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    bottom, top = len(vertices) - 2, len(vertices) - 1
    last = (len(sections) - 1) * segments
    faces.append(np.column_stack([j, i, np.full(segments, bottom)]))
    faces.append(np.column_stack([last + i, last + j, np.full(segments, top)]))
    return _without_slivers(Solid(material=material, vertices=vertices, faces=np.vstack(faces)))


def cylinder(
    material: str,
    radius: float,
    low: float,
    high: float,
    *,
    bevel: float = 0.0,
    segments: int = 16,
) -> Solid:
    """Make a cylinder along z from `low` to `high` [m] with bevelled edges."""
    b = bevel
    profile = [(0.0, low), (radius - b, low), (radius, low + b), (radius, high - b)]
    return turn(material, [*profile, (radius - b, high), (0.0, high)], segments)


def rounded_box(
    material: str,
    half_size: tuple[float, float, float],
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    radius: float = 0.002,
    power: float = 7.0,
    segments: int = 12,
) -> Solid:
    """Make a box with rounded vertical edges and bevelled top and bottom."""
    hx, hy, hz = half_size
    x, y, z = centre
    inner = {"hx": hx - radius, "hy": hy - radius, "cx": x, "cy": y, "power": power}
    outer = {"hx": hx, "hy": hy, "cx": x, "cy": y, "power": power}
    return loft(
        material,
        [
            Section(z=z - hz, **inner),
            Section(z=z - hz + radius, **outer),
            Section(z=z + hz - radius, **outer),
            Section(z=z + hz, **inner),
        ],
        segments,
    )


def ball(material: str, radius: float, *, segments: int = 12) -> Solid:
    """Make a sphere about the origin."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, segments // 2 + 1)
    return turn(material, [(radius * np.cos(a), radius * np.sin(a)) for a in angles], segments)


def along_x(solid: Solid) -> Solid:
    """Turn a solid's z axis onto x."""
    return solid.moved(transform((0, 0, 0), rotation_about(AXIS_Y, np.pi / 2)))


def along_y(solid: Solid) -> Solid:
    """Turn a solid's z axis onto y."""
    return solid.moved(transform((0, 0, 0), rotation_about(AXIS_X, -np.pi / 2)))


def _without_slivers(solid: Solid) -> Solid:
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return Solid(material=solid.material, vertices=solid.vertices, faces=solid.faces[area > 1e-12])


def shade(solid: Solid, crease: float = np.radians(40)) -> tuple[np.ndarray, ...]:
    """Compute smooth normals that keep edges sharper than `crease` [rad].

    Returns:
        Vertices (W, 3), normals (W, 3) and faces (F, 3) with vertices split along creases.
    """
    faces = solid.faces
    # Rings may touch (a cone's tip): corners belong together when their positions agree.
    _, point = np.unique(np.round(solid.vertices, 7), axis=0, return_inverse=True)
    corner_point = point.ravel()[faces].ravel()
    a, b, c = (solid.vertices[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    unit = weighted / np.linalg.norm(weighted, axis=1, keepdims=True)
    corner_face = np.repeat(np.arange(len(faces)), 3)

    ones = np.ones(len(corner_point))
    incidence = sparse.csr_matrix((ones, (np.arange(len(corner_point)), corner_point)))
    pairs = (incidence @ incidence.T).tocoo()
    first, second = corner_face[pairs.row], corner_face[pairs.col]
    is_smooth = np.einsum("nd,nd->n", unit[first], unit[second]) > np.cos(crease)
    normals = np.zeros((len(corner_point), 3))
    np.add.at(normals, pairs.row[is_smooth], weighted[second[is_smooth]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)

    positions = solid.vertices[faces].reshape(-1, 3)
    keys = np.round(np.hstack([positions, normals]), 5)
    _, index, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return positions[index], normals[index], inverse.ravel().reshape(-1, 3)
