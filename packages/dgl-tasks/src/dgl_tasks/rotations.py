"""Quaternions wxyz, as they are at public boundaries, to and from SciPy's rotations."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def to_rotation(quaternion: ArrayLike) -> Rotation:
    """Make the rotation of a quaternion wxyz, shape (4,), of any finite length but zero."""
    q = np.asarray(quaternion, dtype=float)
    norm = np.linalg.norm(q)
    if q.shape != (4,) or not np.isfinite(norm) or norm < 1e-6:
        raise ValueError(f"quaternion must be four finite numbers, not all zero; got {q}")
    return Rotation.from_quat(q, scalar_first=True)


def to_quaternion(rotation: Rotation) -> np.ndarray:
    """Give unit quaternions wxyz with w >= 0, shape (4,), or (N, 4) of several rotations."""
    return rotation.as_quat(canonical=True, scalar_first=True)
