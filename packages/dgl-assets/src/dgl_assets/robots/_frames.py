"""Rotations and rigid transforms as plain arrays (matrices inside, wxyz quaternions at the edge)."""

import numpy as np

AXIS_X, AXIS_Y, AXIS_Z = np.eye(3)


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Compute the rotation by `angle` [rad] about `axis`, shape (3,); result (3, 3)."""
    x, y, z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * (K @ K)


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
    # The eigenvector form has no branches and no loss of precision near half turns.
    xx, xy, xz, yx, yy, yz, zx, zy, zz = R.ravel()
    K = np.array(
        [
            [xx + yy + zz, zy - yz, xz - zx, yx - xy],
            [zy - yz, xx - yy - zz, xy + yx, xz + zx],
            [xz - zx, xy + yx, yy - xx - zz, yz + zy],
            [yx - xy, xz + zx, yz + zy, zz - xx - yy],
        ]
    )
    q = np.linalg.eigh(K)[1][:, -1]
    return q if q[0] >= 0 else -q


def rotation_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    """Compute the rotation (3, 3) of a quaternion wxyz, shape (4,); it is normalised first."""
    w, x, y, z = np.asarray(quaternion, dtype=float) / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
