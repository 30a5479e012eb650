"""What a robot believes of the scene, from what it has seen: for its decisions, never for its success."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from dgl_tasks.errors import PerceptionError
from dgl_tasks.sensing import Sensed
from dgl_tasks.success import AREA_CELL

_PER_AREA, _PER_VOLUME = 0.51, 33.0
# flat area by what is covered, and by the volume under what is seen [1/m]: a least-squares fit to flings of tops, dresses and
# trousers of the training split. What lies flat is 15 mm high; where it is folded, more layers lie on each other.


class BelievedView:
    """The scene as the robot believes it to be; implements `dgl_tasks.success.SceneView`."""

    def __init__(self, sensed: Sensed, *, landmarks: Mapping[str, np.ndarray]) -> None:
        """Take what is known.

        Args:
            sensed: What is sensed now.
            landmarks: The demonstration's points as they were found before the garment was touched [m], shape (3,).
        """
        self._sensed, self.landmarks = sensed, landmarks

    @cached_property
    def top(self) -> np.ndarray:
        """What the garment camera sees [m], shape (N, 3)."""
        return self._see("garment_camera")

    @cached_property
    def surface(self) -> np.ndarray:
        """What both cameras see [m], shape (N, 3)."""
        return np.concatenate([self.top, self._see("environment_camera")])

    @cached_property
    def flat_area(self) -> float:
        """What the garment would cover lying flat [m^2], as its height tells; infinite when it is out of sight."""
        return estimate_flat_area(self.top) if len(self.top) else np.inf

    tilt = np.nan
    """Nobody sees it."""

    @property
    def frames(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """As in `SceneView`."""
        return self._sensed.get_frames()

    def _see(self, camera: str) -> np.ndarray:
        try:
            return self._sensed.see_points(camera)
        except PerceptionError:  # it has been carried away
            return np.empty((0, 3))


def estimate_flat_area(points: np.ndarray) -> float:
    """Estimate what a garment that lies on the ground would cover lying flat, from how high it lies.

    Args:
        points: What is seen of it from above [m], shape (N, 3): half of `AREA_CELL` apart, z from the ground.

    Returns:
        The area [m^2], counted in cells as `dgl_tasks.success.compute_covered_area` does.
    """
    cells = np.floor(points[:, :2] / AREA_CELL).astype(np.int64)
    _, index, count = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    heights = np.bincount(index.ravel(), points[:, 2]) / count
    return float((_PER_AREA + _PER_VOLUME * heights).sum() * AREA_CELL**2)
