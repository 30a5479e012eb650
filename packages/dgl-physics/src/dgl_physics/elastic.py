"""Elastic solids of a model: their meshes, masses and elements."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics import factor, topology
from dgl_physics._kernels.solid import Elements
from dgl_physics.solid_material import SolidMaterial
from dgl_physics.tetrahedra import compute_surface, compute_volumes


class SolidMesh:
    """One tetrahedral mesh with its material, common to all environments that have it.

    Attributes:
        order: Particle of each row, shape (V,); rows that are joined are near each other.
        tets: Rows of each element, shape (T, 4).
        inverse_shape: Inverse rest edge matrices [1/m], shape (T, 3, 3).
        edges: Rows of both ends of each edge of the surface, shape (E, 2).
        volume: Rest volumes [m^3], shape (T,).
        mass: Of each row [kg], 0 for pinned ones, shape (V,).
        stiffness: Of each element, relative to the material's, shape (T,).
    """

    def __init__(
        self,
        rest: np.ndarray,
        tets: np.ndarray,
        material: SolidMaterial,
        pinned: Sequence[int],
        stiffness: np.ndarray | None = None,
    ) -> None:
        self.material = material
        self.stiffness = np.ones(len(tets))
        if stiffness is not None:
            self.stiffness = stiffness[tets].mean(axis=1)
        self.vertex_count = len(rest)
        self.order = factor.order_rows(tets, len(rest))
        row = np.empty(len(rest), dtype=np.int64)
        row[self.order] = np.arange(len(rest))
        self.tets = row[tets]
        self.edges = row[topology.compute_edges(compute_surface(tets))]
        self.volume = compute_volumes(rest, tets)
        edges = rest[tets[:, 1:]] - rest[tets[:, :1]]  # (T, 3, 3), edges as rows
        self.inverse_shape = np.linalg.inv(edges.transpose(0, 2, 1))
        weights = np.repeat(self.volume * (material.density / 4), 4)
        mass = np.bincount(self.tets.ravel(), weights, minlength=len(rest))
        self.vertex_mass = mass[row]
        self.mass = mass.copy()
        self.mass[row[list(pinned)]] = 0.0

    def make_factor(self, dt: float) -> factor.Factor:
        """Factorise mass + dt (dt + damping) times the stiffness bound, for free rows."""
        mu, lame = self.material.compute_lame()
        # For small strains the largest stiffness is 2 mu + 3 lambda; a step is stable when the
        # bound is more than half of it.
        bound = 2.0 * mu + 2.0 * lame
        gradient = np.concatenate(
            [-self.inverse_shape.sum(axis=1, keepdims=True), self.inverse_shape], axis=1
        )  # (T, 4, 3)
        scale = dt * (dt + self.material.damping) * bound * self.volume * self.stiffness
        blocks = scale[:, None, None] * (gradient @ gradient.transpose(0, 2, 1))  # (T, 4, 4)
        rows = np.repeat(self.tets, 4, axis=1).ravel()
        columns = np.tile(self.tets, (1, 4)).ravel()
        is_coupled = (self.mass[rows] > 0) & (self.mass[columns] > 0)
        diagonal = np.where(self.mass > 0, self.mass, 1.0)
        return factor.factorise(
            diagonal, rows[is_coupled], columns[is_coupled], blocks.ravel()[is_coupled]
        )


@dataclass(frozen=True)
class Solids:
    """The solids of all environments on one device, in rows."""

    meshes: tuple[SolidMesh, ...]
    """Different meshes."""
    mesh_index: np.ndarray
    """Mesh of each solid, shape (S,)."""
    first_row: np.ndarray
    """First row of each solid, shape (S,)."""
    particle: wp.array
    mass: wp.array
    damping: wp.array
    edges: np.ndarray
    """Rows of both ends of each edge of the surfaces, shape (E, 2)."""
    first_edge: np.ndarray
    """First edge of each solid, shape (S,)."""
    edge_count: np.ndarray
    """Shape (S,)."""
    incident_start: wp.array
    incident: wp.array
    elements: Elements


def build_solids(placed: Sequence[tuple[int, SolidMesh]], device: str) -> Solids | None:
    """Put solids, each given by its first particle and its mesh, on a device; None if none."""
    if not placed:
        return None
    meshes = list(dict.fromkeys(mesh for _, mesh in placed))
    counts = np.array([mesh.vertex_count for _, mesh in placed])
    first_row = np.concatenate([[0], np.cumsum(counts)[:-1]])
    parts = list(zip(first_row.tolist(), placed, strict=True))
    tets = np.concatenate([mesh.tets + row for row, (_, mesh) in parts])
    edge_count = np.array([len(mesh.edges) for _, mesh in placed])
    moduli = []
    for _, mesh in placed:
        mu, lame = mesh.material.compute_lame()
        # Coefficients that give these moduli at rest: Smith, de Goes and Kim 2018, section 3.4.
        moduli.append(np.outer(mesh.stiffness, [4 / 3 * mu, lame + 5 / 6 * mu]))
    corners = tets.ravel()
    incident = np.argsort(corners, kind="stable")
    start = np.searchsorted(corners[incident], np.arange(counts.sum() + 1))

    def to_device(values: np.ndarray | list, dtype: type) -> wp.array:
        return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

    elements = Elements()
    elements.rows = to_device(tets, wp.vec4i)
    elements.inverse_shape = to_device(
        np.concatenate([mesh.inverse_shape for _, mesh in placed]), wp.mat33
    )
    elements.volume = to_device(np.concatenate([mesh.volume for _, mesh in placed]), wp.float32)
    elements.moduli = to_device(np.concatenate(moduli), wp.vec2)
    damping = [np.full(mesh.vertex_count, mesh.material.damping) for _, mesh in placed]
    return Solids(
        meshes=tuple(meshes),
        mesh_index=np.array([meshes.index(mesh) for _, mesh in placed]),
        first_row=first_row,
        particle=to_device(np.concatenate([first + m.order for first, m in placed]), wp.int32),
        mass=to_device(np.concatenate([mesh.mass for _, mesh in placed]), wp.float32),
        damping=to_device(np.concatenate(damping), wp.float32),
        edges=np.concatenate([mesh.edges + row for row, (_, mesh) in parts]),
        first_edge=np.concatenate([[0], np.cumsum(edge_count)[:-1]]),
        edge_count=edge_count,
        incident_start=to_device(start, wp.int32),
        incident=to_device(incident, wp.int32),
        elements=elements,
    )
