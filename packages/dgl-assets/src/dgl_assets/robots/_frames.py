"""Rotations and rigid transforms as plain arrays; quaternions are wxyz."""

import numpy as np
from scipy.spatial.transform import Rotation

AXIS_X, AXIS_Y, AXIS_Z = np.eye(3)


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Compute the rotation by `angle` [rad] about `axis`, shape (3,); result (3, 3)."""
    unit = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    return Rotation.from_rotvec(angle * unit).as_matrix()


def transform(
    xyz: np.ndarray | tuple[float, ...], rotation: np.ndarray | None = None
) -> np.ndarray:
    """Make a homogeneous matrix, shape (4, 4), from a translation [m] and a rotation (3, 3)."""
    T = np.eye(4)
    T[:3, 3] = xyz
    if rotation is not None:
        T[:3, :3] = rotation
    return T


def rpy_from_rotation(R: np.ndarray) -> tuple[float, float, float]:
    """Compute URDF roll, pitch, yaw [rad] (R = Rz(yaw) Ry(pitch) Rx(roll)) of a rotation (3, 3)."""
    pitch = float(np.arctan2(-R[2, 0], np.hypot(R[0, 0], R[1, 0])))
    if np.hypot(R[0, 0], R[1, 0]) > 1e-9:
        return float(np.arctan2(R[2, 1], R[2, 2])), pitch, float(np.arctan2(R[1, 0], R[0, 0]))
    # Gimbal lock: only roll minus (or plus) yaw is defined; put all of it into roll.
    return float(np.arctan2(-R[1, 2], R[1, 1])), pitch, 0.0


def quaternion_from_rotation(R: np.ndarray) -> np.ndarray:
    """Compute the unit quaternion wxyz, w >= 0, shape (4,), of a rotation (3, 3)."""
    return Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True)


def rotation_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Compute the rotation (3, 3) of a quaternion wxyz, shape (4,); it is normalised first."""
    return Rotation.from_quat(np.asarray(quaternion, dtype=float), scalar_first=True).as_matrix()
