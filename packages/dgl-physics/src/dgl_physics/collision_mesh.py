"""Triangle meshes that cloth collides with."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from dgl_physics import topology
from dgl_physics.convex_hull import compute_hull
from dgl_physics.distance_grid import DistanceGrid, build_distance_grid
from dgl_physics.errors import MeshError
from dgl_physics.grid_cache import load_or_build

_CONVEX_TOLERANCE = 1e-3
"""Height of a convex mesh's vertex above one of its triangles, at most, over the radius."""
_SLIVER = 1e-5
"""Area over the squared radius below which a triangle has no reliable normal."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CollisionMesh:
    """A surface for shapes of kind "mesh" and "convex", with its grid of signed distances.

    The grid is made at the first use and kept: give equal shapes the same object. Closed parts may
    overlap: their union is inside. Vertices at the same position count as one.

    Limitations: parts thinner than a cell of the grid, and sharp edges, are rounded.
    """

    vertices: np.ndarray
    """[m], shape (V, 3), in the shape's frame."""
    faces: np.ndarray
    """Vertex indices, shape (F, 3), counter-clockwise seen from outside."""
    is_sheet: bool = False
    """The surface has no inside: cloth stays at its side. Open meshes need it."""
    spacing: float | None = None
    """Side of the grid's cells [m]; > 0. When None a quarter of the smallest extent, between
    0.5 and 2.5 mm, and more where `max_nodes` demands it."""
    reach: float = 0.016
    """Distance from the surface up to which the cells are that fine [m]; at least the rest offset
    and adhesion radius of all garments."""
    max_nodes: int = 2_000_000
    """Most nodes of the grid, of 4 bytes each."""

    def __post_init__(self) -> None:
        vertices, faces = np.asarray(self.vertices), np.asarray(self.faces)
        topology.check_arrays(vertices, faces, "faces", 3)
        vertices, faces = _weld(vertices.astype(np.float32).astype(np.float64), faces)
        _check_triangles(vertices, faces)
        if not self.is_sheet:
            _check_closed(vertices, faces)
        if self.spacing is not None and not self.spacing > 0:
            raise ValueError(f"spacing must be > 0; got {self.spacing}")
        if not self.reach > 0:
            raise ValueError(f"reach must be > 0; got {self.reach}")
        if self.max_nodes < 1:
            raise ValueError(f"max_nodes must be >= 1; got {self.max_nodes}")
        object.__setattr__(self, "vertices", vertices)
        object.__setattr__(self, "faces", faces)

    @staticmethod
    def hull(
        points: np.ndarray,
        *,
        spacing: float | None = None,
        reach: float = 0.016,
        max_nodes: int = 2_000_000,
    ) -> "CollisionMesh":
        """Make the convex hull of points [m], shape (N, 3); the rest are the fields.

        Raises:
            MeshError: If the points do not span a volume.
        """
        vertices, faces = compute_hull(points)
        return CollisionMesh(
            vertices=vertices, faces=faces, spacing=spacing, reach=reach, max_nodes=max_nodes
        )

    @cached_property
    def centre(self) -> np.ndarray:
        """Centre of the bounding box [m], shape (3,)."""
        return 0.5 * (self.vertices.min(axis=0) + self.vertices.max(axis=0))

    @cached_property
    def radius(self) -> float:
        """Radius of the sphere around `centre` that contains the mesh [m]."""
        return float(np.linalg.norm(self.vertices - self.centre, axis=1).max())

    @cached_property
    def is_convex(self) -> bool:
        """True if the surface bounds a convex body."""
        if self.is_sheet:
            return False
        crosses = _compute_crosses(self.vertices, self.faces)
        size = np.linalg.norm(crosses, axis=1)
        clear = size > _SLIVER * self.radius**2
        normals, corners = crosses[clear] / size[clear, None], self.vertices[self.faces[clear, 0]]
        bounds = np.sum(normals * corners, axis=1) + _CONVEX_TOLERANCE * self.radius
        return all(
            (normals[k : k + 256] @ self.vertices.T <= bounds[k : k + 256, None]).all()
            for k in range(0, len(normals), 256)  # all at once would need much memory
        )

    @cached_property
    def grid(self) -> DistanceGrid:
        """Signed distances around `centre`, built within seconds; large grids stay on disk."""
        vertices = self.vertices - self.centre
        return load_or_build(
            vertices,
            self.faces,
            (self.is_sheet, self.spacing, self.reach, self.max_nodes),
            lambda: build_distance_grid(
                vertices,
                self.faces,
                is_sheet=self.is_sheet,
                spacing=self.spacing,
                reach=self.reach,
                max_nodes=self.max_nodes,
            ),
        )


def _weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Merge vertices at the same position, and drop degenerate triangles and unused vertices."""
    vertices, index = np.unique(vertices, axis=0, return_inverse=True)
    faces = index.reshape(-1)[faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    used, index = np.unique(faces, return_inverse=True)
    return vertices[used], index.reshape(faces.shape).astype(np.int32)


def _compute_crosses(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.cross(b - a, c - a)


def _compute_volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Volume within a closed surface [m^3]."""
    arms = vertices[faces[:, 0]] - vertices.mean(axis=0)
    return float(np.sum(arms * _compute_crosses(vertices, faces)) / 6)


def _check_triangles(vertices: np.ndarray, faces: np.ndarray) -> None:
    if len(faces) == 0:
        raise MeshError("no triangle has three corners at different places")
    crosses = np.linalg.norm(_compute_crosses(vertices, faces), axis=1)
    bad = np.flatnonzero(crosses < 1e-12)
    if len(bad):
        corner = vertices[faces[bad[0], 0]].round(4).tolist()
        raise MeshError(f"{len(bad)} triangles have no area, the first has a corner at {corner}")


def is_closed(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Decide if a surface has no boundary: each edge is passed as often forth as back."""
    return len(_find_open_edges(*_weld(vertices, faces))) == 0


def _find_open_edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Middles of the edges that are not passed as often forth as back [m], shape (N, 3)."""
    directed = topology.list_sides(faces)
    forth = np.where(directed[:, 0] < directed[:, 1], 1, -1)
    edges, index = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
    is_open = np.bincount(index.reshape(-1), weights=forth, minlength=len(edges)) != 0
    return vertices[edges[is_open]].mean(axis=1)


def _check_closed(vertices: np.ndarray, faces: np.ndarray) -> None:
    middles = _find_open_edges(vertices, faces)
    if len(middles):
        raise MeshError(
            f"the mesh must be closed and its triangles wound alike, but {len(middles)} of its "
            f"edges are open, the first at {middles[0].round(4).tolist()}; close it, or give "
            "is_sheet=True for a surface without an inside"
        )
    volume = _compute_volume(vertices, faces)
    if not volume > 0:
        raise MeshError(
            f"triangles must be counter-clockwise seen from outside; the volume is {volume:.3g} m^3"
        )
