"""The belief about the scene, from the cameras; it never decides the verdict."""

from collections.abc import Mapping
from functools import cached_property
from types import MappingProxyType

import numpy as np

from dgl_tasks.errors import PerceptionError
from dgl_tasks.sensing import Sensed
from dgl_tasks.success import AREA_CELL

_PER_AREA, _PER_VOLUME = 0.51, 33.0
# Flat area by covered area, and by the volume below the seen surface [1/m]: a least-squares fit to
# flings of tops, dresses and trousers of the training split. Flat cloth is 15 mm high, folded cloth
# higher.


class BelievedView:
    """The believed scene; implements `dgl_tasks.success.SceneView`."""

    def __init__(self, sensed: Sensed, *, landmarks: Mapping[str, np.ndarray]) -> None:
        """Build the view.

        Args:
            sensed: The present snapshot.
            landmarks: Points of the demonstration, found before the garment was touched [m], shape
                (3,).
        """
        self._sensed, self.landmarks = sensed, landmarks

    @cached_property
    def top(self) -> np.ndarray:
        """Points seen by the garment camera [m], shape (N, 3)."""
        return self._see("garment_camera")

    @cached_property
    def surface(self) -> np.ndarray:
        """Points seen by both cameras [m], shape (N, 3)."""
        return np.concatenate([self.top, self._see("environment_camera")])

    @cached_property
    def flat_area(self) -> float:
        """Estimated area of the garment lying flat [m^2]; infinite when it is out of sight."""
        return estimate_flat_area(self.top) if len(self.top) else np.inf

    tilt = np.nan
    """Not seen."""

    midline = np.empty((0, 3))
    """Not seen."""

    places: Mapping[str, np.ndarray] = MappingProxyType({})
    """Not seen."""

    def enclose(self, points: np.ndarray) -> np.ndarray:
        """Tell of no point that the garment encloses it: that is not seen."""
        return np.zeros(len(points), dtype=bool)

    @property
    def frames(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """As in `SceneView`."""
        return self._sensed.frames

    def _see(self, camera: str) -> np.ndarray:
        try:
            return self._sensed.see_points(camera)
        except PerceptionError:  # the garment is out of sight
            return np.empty((0, 3))


def estimate_flat_area(points: np.ndarray) -> float:
    """Estimate the flat area of a garment on the ground from its height.

    Args:
        points: Points seen from above [m], shape (N, 3): half of `AREA_CELL` apart, z from the
            ground.

    Returns:
        The area [m^2], counted in cells as `dgl_tasks.success.compute_covered_area` does.
    """
    cells = np.floor(points[:, :2] / AREA_CELL).astype(np.int64)
    _, index, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    heights = np.bincount(index.ravel(), points[:, 2]) / count
    return float((_PER_AREA + _PER_VOLUME * heights).sum() * AREA_CELL**2)
