"""Affordance channels: the places on the garment where each hand should grasp."""

import numpy as np

__all__ = ["EPSILON", "compute_affordance"]

EPSILON = 1e-8  # Keeps a column of equal similarities finite. Source: original code.


def compute_affordance(similarity: np.ndarray) -> np.ndarray:
    """Scale the similarities of grasp points to channels in [0, 1].

    Args:
        similarity: Similarity of each grasp point to every point of the garment, shape (K, M).

    Returns:
        Channels, shape (M, K), float32: column k is row k minus its minimum, divided by its range
        plus 1e-8. The point that is most similar has (nearly) 1, the least similar 0. A row of
        equal values becomes zeros, since it prefers no point.

    Raises:
        ValueError: If the shape is not (K, M) with at least one point, or a value is not finite.

    Source:
        DexGarmentLab's code, points affordance feature.
    """
    values = np.asarray(similarity, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] < 1:
        raise ValueError(f"similarity must have shape (K, M) with M >= 1; got {values.shape}")
    if not np.isfinite(values).all():
        raise ValueError("similarity must be finite; got NaN or infinity")
    lowest = values.min(axis=1, keepdims=True)
    spread = values.max(axis=1, keepdims=True) - lowest
    return ((values - lowest) / (spread + EPSILON)).T.astype(np.float32)
