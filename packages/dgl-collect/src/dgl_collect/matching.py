"""Matchers of attempts: the exact correspondence of generated garments, and the learned one."""

from collections.abc import Callable
from typing import TYPE_CHECKING, get_args

import numpy as np
from scipy.spatial import cKDTree  # pyright: ignore[reportAttributeAccessIssue] - compiled

from dgl_assets import Garment, correspond
from dgl_assets.importing import AnyGarment, ImportedGarment
from dgl_collect.options import MatcherName
from dgl_gam import GarmentAffordanceModel, Matcher

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv

FindMatcher = Callable[["GarmentEnv"], Matcher]
"""Function that makes the matcher for the present garment of an environment."""


def make_find_matcher(name: str, demo_garment: Garment) -> FindMatcher:
    """Prepare a matcher for garments of a demonstration's category.

    Args:
        name: One of `MatcherName`.
        demo_garment: Garment that the demonstration's points are given on.

    Raises:
        ValueError: If there is no such matcher.
        GamError: If the model of the category cannot be loaded.
    """
    if name == "exact":
        return lambda env: ExactMatcher(demo_garment, env.garment, env.get_particles())
    if name == "gam":
        model = GarmentAffordanceModel.load(demo_garment.category)
        return lambda env: model
    raise ValueError(f"matcher must be one of {list(get_args(MatcherName))}; got {name!r}")


class ExactMatcher:
    """Finds the same points on another simulated garment of the category.

    It uses both garments' meshes and the target's particles, which no camera sees; `dgl_gam` learns
    the same map from clouds.

    Implements `dgl_gam.Matcher`.
    """

    SIMILARITY_SCALE = 0.08
    """Distance on the garment at which the similarity has fallen to exp(-1/2) [m]."""

    def __init__(self, source: Garment, target: AnyGarment, target_particles: np.ndarray) -> None:
        """Prepare the map for one state of the target.

        Args:
            source: Garment that the points are given on, lying flat.
            target: Garment to find them on.
            target_particles: Present positions of its vertices [m], shape (V, 3), world frame.
        """
        if isinstance(target, ImportedGarment):
            raise ValueError(
                f"matcher exact knows garments of the catalogue only; take matcher gam for "
                f"{target.name}"
            )
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
            source_cloud: Not used. Shape (N, 3).
            source_points: Points on the source lying flat [m], shape (K, 3), garment frame.
            target_cloud: Observed points of the target [m], shape (M, 3), world frame.

        Returns:
            Index of the best cloud point, shape (K,), int64, and the similarity of every cloud
            point in (0, 1], shape (K, M), float32.
        """
        del source_cloud
        known = correspond(self._source, np.asarray(source_points, np.float64), self._target)
        # position of each observed point on the flat garment: that of its nearest particle
        nearest = self._tree.query(np.asarray(target_cloud))[1]
        flat = self._target.vertices[nearest].astype(np.float64)  # (M, 3)
        distance = np.linalg.norm(flat[None] - known[:, None], axis=2)  # (K, M)
        similarity = np.exp(-0.5 * (distance / self.SIMILARITY_SCALE) ** 2)
        return distance.argmin(axis=1), similarity.astype(np.float32)
