"""What a robot believes of the scene, from what it has seen: for its decisions, never for its success."""

from collections.abc import Mapping
from functools import cached_property

import numpy as np

from dgl_collect.formula import Value, evaluate_formula
from dgl_tasks.errors import PerceptionError
from dgl_tasks.sensing import Sensed


class BelievedView:
    """The scene as the robot believes it to be; implements `dgl_tasks.success.SceneView`."""

    def __init__(
        self,
        sensed: Sensed,
        *,
        landmarks: Mapping[str, np.ndarray],
        flat_area: str | None,
        names: Mapping[str, Value],
    ) -> None:
        """Take what is known.

        Args:
            sensed: What is sensed now.
            landmarks: The demonstration's points as they were found before the garment was touched [m], shape (3,).
            flat_area: Formula of the garment's area; see `Demonstration.flat_area`.
            names: What it may name.
        """
        self._sensed, self._flat_area, self._names = sensed, flat_area, names
        self.landmarks = landmarks
        """As in `SceneView`."""

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
    def flat_area(self) -> float:
        """What the garment is believed to cover lying flat [m^2]; infinite before it has been seen well enough to tell."""
        if self._flat_area is None:
            return np.inf
        try:
            return evaluate_formula(self._flat_area, self._names)
        except ValueError:
            return np.inf

    @property
    def frames(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """As in `SceneView`."""
        return self._sensed.get_frames()

    def _see(self, camera: str) -> np.ndarray:
        try:
            return self._sensed.see_points(camera)
        except PerceptionError:  # it has been carried away
            return np.empty((0, 3))
