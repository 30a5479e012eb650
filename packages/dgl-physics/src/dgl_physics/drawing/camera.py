"""Pinhole cameras."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["Axes", "PinholeCamera", "Vector3"]

Vector3 = tuple[float, float, float]
Axes = tuple[Vector3, Vector3, Vector3]


@dataclass(frozen=True, kw_only=True)
class PinholeCamera:
    """A fixed pinhole camera with square pixels and a centred optical axis."""

    position: Vector3
    """Optical centre [m], world frame."""
    axes: Axes
    """Unit vectors to the right, down and forward in the picture, world frame."""
    width: int = 640
    """Picture width [pixels]."""
    height: int = 480
    """Picture height [pixels]."""
    horizontal_fov: float
    """Horizontal field of view [rad], in (0, pi)."""
    near: float = 0.1
    """Near plane [m]."""
    far: float = 30.0
    """Far plane [m]."""

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ValueError(f"width and height must be positive; got {self.width}x{self.height}")
        if not 0.0 < self.horizontal_fov < np.pi:
            raise ValueError(f"horizontal_fov must lie in (0, pi); got {self.horizontal_fov}")
        if not 0.0 < self.near < self.far:
            raise ValueError(f"0 < near < far must hold; got near {self.near}, far {self.far}")

    @classmethod
    def aim(
        cls,
        middle: ArrayLike,
        towards: ArrayLike,
        right: ArrayLike,
        *,
        distance: float,
        half_width: float,
        size: tuple[int, int],
    ) -> PinholeCamera:
        """Aim a camera at a point.

        Args:
            middle: Point in the middle of the picture [m], shape (3,), world frame.
            towards: Direction from there to the camera, of any length, shape (3,).
            right: Direction to the right in the picture, perpendicular to `towards`, of any
                length, shape (3,).
            distance: Of the camera from the point [m]; large for a nearly parallel view.
            half_width: Half of the width that the picture shows at that distance [m].
            size: Width and height of the picture [pixels].

        Returns:
            A camera that sees from half of the distance to twice as far.
        """
        forward, across = (np.divide(v, np.linalg.norm(v)) for v in (np.negative(towards), right))
        return cls(
            position=_to_vector(np.subtract(middle, distance * forward)),
            axes=(_to_vector(across), _to_vector(np.cross(forward, across)), _to_vector(forward)),
            width=size[0],
            height=size[1],
            horizontal_fov=float(2 * np.arctan(half_width / distance)),
            near=distance / 2,
            far=2 * distance,
        )

    @property
    def vertical_fov(self) -> float:
        """Vertical field of view [rad]."""
        return float(2 * np.arctan(np.tan(self.horizontal_fov / 2) * self.height / self.width))

    @property
    def intrinsics(self) -> np.ndarray:
        """Pinhole matrix [pixels], shape (3, 3), OpenCV convention."""
        f = self.width / 2 / np.tan(self.horizontal_fov / 2)
        return np.array([[f, 0, self.width / 2], [0, f, self.height / 2], [0, 0, 1.0]])

    @property
    def transform_camera_to_world(self) -> np.ndarray:
        """Pose of the OpenCV frame (x right, y down, z forward) in the world, shape (4, 4)."""
        T = np.eye(4)
        T[:3, :3] = np.array(self.axes).T
        T[:3, 3] = self.position
        return T

    def project(self, points: np.ndarray) -> np.ndarray:
        """Project points into the picture.

        Args:
            points: [m], shape (N, 3), world frame, in front of the camera.

        Returns:
            Columns, rows [pixels] and depths along the optical axis [m], shape (N, 3); the centre
            of the first pixel is (0.5, 0.5).
        """
        seen = (points - np.array(self.position)) @ np.array(self.axes).T @ self.intrinsics.T
        return np.column_stack([seen[:, :2] / seen[:, 2:], seen[:, 2]])

    def compute_rays(self) -> np.ndarray:
        """Compute rays through the pixels, of depth 1, shape (H, W, 3), world frame."""
        (f, _, cx), (_, _, cy), _ = self.intrinsics
        x = (np.arange(self.width) + 0.5 - cx) / f
        y = (np.arange(self.height) + 0.5 - cy) / f
        right, down, forward = np.array(self.axes)
        return x[None, :, None] * right + y[:, None, None] * down + forward


def _to_vector(values: np.ndarray) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z
