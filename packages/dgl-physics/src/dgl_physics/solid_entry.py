"""Entries of elastic solids in a model builder."""

from collections.abc import Sequence

import numpy as np

from dgl_physics import tetrahedra
from dgl_physics.coarse import make_empty_coarse_level
from dgl_physics.elastic import SolidMesh
from dgl_physics.lattice import Skin, fill_closed_surface
from dgl_physics.solid_material import SolidMaterial
from dgl_physics.topology import check_mesh


def make_solid_entry(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    material: SolidMaterial,
    thickness: float | None,
    resolution: int,
    pinned: Sequence[int],
    stiffness: np.ndarray | None = None,
) -> dict:
    """Make tetrahedra of a surface, and an entry of them; see `ModelBuilder.add_solid`."""
    vertices = np.asarray(vertices, dtype=np.float64)
    faces = np.asarray(faces)
    check_mesh(vertices, faces)
    is_closed = tetrahedra.check_orientation(faces)
    if is_closed and thickness is not None:
        raise ValueError(f"a closed surface is filled: thickness must be None; got {thickness}")
    if is_closed:
        if len(pinned):
            raise ValueError(
                f"a filled surface has particles of its own, none can be pinned; got {len(pinned)}"
            )
        if stiffness is not None:
            raise ValueError("a filled surface has particles of its own, stiffness must be None")
        points, tets, skin = fill_closed_surface(vertices, faces, resolution)
        return make_tet_entry(points, tets, material=material, skin=skin)
    if thickness is None or not thickness > 0:
        raise ValueError(f"an open surface needs a wall thickness > 0; got {thickness}")
    n = len(vertices)
    points, tets = tetrahedra.extrude_shell(vertices, faces, thickness)
    through = [i + n for i in pinned]
    both = None
    if stiffness is not None:
        one = check_factors(stiffness, n)
        both = np.concatenate([one, one])
    return make_tet_entry(
        points, tets, material=material, pinned=[*pinned, *through], stiffness=both
    )


def make_tet_entry(
    vertices: np.ndarray,
    tets: np.ndarray,
    *,
    material: SolidMaterial,
    rest: np.ndarray | None = None,
    pinned: Sequence[int] = (),
    skin: Skin | None = None,
    stiffness: np.ndarray | None = None,
) -> dict:
    """Make an entry of tetrahedra; see `ModelBuilder.add_tetrahedra`."""
    vertices = np.asarray(vertices, dtype=np.float64)
    tets = np.asarray(tets)
    rest = vertices if rest is None else np.asarray(rest, dtype=np.float64)
    if rest.shape != vertices.shape:
        raise ValueError(f"rest must have shape {vertices.shape}; got {rest.shape}")
    tetrahedra.check_tets(rest, tets)
    if not np.isfinite(vertices).all():
        raise ValueError("vertices must be finite")
    pinned = [int(i) for i in pinned]
    if any(not 0 <= i < len(rest) for i in pinned):
        raise ValueError(f"pinned must be in 0..{len(rest) - 1}; got {min(pinned)}..{max(pinned)}")
    tets = tets.astype(np.int32)
    if stiffness is not None:
        stiffness = check_factors(stiffness, len(rest))
    mesh = SolidMesh(rest, tets, material, pinned, stiffness)
    edges = tetrahedra.compute_edges(tets)
    faces = tetrahedra.compute_surface(tets)
    radius = np.zeros(len(rest))
    radius[faces] = 0.5 * material.thickness
    inverse_mass = (1.0 / mesh.vertex_mass).astype(np.float32)
    inverse_mass[pinned] = 0.0
    none = np.zeros(0, dtype=np.float32)
    return {
        "vertices": vertices.astype(np.float32),
        "faces": faces,
        "edges": edges,
        "edge_lengths": np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1),
        "joined": _find_close_pairs(rest, edges, material.thickness + material.adhesion_radius),
        "springs": np.zeros((0, 2), dtype=np.int32),
        "rest_length": none,
        "compliance": none,
        "colour": np.zeros(0, dtype=np.int32),
        "inverse_mass": inverse_mass,
        "radius": radius,
        "material": material,
        "solid": mesh,
        "skin": skin,
        "coarse": make_empty_coarse_level(mesh.vertex_mass),
    }


def check_factors(factors: np.ndarray, count: int, *, name: str = "stiffness") -> np.ndarray:
    """Check factors at vertices, and give them as numbers of double precision.

    Raises:
        ValueError: If their number is not `count`, or one is not positive.
    """
    factors = np.asarray(factors, dtype=np.float64)
    if factors.shape != (count,):
        raise ValueError(f"{name} must have shape ({count},); got {factors.shape}")
    if not (np.isfinite(factors) & (factors > 0)).all():
        raise ValueError(f"{name} must be positive; got {factors.min():g}")
    return factors


def _find_close_pairs(rest: np.ndarray, edges: np.ndarray, reach: float) -> np.ndarray:
    """Pairs that never touch: joined by an edge, or within each other's reach at rest."""
    pairs = [edges]
    for first in range(0, len(rest), 256):
        d = rest[first : first + 256, None] - rest[None]
        i, j = np.nonzero(np.einsum("ijk,ijk->ij", d, d) < reach**2)
        close = np.column_stack([i + first, j])
        pairs.append(close[close[:, 0] < close[:, 1]])
    return np.unique(np.concatenate(pairs), axis=0).astype(np.int32)
