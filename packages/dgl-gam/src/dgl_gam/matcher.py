"""The contract between what finds corresponding points and what uses them."""

from typing import Protocol, runtime_checkable

import numpy as np

__all__ = ["Matcher"]


@runtime_checkable
class Matcher(Protocol):
    """Finds, on one garment, the points that correspond to given points of another.

    Anything with this method is a matcher: a trained model, a rule, or a table of exact
    correspondences. Its users take it as an argument, and exchange arrays with it.
    """

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the corresponding points.

        Args:
            source_cloud: Visible points of the garment of the demonstration [m], shape (N, 3),
                world frame.
            source_points: Points on that garment [m], shape (K, 3), world frame. They need not be
                in the cloud: the nearest of its points stands for each.
            target_cloud: Visible points of the observed garment [m], shape (M, 3), world frame.

        Returns:
            Indices into `target_cloud`, shape (K,), int64, and similarities in [-1, 1] of each
            source point to every target point, shape (K, M). The index of a row is where its
            similarity is largest.

        Limitations:
            A match is always returned, even for a point that is hidden on the observed garment; a
            low largest similarity is the only sign of it.

        Source:
            DexGarmentLab, Garment Affordance Model: arg max of the cosine similarity of features.
        """
        ...
