"""Recording a stage: one frame at every fifth control step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from dgl_collect.episodes import Points, StageRecord
from dgl_collect.video import VideoWriter
from dgl_tasks.observation import STEPS_PER_FRAME, Observation


@dataclass(frozen=True, kw_only=True, eq=False)
class StageStart:
    """What is known when a stage begins and does not change within it; see `StageRecord`."""

    name: str
    garment_point_cloud: np.ndarray
    points_affordance_feature: np.ndarray
    object_point_cloud: np.ndarray | None = None
    points: Points = field(default_factory=dict)
    cloud_step: int | None = None


class StageRecorder:
    """Accumulate the frames of one stage.

    Call `before_step` before every control step, of the approach too where it is to be recorded, and
    `begin` between the approach and the stage. At every fifth step it observes; the target in force at the
    last of the five steps becomes that frame's action: the target that the expert was heading for, and that
    a policy reaches within five steps.

    Args:
        start: What does not change within the stage.
        video: An open film that receives every frame's image.
    """

    def __init__(self, start: StageStart, *, video: VideoWriter | None = None) -> None:
        self._start = start
        self._video = video
        self._step_count = 0
        self._approach_frames = 0
        self._first_step: int | None = None
        self._observations: list[Observation] = []
        self._actions: list[np.ndarray] = []

    @property
    def frame_count(self) -> int:
        """Frames recorded so far."""
        return len(self._observations)

    def begin(self, step: int) -> None:
        """Begin the stage itself: what has been recorded before is the approach.

        Args:
            step: Control steps since the reset.
        """
        if self._step_count % STEPS_PER_FRAME:
            raise ValueError(
                f"an approach must have whole frames of {STEPS_PER_FRAME} steps; got {self._step_count}"
            )
        self._approach_frames = self.frame_count
        self._first_step = step - self._step_count

    def before_step(self, target: np.ndarray, observe: Callable[[], Observation]) -> None:
        """Record what has to be recorded before the next control step.

        Args:
            target: Commanded joint targets of this step [rad], shape (D,).
            observe: Gives the observation; called at every fifth step only, since it renders.
        """
        shape = self._actions[0].shape if self._actions else target.shape
        if target.ndim != 1 or target.shape != shape:
            wanted = f"({shape[0]},)" if self._actions else "(D,)"
            raise ValueError(f"target must have shape {wanted}; got {target.shape}")
        action = np.array(target, dtype=np.float32)  # a copy: controllers reuse their buffers
        if self._step_count % STEPS_PER_FRAME == 0:
            observation = observe()
            self._observations.append(observation)
            self._actions.append(action)
            if self._video is not None:
                self._video.add(observation.image)
        else:
            self._actions[-1] = action
        self._step_count += 1

    def finish(self) -> StageRecord:
        """Give what was recorded.

        Returns:
            The stage, checked.

        Raises:
            ValueError: If nothing was recorded, or an array is not as the format wants it.
        """
        if not self._observations:
            raise ValueError(f"stage {self._start.name!r} must have at least one frame; got 0")
        return StageRecord(
            name=self._start.name,
            joint_state=self._stack("joint_state"),
            action=np.stack(self._actions),
            ee_pose=self._stack("ee_pose"),
            image=self._stack("image"),
            env_point_cloud=self._stack("env_point_cloud"),
            garment_point_cloud=self._start.garment_point_cloud,
            points_affordance_feature=self._start.points_affordance_feature,
            object_point_cloud=self._start.object_point_cloud,
            points=self._start.points,
            cloud_step=self._start.cloud_step,
            first_step=self._first_step,
            approach_frames=self._approach_frames,
        )

    def _stack(self, key: str) -> np.ndarray:
        return np.stack([getattr(observation, key) for observation in self._observations])
