"""Measures of cloth as functions of arrays: strain and intersections."""

# pyright: reportArgumentType=false
import numpy as np
import warp as wp

from dgl_physics._kernels import measure as kernels
from dgl_physics.quiet import quiet_warp
from dgl_physics.topology import check_arrays, compute_edges

__all__ = ["compute_strain", "find_intersections"]


def compute_strain(
    positions: np.ndarray, edges: np.ndarray, rest_lengths: np.ndarray
) -> np.ndarray:
    """Compute the relative change of length of each edge.

    Args:
        positions: [m], shape (V, 3).
        edges: Vertex indices, shape (E, 2); `GarmentParticles.edges` of a model.
        rest_lengths: [m], shape (E,); `GarmentParticles.rest_lengths`.

    Returns:
        Shape (E,): positive where stretched, negative where compressed.
    """
    ends = np.asarray(positions, dtype=np.float32)[np.asarray(edges)].astype(np.float64)
    return np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / np.asarray(rest_lengths) - 1.0


@quiet_warp()
def find_intersections(
    positions: np.ndarray, faces: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Find the self-intersections of a mesh: edges that pierce triangles.

    Each candidate is decided by the signs of five tetrahedra's volumes in double precision, without
    a tolerance. Two triangles that cross have an edge of one through the other, so a count of 0
    means that no layer is caught in another.

    Args:
        positions: [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3). Several garments may be joined into one mesh.
        device: Warp device.

    Returns:
        Rows (vertex, vertex, face), the edge's ends in ascending order and the triangle that it
        pierces, shape (N, 3), int32, sorted. An edge and a triangle that share a vertex are
        neighbours and do not count.

    Limitations:
        Touching, with a volume of exactly zero, is no intersection. Layers that have passed through
        each other completely show only where a seam or fold joins them.
    """
    positions, faces = np.asarray(positions), np.asarray(faces)
    check_arrays(positions, faces, "faces", 3)
    positions, faces = positions.astype(np.float32), faces.astype(np.int32)
    edges = compute_edges(faces)
    with wp.ScopedDevice(device):
        points = wp.array(positions, dtype=wp.vec3)
        mesh = wp.Mesh(points=points, indices=wp.array(faces.ravel(), dtype=wp.int32))
        edge_array, face_array = wp.array(edges, dtype=wp.vec2i), wp.array(faces, dtype=wp.vec3i)
        capacity = 4 * len(edges)
        while True:
            count = wp.zeros(1, dtype=wp.int32)
            found = wp.zeros(capacity, dtype=wp.vec3i)
            wp.launch(
                kernels.find_crossings,
                dim=len(edges),
                inputs=[mesh.id, edge_array, face_array, points, capacity, count, found],
            )
            n = int(count.numpy()[0])
            if n <= capacity:
                break
            capacity = n
        rows = found.numpy()[:n]
    return rows[np.lexsort(rows.T[::-1])].astype(np.int32)
