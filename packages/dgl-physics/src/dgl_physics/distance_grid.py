"""Signed distances of a mesh on a grid, fine near the surface and coarse elsewhere."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_physics._kernels import sampling
from dgl_physics._kernels.distance import BLOCK
from dgl_physics.errors import MeshError
from dgl_physics.quiet import quiet_warp

FINE_NODES = (BLOCK + 1) ** 3
"""Nodes of a fine block."""
_FINEST, _COARSEST = 5e-4, 2.5e-3
"""Bounds of the spacing where memory allows [m]; the usual rest offset of 4 mm is two cells."""
_CELLS_ACROSS = 4
_DEPTH = 2
"""Depth under the surface down to which the grid is fine [cells]."""
_GROWTH = 1.15


@dataclass(frozen=True, eq=False)
class DistanceGrid:
    """Two levels: coarse nodes everywhere, and blocks of fine nodes near the surface."""

    lower: np.ndarray
    """Lowest corner [m], shape (3,)."""
    spacing: float
    """Side of a fine cell [m]; of a coarse one it is four times that."""
    reach: float
    """Distance from the surface up to which there are fine cells [m]."""
    coarse: np.ndarray
    """Signed distances [m], shape (X + 1, Y + 1, Z + 1) for X x Y x Z blocks."""
    fine_index: np.ndarray
    """Index of each block's fine block, -1 for none; shape (X, Y, Z), int32."""
    fine: np.ndarray
    """Signed distances [m], shape (N, 5, 5, 5); the nodes of a side are those of its neighbour."""

    @property
    def node_count(self) -> int:
        """Number of nodes of both levels and of blocks, 4 bytes each."""
        return self.coarse.size + self.fine_index.size + self.fine.size


@quiet_warp()
def build_distance_grid(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    is_sheet: bool,
    spacing: float | None,
    reach: float,
    max_nodes: int,
) -> DistanceGrid:
    """Build the grid on the CPU, so that it is the same for all devices.

    The nodes hold exact distances. The sign is that of the winding number, so closed parts may
    overlap.

    Args:
        vertices: [m], shape (V, 3).
        faces: Shape (F, 3), int32.
        is_sheet: Distances have no sign.
        spacing: Side of a fine cell [m]; chosen when None.
        reach: Distance up to which cells are fine [m].
        max_nodes: Bound on `DistanceGrid.node_count`.

    Raises:
        MeshError: If a given spacing needs more nodes than that.
    """
    mesh = wp.Mesh(
        points=wp.array(vertices, dtype=wp.vec3, device="cpu"),
        indices=wp.array(faces.reshape(-1), dtype=wp.int32, device="cpu"),
        support_winding_number=True,
    )
    step = spacing or _choose_spacing(vertices, faces, reach, max_nodes)
    while True:
        lower, shape = _lay_out(vertices, step, reach)
        needed = np.prod(shape + 1) + np.prod(shape)
        if needed <= max_nodes:
            fine_blocks = _find_fine_blocks(mesh, lower, shape, step, reach, is_sheet=is_sheet)
            needed += len(fine_blocks) * FINE_NODES
            if needed <= max_nodes:
                break
        if spacing is not None:
            raise MeshError(
                f"a grid of spacing {spacing} m needs {needed} nodes, more than max_nodes "
                f"({max_nodes})"
            )
        step *= _GROWTH
    width = BLOCK * step
    coarse = _sample(mesh, lower[None], shape + 1, width, is_sheet=is_sheet)[0]
    fine_index = np.full(shape, -1, dtype=np.int32)
    fine_index[tuple(fine_blocks.T)] = np.arange(len(fine_blocks))
    nodes = np.full(3, BLOCK + 1)
    fine = _sample(mesh, lower + width * fine_blocks, nodes, step, is_sheet=is_sheet)
    return DistanceGrid(
        lower=lower, spacing=step, reach=reach, coarse=coarse, fine_index=fine_index, fine=fine
    )


def _choose_spacing(vertices: np.ndarray, faces: np.ndarray, reach: float, max_nodes: int) -> float:
    """Choose a spacing by the mesh's size that will probably fit."""
    extent = np.ptp(vertices, axis=0)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    step = float(np.clip(extent.min() / _CELLS_ACROSS, _FINEST, _COARSEST))
    while True:
        width = BLOCK * step
        # a shell of reach and depth, and the blocks that it cuts
        layers = (reach + _DEPTH * step) / width + 1.5
        fine = area / width**2 * layers * FINE_NODES
        coarse = 2 * np.prod((extent + 2 * (reach + step)) / width + 1)
        if fine + coarse <= max_nodes:
            return step
        step *= _GROWTH


def _lay_out(vertices: np.ndarray, step: float, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute lower corner [m] and number of blocks of a box with `reach` around the mesh."""
    margin = reach + step  # more than reach, against rounding
    low, high = vertices.min(axis=0) - margin, vertices.max(axis=0) + margin
    shape = np.ceil((high - low) / (BLOCK * step)).astype(np.int64)
    return 0.5 * (low + high - shape * BLOCK * step), shape


def _find_fine_blocks(
    mesh: wp.Mesh,
    lower: np.ndarray,
    shape: np.ndarray,
    step: float,
    reach: float,
    *,
    is_sheet: bool,
) -> np.ndarray:
    """Find the blocks with points nearer to the surface than `reach`, shape (N, 3)."""
    width = BLOCK * step
    centre = _sample(mesh, (lower + 0.5 * width)[None], shape, width, is_sheet=is_sheet)[0]
    half_diagonal = 0.5 * np.sqrt(3) * width
    return np.argwhere((centre < reach + half_diagonal) & (centre > -_DEPTH * step - half_diagonal))


def _sample(
    mesh: wp.Mesh, lower: np.ndarray, nodes: np.ndarray, step: float, *, is_sheet: bool
) -> np.ndarray:
    """Sample signed distances [m] at the nodes of boxes, shape (len(lower), *nodes)."""
    value = wp.zeros(len(lower) * int(np.prod(nodes)), dtype=wp.float32, device="cpu")
    wp.launch(
        sampling.sample_boxes,
        dim=len(lower),
        inputs=[
            mesh.id, wp.array(lower, dtype=wp.vec3, device="cpu"), wp.vec3i(*nodes.tolist()),
            step, int(is_sheet), value,
        ],
        device="cpu",
    )  # fmt: skip
    return value.numpy().reshape(len(lower), *nodes)
