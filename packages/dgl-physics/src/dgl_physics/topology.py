"""Edges, hinges, panels and masses of a triangle mesh, and colouring of its constraints.

Positions `vertices` and `rest` are in metres, shape (V, 3); `faces` and `edges` are vertex indices,
shapes (F, 3) and (E, 2); hinges are (edge 0, edge 1, wing 0, wing 1), shape (H, 4).
"""

import numpy as np

from dgl_physics.errors import MeshError


def check_arrays(vertices: np.ndarray, cells: np.ndarray, name: str, corners: int) -> None:
    """Check shapes, types, finite positions and indices of a mesh.

    Args:
        vertices: Positions [m], shape (V, 3).
        cells: Vertex indices, shape (N, corners), integer.
        name: Name of the cells in messages, "faces" or "tets".
        corners: Corners of a cell.

    Raises:
        MeshError: Naming the first offending index and the count.
    """
    letter = name[0].upper()
    if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) == 0:
        raise MeshError(f"vertices must have shape (V, 3) with V > 0; got {vertices.shape}")
    if cells.ndim != 2 or cells.shape[1] != corners or len(cells) == 0:
        raise MeshError(
            f"{name} must have shape ({letter}, {corners}) with {letter} > 0; got {cells.shape}"
        )
    if not np.issubdtype(cells.dtype, np.integer):
        raise MeshError(f"{name} must be integers; got {cells.dtype}")
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if len(bad):
        raise MeshError(f"{len(bad)} vertices are not finite, the first is {bad[0]}")
    if cells.min() < 0 or cells.max() >= len(vertices):
        raise MeshError(
            f"{name} must index 0..{len(vertices) - 1}; got {cells.min()}..{cells.max()}"
        )


def list_sides(faces: np.ndarray) -> np.ndarray:
    """List the directed sides of triangles, side by side, shape (3 F, 2)."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def check_mesh(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Check that a triangle mesh can be simulated as cloth.

    Raises:
        MeshError: Naming the first offending index and the count.
    """
    check_arrays(vertices, faces, "faces", 3)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    bad = np.flatnonzero(np.linalg.norm(np.cross(b - a, c - a), axis=1) < 1e-10)
    if len(bad):
        raise MeshError(f"{len(bad)} triangles have no area, the first is {bad[0]}")
    unused = np.setdiff1d(np.arange(len(vertices)), faces)
    if len(unused):
        raise MeshError(f"{len(unused)} vertices belong to no triangle, the first is {unused[0]}")
    directed = list_sides(faces)
    pairs, counts = np.unique(np.sort(directed, axis=1), axis=0, return_counts=True)
    bad = np.flatnonzero(counts > 2)
    if len(bad):
        raise MeshError(
            f"{len(bad)} edges belong to more than two triangles, "
            f"the first is {tuple(pairs[bad[0]])}"
        )


def compute_edges(faces: np.ndarray) -> np.ndarray:
    """Compute the unique edges of a mesh, shape (E, 2), int32, sorted."""
    directed = list_sides(faces)
    count = int(directed.max(initial=0)) + 1
    keys = np.unique(directed.min(axis=1).astype(np.int64) * count + directed.max(axis=1))
    return np.column_stack(np.divmod(keys, count)).astype(np.int32)


def compute_hinges(faces: np.ndarray) -> np.ndarray:
    """Compute the hinge of each inner edge of a mesh, shape (H, 4), int32."""
    directed = list_sides(faces)
    opposite = np.concatenate([faces[:, 2], faces[:, 0], faces[:, 1]])
    keys = np.sort(directed, axis=1)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    keys, opposite = keys[order], opposite[order]
    same = np.flatnonzero((keys[1:] == keys[:-1]).all(axis=1))
    return np.column_stack([keys[same], opposite[same], opposite[same + 1]]).astype(np.int32)


def is_flat_hinge(rest: np.ndarray, hinges: np.ndarray) -> np.ndarray:
    """Find the hinges that are open at rest.

    A seam of two panels that lie on each other is folded by 180 degrees at rest; it has no
    bending stiffness here, as a sewn seam turns freely.

    Returns:
        Shape (H,), bool: True if the wings lie on opposite sides of the edge.
    """
    e0, e1, w0, w1 = (rest[hinges[:, k]] for k in range(4))
    axis = e1 - e0
    axis = axis / np.linalg.norm(axis, axis=1, keepdims=True)
    arm0, arm1 = w0 - e0, w1 - e0
    arm0 = arm0 - axis * np.sum(arm0 * axis, axis=1, keepdims=True)
    arm1 = arm1 - axis * np.sum(arm1 * axis, axis=1, keepdims=True)
    return np.sum(arm0 * arm1, axis=1) < 0


def label_panels(faces: np.ndarray, open_hinges: np.ndarray) -> np.ndarray:
    """Label the panels of a mesh: triangles joined by hinges that are open at rest.

    Returns:
        Panel of each triangle, shape (F,), int64, from 0 in the order of their first triangle.
    """
    directed = list_sides(faces)
    keys = np.sort(directed, axis=1)
    width = int(faces.max()) + 1
    keys = keys[:, 0].astype(np.int64) * width + keys[:, 1]
    wanted = np.sort(open_hinges[:, :2], axis=1).astype(np.int64)
    is_open = np.isin(keys, wanted[:, 0] * width + wanted[:, 1])
    order = np.argsort(keys, kind="stable")
    order = order[is_open[order]]
    pairs = (order % len(faces)).reshape(-1, 2)  # the two triangles of each open hinge
    label = np.arange(len(faces))
    while True:
        lowest = label.copy()
        np.minimum.at(lowest, pairs[:, 0], label[pairs[:, 1]])
        np.minimum.at(lowest, pairs[:, 1], label[pairs[:, 0]])
        lowest = lowest[lowest]
        if (lowest == label).all():
            return np.unique(label, return_inverse=True)[1].ravel()
        label = lowest


def compute_vertex_normals(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute area-weighted unit normals of a mesh's vertices, shape (V, 3), float32."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.stack(
        [
            np.bincount(faces.ravel(), np.repeat(weighted[:, k], 3), minlength=len(positions))
            for k in range(3)
        ],
        axis=1,
    )
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return (normals / np.maximum(length, 1e-12)).astype(np.float32)


def compute_vertex_areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Compute a third of the area of the triangles around each vertex [m^2], shape (V,)."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return np.bincount(faces.ravel(), weights=np.repeat(area / 3, 3), minlength=len(vertices))


def colour_constraints(vertices: np.ndarray, vertex_count: int) -> np.ndarray:
    """Colour constraints so that those of one colour share no vertex.

    Greedy in the given order, so the result is deterministic.

    Args:
        vertices: Vertex indices of each constraint, shape (C, K), int.
        vertex_count: Number of vertices.

    Returns:
        Colour of each constraint, shape (C,), int32, from 0.
    """
    used = [0] * vertex_count  # a bit per colour
    colours = np.empty(len(vertices), dtype=np.int32)
    for k, members in enumerate(vertices.tolist()):
        taken = 0
        for v in members:
            taken |= used[v]
        free = ~taken & (taken + 1)  # the lowest bit that is not taken
        for v in members:
            used[v] |= free
        colours[k] = free.bit_length() - 1
    return colours


def sort_by_colour(colours: np.ndarray) -> tuple[np.ndarray, tuple[int, ...]]:
    """Sort constraints by colour.

    Returns:
        Order of the constraints, shape (C,), and the first of each colour with the end of the last.
    """
    order = np.argsort(colours, kind="stable")
    starts = np.searchsorted(colours[order], np.arange(colours.max(initial=-1) + 2))
    return order, tuple(int(s) for s in starts)


def compute_adjacency(edges: np.ndarray, vertex_count: int) -> tuple[np.ndarray, np.ndarray]:
    """Compute the neighbours of each vertex as rows of one array.

    Returns:
        Start of each vertex' row, shape (V + 1,), int32, and the neighbours, shape (2 E,), int32.
    """
    both = np.concatenate([edges, edges[:, ::-1]])
    both = both[np.lexsort((both[:, 1], both[:, 0]))]
    start = np.zeros(vertex_count + 1, dtype=np.int32)
    np.add.at(start, both[:, 0] + 1, 1)
    return np.cumsum(start, dtype=np.int32), both[:, 1].astype(np.int32)


def compute_radii(rest: np.ndarray, edges: np.ndarray, thickness: float) -> np.ndarray:
    """Compute particle radii that let hardly any edge slip through the mesh.

    Two edges of length L that cross in their middles have their ends L / sqrt(2) apart, and the
    centre of a triangle is L / sqrt(3) from its corners. So unstretched edges of one length whose
    ends keep a distance of L / sqrt(2) cannot pass each other.

    Limitations: particles that share an edge are not kept apart, edges of different length need a
    little more than the sum of these radii, and edges stretch: near a bound, not a proof.

    Returns:
        Radius of each particle [m], shape (V,): half of the thickness [m], or more where its
        longest edge needs it.
    """
    lengths = np.linalg.norm(rest[edges[:, 0]] - rest[edges[:, 1]], axis=1)
    longest = np.zeros(len(rest))
    for k in (0, 1):
        np.maximum.at(longest, edges[:, k], lengths)
    return np.maximum(0.5 * thickness, 0.5 * longest / np.sqrt(2.0))


def find_close_wings(rest: np.ndarray, faces: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Find pairs of vertices opposite to an edge that touch where the mesh is flat.

    Vertices have a `radius` [m], shape (V,); the pairs have shape (N, 2), int32.
    """
    e0, e1, w0, w1 = compute_hinges(faces).T
    edge = rest[e1] - rest[e0]
    length = np.linalg.norm(edge, axis=1)
    along, height = [], []
    for wing in (w0, w1):
        arm = rest[wing] - rest[e0]
        along.append(np.sum(arm * edge, axis=1) / length)
        height.append(np.linalg.norm(np.cross(arm, edge), axis=1) / length)
    distance = np.hypot(along[0] - along[1], height[0] + height[1])
    is_close = distance < radius[w0] + radius[w1]
    return np.column_stack([w0, w1])[is_close].astype(np.int32)
