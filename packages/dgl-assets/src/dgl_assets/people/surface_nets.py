"""The surface of blended solids as even quadrilaterals, cut into triangles.

Surface nets: one vertex in each cell of a grid that the surface passes, one quadrilateral around
each grid edge that it crosses. Unlike marching cubes they give no slivers. The grid is rectilinear,
so that hands and face can be finer, and bent, so that it follows the arms.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dgl_assets.errors import MeshingError
from dgl_assets.people.solids import Blend, blend

_FAR = 1.0  # distance where no solid is near [m]
_PROJECTIONS = 4
_SEPARATIONS = 20
_BARELY_OUTSIDE = 1e-4  # [m]

Warp = Callable[[np.ndarray], np.ndarray]


def evaluate_on_grid(
    body: Blend, axes: tuple[np.ndarray, np.ndarray, np.ndarray], unbend: Warp
) -> np.ndarray:
    """Compute the distance of grid nodes from a body.

    Args:
        body: Solids.
        axes: Coordinates of the nodes along each axis [m], shapes (X,), (Y,), (Z,).
        unbend: From grid coordinates to the person frame, shape (..., 3) both; shifts z only.

    Returns:
        Distances [m], shape (X, Y, Z); `_FAR` where nothing is near.
    """
    return _evaluate(body, unbend(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)))


def _evaluate(body: Blend, points: np.ndarray) -> np.ndarray:
    result = np.full(points.shape[:3], _FAR)
    for child in body.parts:
        box = _find_box(points, *child.bounds(), margin=body.radius + 0.03)
        inner = points[box]
        sub = _evaluate(child, inner) if isinstance(child, Blend) else child.distance(inner)
        result[box] = blend(result[box], sub, body.radius)
    return result


def _find_box(
    points: np.ndarray, low: np.ndarray, high: np.ndarray, *, margin: float
) -> tuple[slice, ...]:
    inside = np.all((points > low - margin) & (points < high + margin), axis=-1)
    slices = []
    for axis in range(3):
        layers = np.moveaxis(np.asarray(inside), axis, 0).reshape(points.shape[axis], -1)
        used = np.flatnonzero(layers.any(axis=1))
        slices.append(slice(int(used[0]), int(used[-1]) + 1) if len(used) else slice(0, 0))
    return tuple(slices)


def separate(values: np.ndarray) -> np.ndarray:
    """Separate two sheets of the surface that would meet in one cell.

    The shallower of two inside nodes becomes an outside one where they are opposite corners of a
    cell's face or of a cell and all other corners are outside.

    Args:
        values: At the nodes of a grid, negative inside, shape (X, Y, Z).

    Returns:
        Values of a surface that is a manifold, shape (X, Y, Z).

    Raises:
        MeshingError: If sheets still meet after `_SEPARATIONS` rounds.
    """
    values = values.copy()
    wrong = _find_ambiguous(values)
    for _ in range(_SEPARATIONS):
        if not len(wrong):
            return values
        values[tuple(wrong.T)] = _BARELY_OUTSIDE
        wrong = _find_ambiguous(values)
    raise MeshingError(f"{len(wrong)} cells of the grid still hold two sheets of the surface")


def _find_ambiguous(values: np.ndarray) -> np.ndarray:
    """Nodes to change, shape (N, 3)."""
    found = []
    inside = values < 0
    corners = [np.array(c) for c in np.ndindex(2, 2, 2)]
    size = np.array(values.shape) - 1

    def at(corner: np.ndarray, array: np.ndarray) -> np.ndarray:
        return array[tuple(slice(c, c + n) for c, n in zip(corner, size, strict=True))]

    for axis in range(3):
        u, v = np.eye(3, dtype=int)[[k for k in range(3) if k != axis]]
        a, b, c, d = (at(corner, inside) for corner in (0 * u, u + v, u, v))
        for first, second, is_wrong in (
            (0 * u, u + v, a & b & ~c & ~d),
            (u, v, c & d & ~a & ~b),
        ):
            found += _pick_shallow(values, np.argwhere(is_wrong), first, second)
    count = sum(at(corner, inside).astype(int) for corner in corners)
    for corner in corners[:4]:
        other = 1 - corner
        two = (count == 2) & at(corner, inside) & at(other, inside)
        found += _pick_shallow(values, np.argwhere(two), corner, other)
        six = np.argwhere((count == 6) & ~at(corner, inside) & ~at(other, inside))
        if len(six):  # open the cell from one outside corner to the other
            found.append(six + np.array([corner[0], corner[1], other[2]]))
    return np.unique(np.concatenate(found), axis=0) if found else np.zeros((0, 3), dtype=int)


def _pick_shallow(
    values: np.ndarray, cells: np.ndarray, first: np.ndarray, second: np.ndarray
) -> list[np.ndarray]:
    if not len(cells):
        return []
    a, b = cells + first, cells + second
    is_first = values[tuple(a.T)] > values[tuple(b.T)]
    return [np.where(is_first[:, None], a, b)]


def extract_surface(
    values: np.ndarray, axes: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Find the surface where values change their sign.

    Args:
        values: At the nodes of a grid, negative inside, shape (X, Y, Z); positive at its border.
        axes: Coordinates of the nodes along each axis.

    Returns:
        Vertices in grid coordinates, shape (V, 3), and triangles, counter-clockwise from outside,
        shape (F, 3), int32.

    Raises:
        MeshingError: If the surface leaves the grid.
    """
    inside = values < 0
    for axis in range(3):
        if np.take(inside, [0, -1], axis=axis).any():
            raise MeshingError(f"the surface leaves the grid along axis {axis}")
    cells = tuple(n - 1 for n in values.shape)
    total = np.zeros((*cells, 3))
    count = np.zeros(cells)
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(0, -1), slice(1, None)
        a, b = values[tuple(low)], values[tuple(high)]
        crossed = (a < 0) != (b < 0)
        share = np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0)
        others = [k for k in range(3) if k != axis]
        for first, second in np.ndindex(2, 2):
            pick: list[slice] = [slice(None)] * 3
            pick[others[0]] = slice(first, values.shape[others[0]] - 1 + first)
            pick[others[1]] = slice(second, values.shape[others[1]] - 1 + second)
            hit = crossed[tuple(pick)]
            count += hit
            total[..., axis] += np.where(hit, share[tuple(pick)], 0.0)
            total[..., others[0]] += first * hit
            total[..., others[1]] += second * hit
    ids = np.full(cells, -1)
    used = np.argwhere(count > 0)
    ids[tuple(used.T)] = np.arange(len(used))
    share = total[tuple(used.T)] / count[tuple(used.T)][:, None]
    vertices = np.empty((len(used), 3))
    for axis in range(3):
        start, end = axes[axis][used[:, axis]], axes[axis][used[:, axis] + 1]
        vertices[:, axis] = start + share[:, axis] * (end - start)
    faces = [_make_faces(inside, ids, axis) for axis in range(3)]
    return vertices, np.concatenate(faces).astype(np.int32)


def _make_faces(inside: np.ndarray, ids: np.ndarray, axis: int) -> np.ndarray:
    """Two triangles around each crossed edge along one axis, shape (F, 3)."""
    low = [slice(1, -1)] * 3
    high = [slice(1, -1)] * 3
    low[axis], high[axis] = slice(0, -1), slice(1, None)
    a, b = inside[tuple(low)], inside[tuple(high)]
    first, second = (axis + 1) % 3, (axis + 2) % 3
    faces = []
    for leaving in (True, False):
        edge = np.argwhere((a & ~b) if leaving else (~a & b))
        for k in range(3):
            edge[:, k] += 0 if k == axis else 1
        corners = []
        for i, j in ((0, 0), (-1, 0), (-1, -1), (0, -1)):
            cell = edge.copy()
            cell[:, first] += i
            cell[:, second] += j
            corners.append(ids[tuple(cell.T)])
        quad = np.stack(corners, axis=1)
        if not leaving:
            quad = quad[:, ::-1]
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return np.concatenate(faces)


def project(body: Blend, vertices: np.ndarray, *, step: float) -> np.ndarray:
    """Move vertices onto the surface of a body along its gradient.

    Args:
        body: Solids.
        vertices: Near its surface [m], shape (V, 3), person frame.
        step: Distance over which gradients are measured, and half of the largest move [m].

    Returns:
        Positions [m], shape (V, 3).
    """
    points = vertices.copy()
    for _ in range(_PROJECTIONS):
        value = distance_to(body, points)
        gradient = np.stack(
            [
                distance_to(body, points + step * axis) - distance_to(body, points - step * axis)
                for axis in np.eye(3)
            ],
            axis=1,
        ) / (2 * step)
        size = np.maximum((gradient**2).sum(axis=1, keepdims=True), 0.1)
        move = -value[:, None] * gradient / size
        length = np.linalg.norm(move, axis=1, keepdims=True)
        points += move * np.minimum(1.0, step / np.maximum(length, 1e-12))
    return points


def distance_to(body: Blend, points: np.ndarray) -> np.ndarray:
    """Distances of points [m], shape (N, 3), from a body [m], shape (N,); exact near it."""
    result = np.full(len(points), _FAR)
    for part in body.parts:
        low, high = part.bounds()
        near = ((points > low - 0.12) & (points < high + 0.12)).all(axis=1)
        if not near.any():
            continue
        own = points[near]
        value = distance_to(part, own) if isinstance(part, Blend) else part.distance(own)
        result[near] = blend(result[near], value, body.radius)
    return result
