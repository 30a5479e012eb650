"""Turn solids into parts of props, with normals and texture coordinates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dgl_assets.materials import SPECIES, WoodMaterial
from dgl_assets.props.prop import Finish, Prop, PropPart
from dgl_assets.props.shapes import PropShape
from dgl_assets.robots._solids import Solid, shade

WOODS: tuple[str, ...] = tuple(SPECIES)
"""Names of woods that props can be made of."""
_WOOD_DENSITY, _STEEL_DENSITY = 680.0, 7850.0  # [kg/m^3]
FINISHES: dict[str, Finish] = {
    "steel": Finish(
        name="steel", colour=(0.5, 0.51, 0.52), roughness=0.32, metallic=0.55,
        density=_STEEL_DENSITY,
    ),
    "brass": Finish(
        name="brass", colour=(0.55, 0.38, 0.14), roughness=0.35, metallic=0.6, density=8500.0
    ),
    "black": Finish(
        name="black", colour=(0.02, 0.02, 0.022), roughness=0.6, density=_WOOD_DENSITY
    ),
}  # fmt: skip
"""Finishes without grain: two metals and painted wood."""


def make_wood(species: str, *, seed: int = 0) -> Finish:
    """Make the finish of a wood.

    Raises:
        ValueError: Naming the woods there are.
    """
    if species not in SPECIES:
        raise ValueError(f"wood must be one of {sorted(SPECIES)}; got {species!r}")
    early, late = SPECIES[species]
    mean = (0.62 * np.array(early) + 0.38 * np.array(late)) / 255.0
    r, g, b = mean**2.2
    wood = WoodMaterial(colours=(early, late), tile_size=0.6, rings=16.0, seed=seed, name=species)
    return Finish(
        name=species,
        colour=(float(r), float(g), float(b)),
        roughness=0.68,
        density=_WOOD_DENSITY,
        wood=wood,
    )


def sweep(
    material: str,
    path: np.ndarray,
    half_sizes: np.ndarray,
    *,
    up: tuple[float, float, float] = (0.0, 0.0, 1.0),
    segments: int = 16,
) -> Solid:
    """Move an ellipse along a line, with rounded ends.

    Args:
        material: Name of the finish.
        path: Points of the line [m], shape (N, 3), without sharp turns.
        half_sizes: Half axes of the ellipse [m], across and along `up`, shape (N, 2) or (2,).
        up: Direction of the second axis, not along the line.
        segments: Corners of the ellipse.
    """
    path = np.asarray(path, dtype=float)
    sizes = np.broadcast_to(np.asarray(half_sizes, dtype=float), (len(path), 2))
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(np.asarray(up, dtype=float), tangent)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    top = np.cross(tangent, side)
    angle = np.linspace(0.0, np.pi / 2, 5)[1:]
    reach = sizes.mean(axis=1)
    stations = (
        [(0, -reach[0] * np.sin(a), np.cos(a)) for a in angle[::-1]]
        + [(k, 0.0, 1.0) for k in range(len(path))]
        + [(-1, reach[-1] * np.sin(a), np.cos(a)) for a in angle]
    )
    turn = np.arange(segments) * 2 * np.pi / segments
    rings = []
    for k, ahead, scale in stations:
        ellipse = scale * sizes[k, 0] * np.cos(turn)[:, None] * side[k]
        ellipse = ellipse + scale * sizes[k, 1] * np.sin(turn)[:, None] * top[k]
        rings.append(path[k] + ahead * tangent[k] + ellipse)
    i = np.arange(segments)
    j = (i + 1) % segments
    faces = []
    for k in range(len(rings) - 1):
        a, b = k * segments, (k + 1) * segments
        faces += [np.column_stack([a + i, a + j, b + j]), np.column_stack([a + i, b + j, b + i])]
    vertices, triangles = np.vstack(rings), np.vstack(faces)
    p, q, r = (vertices[triangles[:, c]] for c in range(3))
    is_face = np.linalg.norm(np.cross(q - p, r - p), axis=1) > 1e-13  # none at the tips
    return Solid(material=material, vertices=vertices, faces=triangles[is_face])


def make_part(
    name: str, solids: Solid | Sequence[Solid], finish: Finish, *, is_solid: bool = True
) -> PropPart:
    """Join solids of one finish to a part.

    Texture coordinates are those of the box around each solid: u runs along its longest axis, as
    the grain of a board, and each solid has an offset of its own.
    """
    vertices, normals, uvs, faces, count = [], [], [], [], 0
    for index, solid in enumerate([solids] if isinstance(solids, Solid) else solids):
        v, n, f = shade(solid)
        vertices.append(v)
        normals.append(n)
        uvs.append(_project(v, n) + np.array([0.17, 0.23]) * index)
        faces.append(f + count)
        count += len(v)
    return PropPart(
        name=name,
        vertices=np.vstack(vertices).astype(np.float32),
        faces=np.vstack(faces).astype(np.int32),
        normals=np.vstack(normals).astype(np.float32),
        uvs=np.vstack(uvs).astype(np.float32),
        finish=finish,
        is_solid=is_solid,
    )


def assemble(
    kind: str,
    parts: Sequence[PropPart],
    shapes: Sequence[PropShape],
    landmarks: Mapping[str, tuple[float, float, float]],
    parameters: Mapping[str, object],
) -> Prop:
    """Put a prop together and weigh it."""
    if "target" not in landmarks:
        raise ValueError(f"landmarks must contain 'target'; got {sorted(landmarks)}")
    return Prop(
        kind=kind,
        parts=tuple(parts),
        shapes=tuple(shapes),
        landmarks={name: np.array(point, dtype=float) for name, point in landmarks.items()},
        mass=sum(part.finish.density * _measure_volume(part) for part in parts if part.is_solid),
        parameters=dict(parameters),
    )


def _project(vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Lay a board's grain on a solid: (along, across) [m] by the side that a normal looks to."""
    grain = int(np.argmax(np.ptp(vertices, axis=0)))
    others = [axis for axis in range(3) if axis != grain]
    facing = np.argmax(np.abs(normals), axis=1)
    across = np.where(facing == others[0], vertices[:, others[1]], vertices[:, others[0]])
    along = np.where(facing == grain, vertices[:, others[1]], vertices[:, grain])
    return np.stack([along, across + 0.11 * facing], axis=1)


def _measure_volume(part: PropPart) -> float:
    a, b, c = (part.vertices[part.faces[:, k]].astype(np.float64) for k in range(3))
    return float(np.einsum("fk,fk->", a, np.cross(b, c)) / 6.0)
