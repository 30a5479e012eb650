"""The generator's exact correspondence behind the matcher interface of `dgl_gam`."""

import numpy as np
from scipy.spatial import cKDTree

from dgl_assets import Garment, correspond


class ExactMatcher:
    """Finds the same places on another garment of the category, for simulated garments.

    It knows both garments' meshes and where the target's particles are, so it is a stand-in that
    an observed cloud alone does not allow; `dgl_gam` learns the same map from clouds.

    Implements `dgl_gam.Matcher`.
    """

    SIMILARITY_SCALE = 0.08
    """Distance on the garment at which the similarity has fallen to exp(-1/2) [m]."""

    def __init__(self, source: Garment, target: Garment, target_particles: np.ndarray) -> None:
        """Prepare the map for one state of the target.

        Args:
            source: Garment that the points are given on, lying flat.
            target: Garment to find them on.
            target_particles: Present positions of its vertices [m], shape (V, 3), world frame.
        """
        if target_particles.shape != target.vertices.shape:
            raise ValueError(
                f"target_particles must have shape {target.vertices.shape}; "
                f"got {target_particles.shape}"
            )
        self._source, self._target = source, target
        self._tree = cKDTree(target_particles)

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find points of the source in a cloud of the target.

        Args:
            source_cloud: Not needed here; the source garment is known. Shape (N, 3).
            source_points: Places on the source lying flat [m], shape (K, 3), garment frame.
            target_cloud: Observed points of the target [m], shape (M, 3), world frame.

        Returns:
            Index of the best cloud point, shape (K,), int64, and the similarity of every cloud
            point in (0, 1], shape (K, M), float32.
        """
        del source_cloud
        places = correspond(self._source, np.asarray(source_points, np.float64), self._target)
        # each observed point is where its nearest particle is on the flat garment
        nearest = self._tree.query(np.asarray(target_cloud))[1]
        flat = self._target.vertices[nearest].astype(np.float64)  # (M, 3)
        distance = np.linalg.norm(flat[None] - places[:, None], axis=2)  # (K, M)
        similarity = np.exp(-0.5 * (distance / self.SIMILARITY_SCALE) ** 2)
        return distance.argmin(axis=1), similarity.astype(np.float32)
