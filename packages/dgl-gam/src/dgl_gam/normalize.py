"""The normal form of a garment's cloud: centred, and as large as the square [-1, 1]²."""

from dataclasses import dataclass

import numpy as np

from dgl_gam._arrays import check_cloud

__all__ = ["Normalization", "normalize_cloud"]

MIN_EXTENT_M = 1e-9


@dataclass(frozen=True, kw_only=True)
class Normalization:
    """Map into normal form: `(points - centre) * scale`."""

    centre: np.ndarray
    """Mean of the cloud [m], shape (3,), world frame."""
    scale: float
    """Normalised units per metre [1/m], positive."""

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Map points [m], shape (N, 3), from the world frame to the normalised one."""
        return (check_cloud(points, "points", min_points=0) - self.centre) * self.scale

    def invert(self, points: np.ndarray) -> np.ndarray:
        """Map normalised points, shape (N, 3), back to the world frame [m]."""
        return check_cloud(points, "points", min_points=0) / self.scale + self.centre


def normalize_cloud(cloud: np.ndarray) -> tuple[np.ndarray, Normalization]:
    """Normalise a garment's cloud for position and size.

    Args:
        cloud: Points [m], shape (N, 3), world frame.

    Returns:
        The points minus their mean, times min(2 / extent_x, 2 / extent_y), shape (N, 3), and the
        map that did it.

    Raises:
        ValueError: If the cloud has no extent in x and y, or is not a finite cloud of at least one
            point.

    Limitations:
        The height does not enter into the scale: a crumpled garment is scaled as its outline seen
        from above. The mean depends on how densely each part was sampled. Rotation is not removed.

    Source:
        The normalisation of DexGarmentLab's code; the paper asks for invariance to translation and
        scale.
    """
    points = check_cloud(cloud, "cloud")
    extent = np.ptp(points[:, :2], axis=0)
    largest = float(extent.max())
    if largest < MIN_EXTENT_M:
        raise ValueError(
            f"cloud must have an extent in x or y above {MIN_EXTENT_M} m; got {extent[0]} and "
            f"{extent[1]} m"
        )
    normalization = Normalization(centre=points.mean(axis=0), scale=2.0 / largest)
    return normalization.apply(points), normalization
