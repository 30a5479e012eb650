"""Constants of a simulation: meshes, constraints and shapes; and their builder."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics import topology
from dgl_physics._kernels.types import Grid, ParticleMaterial, ShapeTable
from dgl_physics.bending import make_bending
from dgl_physics.coarse import CoarseLevel, CoarseTable, build_coarse_level, join_coarse_levels
from dgl_physics.contact_material import ContactMaterial
from dgl_physics.elastic import Solids, build_solids
from dgl_physics.lattice import Skin
from dgl_physics.material import ClothMaterial
from dgl_physics.membrane import compute_edge_stiffness, compute_moduli, make_yarns
from dgl_physics.quiet import quiet_warp
from dgl_physics.shape_table import build_shape_table
from dgl_physics.shapes import Shape
from dgl_physics.solid_entry import check_factors, make_solid_entry, make_tet_entry
from dgl_physics.solid_material import SolidMaterial
from dgl_physics.stencils import Stencils, upload_stencils


@dataclass(frozen=True, kw_only=True)
class GarmentParticles:
    """Particles and surface of one garment of one environment."""

    env: int
    first: int
    """Index of its first particle within the environment."""
    vertex_count: int
    faces: np.ndarray
    """Vertex indices of the garment's surface, shape (F, 3), int32."""
    edges: np.ndarray
    """Shape (E, 2), int32."""
    rest_lengths: np.ndarray
    """Rest length of each edge [m], shape (E,)."""
    skin: Skin | None = None
    """Surface of a filled solid."""

    def get_surface(self, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the surface to draw.

        Args:
            positions: All particles of its environment [m], shape (V, 3).

        Returns:
            Vertices [m], shape (S, 3), and triangles, shape (F, 3).
        """
        own = positions[self.first : self.first + self.vertex_count]
        if self.skin is None:
            return own, self.faces
        return self.skin.compute_vertices(own), self.skin.faces


LARGEST_PARTICLE_FRICTION = 1.0
"""Bound of the friction between particles: larger values build up errors of the contact forces."""


@dataclass(frozen=True)
class Model:
    """Constants of a batch of environments, on one device.

    Particles of environment e are rows e * particles_per_env ... of the flat arrays. Smaller
    environments are padded with inactive particles of zero inverse mass.
    """

    device: str
    env_count: int
    particles_per_env: int
    body_count: int
    shape_count: int
    garments: tuple[GarmentParticles, ...]
    initial_positions: np.ndarray
    """[m], shape (B, V, 3)."""
    contact_reach: float
    """Largest distance at which two particles act on each other [m]."""
    shapes: ShapeTable
    grids: tuple[Grid, ...]
    """Grids of the meshes among the shapes; `shapes` points to their arrays."""
    materials: wp.array
    environment: wp.array
    garment_index: wp.array
    inverse_mass: wp.array
    pairs: wp.array
    rest_length: wp.array
    compliance: wp.array
    colour_start: tuple[int, ...]
    """First constraint of each colour, and the end of the last."""
    bending: Stencils
    """Hinges; see `dgl_physics.bending`."""
    yarns: Stencils
    """Triangles with yarns; see `dgl_physics.membrane`."""
    is_stretch_damped: bool
    adjacency_start: wp.array
    adjacency: wp.array
    """Particles that do not touch each other, as the mesh holds them apart."""
    touch: wp.array
    """Radius [m] of each particle, and its friction, adhesion [N/m] and adhesion radius [m] against
    particles. Two particles rest at the sum of their radii; particles inside solids have none."""
    solids: Solids | None
    coarse: CoarseTable


class ModelBuilder:
    """Collects garments and rigid shapes and builds a `Model`.

    Every environment has the same rigid shapes; garments may differ between environments.
    """

    def __init__(self, env_count: int = 1) -> None:
        if env_count < 1:
            raise ValueError(f"env_count must be >= 1; got {env_count}")
        self.env_count = env_count
        self._garments: list[list[dict]] = [[] for _ in range(env_count)]
        self._bodies: list[str] = ["world"]
        self._shapes: list[tuple[int, Shape]] = []

    def add_garment(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        *,
        material: ClothMaterial | None = None,
        rest: np.ndarray | None = None,
        pinned: np.ndarray | tuple[int, ...] = (),
        stiffness: np.ndarray | None = None,
        shrinkage: np.ndarray | None = None,
        env: int | None = None,
    ) -> None:
        """Add a garment to one environment, or the same to all.

        Args:
            vertices: Initial positions [m], shape (V, 3).
            faces: Vertex indices, shape (F, 3).
            material: Fabric and contact parameters.
            rest: Unstrained positions [m], shape (V, 2) or (V, 3); `vertices` when not given.
                Layers that share flat coordinates are not strained by the gap between them.
                Two columns also define the fabric's frame: weft along the first, warp along the
                second.
            pinned: Vertices that do not move.
            stiffness: Factor on the flexural rigidity at each vertex, shape (V,); 1 everywhere
                when None. Seams that are folded at rest turn freely where it is 1 or less.
            shrinkage: Factor on the rest lengths of edges at each vertex, shape (V,), such as 0.6
                for an elastic band; 1 everywhere when None.
            env: Environment; all when None.

        Raises:
            MeshError: If the mesh cannot be simulated.
        """
        vertices = np.asarray(vertices, dtype=np.float64)
        faces = np.asarray(faces)
        topology.check_mesh(vertices, faces)
        rest = vertices if rest is None else np.asarray(rest, dtype=np.float64)
        if rest.shape not in ((len(vertices), 2), (len(vertices), 3)):
            raise ValueError(
                f"rest must have shape ({len(vertices)}, 2) or (..., 3); got {rest.shape}"
            )
        entry = _make_constraints(
            vertices, faces.astype(np.int32), rest, material or ClothMaterial(), stiffness
        )
        if shrinkage is not None:
            factors = check_factors(shrinkage, len(vertices), name="shrinkage")
            entry["rest_length"] = entry["rest_length"] * factors[entry["edges"]].mean(axis=1)
        entry["inverse_mass"][list(pinned)] = 0.0
        self._place(entry, env)

    def add_solid(
        self,
        vertices: np.ndarray,
        faces: np.ndarray,
        *,
        material: SolidMaterial | None = None,
        thickness: float | None = None,
        resolution: int = 16,
        pinned: np.ndarray | tuple[int, ...] = (),
        stiffness: np.ndarray | None = None,
        env: int | None = None,
    ) -> None:
        """Add an elastic solid, given by its surface, to one environment or the same to all.

        An open surface (a hat, a glove) becomes a wall of one layer of tetrahedra behind it: the
        particles are its vertices, followed by their copies on the inside. A closed surface is
        filled with a lattice that carries it; `GarmentParticles.get_surface` gives the surface.

        Args:
            vertices: Unstrained positions [m], shape (V, 3).
            faces: Vertex indices, counter-clockwise seen from outside, shape (F, 3).
            material: Elastic and contact parameters.
            thickness: Thickness of the wall of an open surface [m]; None for a closed one.
            resolution: Cubes of the lattice along the longest side of a closed surface.
            pinned: Vertices of an open surface that do not move, through the whole wall.
            stiffness: Factor on Young's modulus at each vertex of an open surface, shape (V,); 1
                everywhere when None.
            env: Environment; all when None.

        Raises:
            MeshError: If the mesh cannot be simulated.
        """
        entry = make_solid_entry(
            vertices,
            faces,
            material=material or SolidMaterial(),
            thickness=thickness,
            resolution=resolution,
            pinned=tuple(pinned),
            stiffness=stiffness,
        )
        self._place(entry, env)

    def add_tetrahedra(
        self,
        vertices: np.ndarray,
        tets: np.ndarray,
        *,
        material: SolidMaterial | None = None,
        rest: np.ndarray | None = None,
        pinned: np.ndarray | tuple[int, ...] = (),
        stiffness: np.ndarray | None = None,
        env: int | None = None,
    ) -> None:
        """Add an elastic solid, given by tetrahedra, to one environment or the same to all.

        Args:
            vertices: Initial positions [m], shape (V, 3).
            tets: Vertex indices, shape (T, 4).
            material: Elastic and contact parameters.
            rest: Unstrained positions [m], shape (V, 3), in which every tetrahedron has a
                positive volume; `vertices` when not given.
            pinned: Vertices that do not move.
            stiffness: Factor on Young's modulus at each vertex, shape (V,); 1 everywhere when None.
            env: Environment; all when None.

        Raises:
            MeshError: If the mesh cannot be simulated.
        """
        entry = make_tet_entry(
            vertices,
            tets,
            material=material or SolidMaterial(),
            rest=rest,
            pinned=tuple(pinned),
            stiffness=stiffness,
        )
        self._place(entry, env)

    def _place(self, entry: dict, env: int | None) -> None:
        if env is not None and not 0 <= env < self.env_count:
            raise ValueError(f"env must be in 0..{self.env_count - 1}; got {env}")
        for e in range(self.env_count) if env is None else [env]:
            self._garments[e].append(entry)

    def add_body(self, name: str) -> int:
        """Add a rigid body of prescribed motion; returns its index (0 is the world)."""
        self._bodies.append(name)
        return len(self._bodies) - 1

    def add_shape(self, shape: Shape, *, body: int = 0) -> int:
        """Fix a shape to a body; returns its index."""
        if not 0 <= body < len(self._bodies):
            raise ValueError(f"body must be in 0..{len(self._bodies) - 1}; got {body}")
        self._shapes.append((body, shape))
        return len(self._shapes) - 1

    def add_ground(self, friction: float = 1.0) -> int:
        """Add the plane z = 0; returns its shape index."""
        return self.add_shape(Shape(kind="plane", friction=friction))

    @quiet_warp()
    def build(self, device: str = "cpu") -> Model:
        """Build the model on a Warp device ("cpu", "cuda:0")."""
        if any(not g for g in self._garments):
            raise ValueError("every environment needs a garment before build()")
        sizes = [sum(len(g["vertices"]) for g in envs) for envs in self._garments]
        per_env = max(sizes)
        count = self.env_count * per_env
        position = np.zeros((count, 3), dtype=np.float32)
        # Padding is spread out, so that it does not crowd one cell of the neighbour grid.
        position[:, 0] = 1.0e3 + np.arange(count) % per_env
        inverse_mass = np.zeros(count, dtype=np.float32)
        garment_index = np.zeros(count, dtype=np.int32)
        garments: list[GarmentParticles] = []
        blocks: list[tuple[np.ndarray, ...]] = []
        bending, yarns = [], []
        edge_blocks: list[np.ndarray] = []
        materials: list[ContactMaterial] = []
        touch = np.zeros((count, 4), dtype=np.float32)
        solids = []
        levels: list[tuple[int, CoarseLevel]] = []
        for e, entries in enumerate(self._garments):
            first = 0
            for g in entries:
                base = e * per_env + first
                n = len(g["vertices"])
                position[base : base + n] = g["vertices"]
                inverse_mass[base : base + n] = g["inverse_mass"]
                garment_index[base : base + n] = len(garments)
                touch[base : base + n] = _describe_touch(g["radius"], g["material"])
                springs = g.get("springs", g["edges"])
                blocks.append((springs + base, g["rest_length"], g["compliance"], g["colour"]))
                edge_blocks.append(g.get("joined", g["edges"]) + base)
                if "solid" in g:
                    solids.append((base, g["solid"]))
                else:
                    bending.append((g["bending"], g["bending_colour"], base))
                    yarns.append((g["yarns"], g["yarn_colour"], base))
                levels.append((base, g["coarse"]))
                materials.append(g["material"])
                garments.append(
                    GarmentParticles(
                        env=e,
                        first=first,
                        vertex_count=n,
                        faces=g["faces"],
                        edges=g["edges"],
                        rest_lengths=g.get("edge_lengths", g["rest_length"]),
                        skin=g.get("skin"),
                    )
                )
                first += n
        pairs, rest_length, compliance, colour = (
            np.concatenate(b) for b in zip(*blocks, strict=True)
        )
        order, colour_start = topology.sort_by_colour(colour)
        adjacency_start, adjacency = topology.compute_adjacency(np.concatenate(edge_blocks), count)

        def to_device(values: np.ndarray, dtype: type) -> wp.array:
            return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)

        contact_gap = max(m.rest_offset + m.adhesion_radius for m in materials)
        shapes, grids = build_shape_table(self._shapes, contact_gap, device)
        return Model(
            device=device,
            env_count=self.env_count,
            particles_per_env=per_env,
            body_count=len(self._bodies),
            shape_count=len(self._shapes),
            garments=tuple(garments),
            initial_positions=position.reshape(self.env_count, per_env, 3),
            contact_reach=float(2.0 * touch[:, 0].max() + touch[:, 3].max()),
            shapes=shapes,
            grids=grids,
            materials=wp.array(
                [_to_struct(m) for m in materials], dtype=ParticleMaterial, device=device
            ),
            environment=to_device(np.repeat(np.arange(self.env_count), per_env), wp.int32),
            garment_index=to_device(garment_index, wp.int32),
            inverse_mass=to_device(inverse_mass, wp.float32),
            pairs=to_device(pairs[order], wp.vec2i),
            rest_length=to_device(rest_length[order], wp.float32),
            compliance=to_device(compliance[order], wp.float32),
            colour_start=colour_start,
            bending=upload_stencils(bending, device),
            yarns=upload_stencils(yarns, device),
            is_stretch_damped=any(
                isinstance(m, ClothMaterial) and m.stretch_damping > 0 for m in materials
            ),
            adjacency_start=to_device(adjacency_start, wp.int32),
            adjacency=to_device(adjacency, wp.int32),
            touch=to_device(touch, wp.vec4),
            solids=build_solids(solids, device),
            coarse=join_coarse_levels(levels, count, device),
        )


def _make_constraints(
    vertices: np.ndarray,
    faces: np.ndarray,
    rest: np.ndarray,
    material: ClothMaterial,
    stiffness: np.ndarray | None,
) -> dict:
    moduli = compute_moduli(
        material.stretch_stiffness, material.shear_stiffness if rest.shape[1] == 2 else None
    )
    yarns = make_yarns(rest[:, :2], faces, moduli.yarn, damping_time=material.stretch_damping)
    if rest.shape[1] == 2:
        rest = np.column_stack([rest, np.zeros(len(rest))])
    edges = topology.compute_edges(faces)
    bending = make_bending(
        rest,
        faces,
        material.bending_stiffness,
        factors=None if stiffness is None else check_factors(stiffness, len(vertices)),
        damping_time=material.bending_damping,
    )
    areas = topology.compute_vertex_areas(rest, faces)
    radius = topology.compute_radii(rest, edges, material.thickness)
    return {
        "vertices": vertices.astype(np.float32),
        "faces": faces,
        "edges": edges,
        "joined": np.concatenate([edges, topology.find_close_wings(rest, faces, radius)]),
        "radius": radius,
        "rest_length": np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1),
        "compliance": 1.0 / compute_edge_stiffness(rest, faces, edges, moduli.net),
        "colour": topology.colour_constraints(edges, len(vertices)),
        "bending": bending,
        "bending_colour": topology.colour_constraints(bending.vertices, len(vertices)),
        "yarns": yarns,
        "yarn_colour": topology.colour_constraints(yarns.vertices, len(vertices)),
        "inverse_mass": (1.0 / (areas * material.area_density)).astype(np.float32),
        "coarse": build_coarse_level(rest, faces, areas * material.area_density, moduli),
        "material": material,
    }


def _describe_touch(radius: np.ndarray, m: ContactMaterial) -> np.ndarray:
    """Rows of `Model.touch`, shape (V, 4)."""
    friction = min(m.friction * m.particle_friction_scale, LARGEST_PARTICLE_FRICTION)
    others = friction, m.adhesion * m.particle_adhesion_scale
    return np.column_stack([radius, np.tile([*others, m.adhesion_radius], (len(radius), 1))])


def _to_struct(m: ContactMaterial) -> ParticleMaterial:
    s = ParticleMaterial()
    s.friction = m.friction
    s.adhesion = m.adhesion
    s.adhesion_radius = m.adhesion_radius
    s.rest_offset = m.rest_offset
    s.drag = m.drag
    if isinstance(m, ClothMaterial):
        s.stretch_damping = m.stretch_damping
        s.stiffening = m.compression_stiffness / m.area_density
    elif isinstance(m, SolidMaterial):
        s.stiffening = m.compression_stiffness / (m.density * m.thickness)
    s.is_solid = int(isinstance(m, SolidMaterial))
    return s
