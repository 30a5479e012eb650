"""Dense correspondence from key points by a thin-plate spline."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["Template", "register"]

STIFFNESS = 0.2

Carry = Callable[[np.ndarray], np.ndarray]
"""A map of the plane, shape (M, 2) to (M, 2)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """Template onto which garments are carried."""

    cloud: np.ndarray
    """Its points from above [m], shape (N, 2)."""
    keys: np.ndarray
    """Its key points from above [m], shape (K, 2)."""

    @property
    def diagonal(self) -> float:
        """Diagonal of its bounding box [m]."""
        return float(np.linalg.norm(np.ptp(self.cloud, axis=0)))


def register(
    template: Template, keys: np.ndarray, places: np.ndarray, *, stiffness: float = STIFFNESS
) -> np.ndarray:
    """Find where places of a garment are on the template.

    Args:
        template: The template.
        keys: The garment's key points, in the order of the template's, shape (K, 2) [m].
        places: Places on the garment, shape (M, 2) [m].
        stiffness: Of the thin plate: 0 meets the key points, more smooths over their errors.

    Returns:
        Shape (M, 2) [m], on the template.

    Raises:
        ValueError: If the numbers of key points differ.

    Limitations:
        Only the key points count, not the outline. Moving the places on until the clouds cover each
        other was tried, and made the correspondence worse: what is nearest is not the same place.
    """
    if keys.shape != template.keys.shape:
        raise ValueError(f"keys must have shape {template.keys.shape}; got {keys.shape}")
    return _fit_thin_plate(keys, template.keys, stiffness)(places)


def _fit_thin_plate(source: np.ndarray, target: np.ndarray, stiffness: float) -> Carry:
    """Fit a map of the plane by a thin plate: affine far away, bent near the points."""
    scale = np.linalg.norm(np.ptp(source, axis=0)) + 1e-12
    centre = source.mean(axis=0)
    knots = (source - centre) / scale
    count = len(knots)

    def kernel(places: np.ndarray) -> np.ndarray:
        squared = ((places[:, None] - knots[None]) ** 2).sum(axis=2)
        return squared * np.log(squared + 1e-12)

    linear = np.c_[np.ones(count), knots]
    system = np.zeros((count + 3, count + 3))
    system[:count, :count] = kernel(knots) + stiffness * np.eye(count)
    system[:count, count:] = linear
    system[count:, :count] = linear.T
    weights = np.linalg.lstsq(system, np.r_[target, np.zeros((3, 2))], rcond=None)[0]

    def carry(places: np.ndarray) -> np.ndarray:
        normal = (places - centre) / scale
        return (
            kernel(normal) @ weights[:count] + np.c_[np.ones(len(normal)), normal] @ weights[count:]
        )

    return carry
