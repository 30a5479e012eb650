"""Quaternions wxyz as plain arrays."""

import numpy as np
from numpy.typing import ArrayLike


def normalize_quaternion(quaternion: ArrayLike) -> np.ndarray:
    """Scale a quaternion, shape (4,), to unit length; refuses one that is zero or not finite."""
    q = np.asarray(quaternion, dtype=float)
    norm = np.linalg.norm(q)
    if q.shape != (4,) or not np.isfinite(norm) or norm < 1e-6:
        raise ValueError(f"quaternion must be four finite numbers, not all zero; got {q}")
    return q / norm


def matrix_from_quaternion(quaternion: ArrayLike) -> np.ndarray:
    """Compute the rotation matrix, shape (3, 3), of a quaternion wxyz, shape (4,)."""
    w, x, y, z = normalize_quaternion(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_matrix(R: np.ndarray) -> np.ndarray:
    """Compute the unit quaternion wxyz with w >= 0, shape (4,), of a rotation matrix (3, 3)."""
    # Four candidates, each exact where its own component is large; the largest is taken.
    squares = np.array(
        [
            1 + R[0, 0] + R[1, 1] + R[2, 2],
            1 + R[0, 0] - R[1, 1] - R[2, 2],
            1 - R[0, 0] + R[1, 1] - R[2, 2],
            1 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )
    a, b, c = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    d, e, f = R[1, 0] + R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2]
    k = int(np.argmax(squares))
    rows = (
        (squares[0], a, b, c),
        (a, squares[1], d, e),
        (b, d, squares[2], f),
        (c, e, f, squares[3]),
    )
    q = normalize_quaternion(rows[k])
    return q if q[0] >= 0 else -q


def multiply_quaternions(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Compose two rotations wxyz, shape (4,): the result turns by `second`, then by `first`."""
    w, v = np.asarray(first, dtype=float)[0], np.asarray(first, dtype=float)[1:]
    s, u = np.asarray(second, dtype=float)[0], np.asarray(second, dtype=float)[1:]
    return np.concatenate([[w * s - v @ u], w * u + s * v + np.cross(v, u)])


def compute_rotation_angle(first: ArrayLike, second: ArrayLike) -> float:
    """Compute the angle [rad] in [0, pi] of the rotation between two orientations wxyz."""
    a, b = normalize_quaternion(first), normalize_quaternion(second)
    # From the chord: exact for small angles, where the arc cosine of the dot product is not.
    chord = min(np.linalg.norm(a - b), np.linalg.norm(a + b))
    return float(4 * np.arcsin(min(1.0, chord / 2)))


def slerp(start: ArrayLike, goal: ArrayLike, fraction: float) -> np.ndarray:
    """Interpolate orientations along the shorter great arc; `fraction` 0 is the start, 1 the goal."""
    a, b = normalize_quaternion(start), normalize_quaternion(goal)
    if np.dot(a, b) < 0:
        b = -b
    half = compute_rotation_angle(a, b) / 2
    if half < 1e-9:
        return b
    return (np.sin((1 - fraction) * half) * a + np.sin(fraction * half) * b) / np.sin(half)
