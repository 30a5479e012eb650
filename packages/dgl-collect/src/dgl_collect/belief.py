"""What a robot believes of the scene, from what it has seen: for its decisions, never for its success."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from dgl_tasks.errors import PerceptionError
from dgl_tasks.sensing import Sensed


class BelievedView:
    """The scene as the robot believes it to be; implements `dgl_tasks.success.SceneView`."""

    def __init__(
        self,
        sensed: Sensed,
        *,
        landmarks: Mapping[str, np.ndarray],
        flat_area: float,
    ) -> None:
        """Take what is known.

        Args:
            sensed: What is sensed now.
            landmarks: The demonstration's points as they were found before the garment was touched [m], shape (3,).
            flat_area: What the garment is believed to cover lying flat [m^2]; infinite while that cannot be told.
        """
        self._sensed, self.landmarks, self.flat_area = sensed, landmarks, flat_area

    @cached_property
    def top(self) -> np.ndarray:
        """What the garment camera sees [m], shape (N, 3)."""
        return self._see("garment_camera")

    @cached_property
    def surface(self) -> np.ndarray:
        """What both cameras see [m], shape (N, 3)."""
        return np.concatenate([self.top, self._see("environment_camera")])

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
