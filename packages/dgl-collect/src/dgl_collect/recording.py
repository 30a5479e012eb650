"""Recording of stages, one frame at every fifth control step."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from dgl_collect.episodes import Points, StageRecord
from dgl_tasks.messages import Command, Mark, StageBegins, StageEnds
from dgl_tasks.observation import STEPS_PER_ACTION, Observation
from dgl_tasks.sensing import ENVIRONMENT_CAMERA

if TYPE_CHECKING:
    from dgl_tasks.env import GarmentEnv
    from dgl_tasks.sensing import Sensed


class StageRecorder:
    """Records the frames of one stage.

    Call `before_step` before every control step (of the approach too, to record it), and `begin`
    between the approach and the stage. It observes at every fifth step. The target in force at the
    last of the five steps becomes the action of that frame: a policy reaches it within five steps.

    Args:
        start: Constant data of the stage.
        points: Matched points, stored for inspection.
    """

    def __init__(self, start: StageBegins, *, points: Points | None = None) -> None:
        self._start, self._points = start, points or {}
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
        """Begin the stage; the frames so far are the approach.

        Args:
            step: Control steps since the reset.
        """
        if self._step_count % STEPS_PER_ACTION:
            raise ValueError(
                f"an approach must have whole frames of {STEPS_PER_ACTION} steps; "
                f"got {self._step_count}"
            )
        self._approach_frames = self.frame_count
        self._first_step = step - self._step_count

    def before_step(self, target: np.ndarray, observe: Callable[[], Observation]) -> None:
        """Record the next control step.

        Args:
            target: Commanded joint targets of this step [rad], shape (D,).
            observe: Renders an observation; called at every fifth step only.
        """
        if self._step_count % STEPS_PER_ACTION == 0:
            self._observations.append(observe())
            self._actions.append(target)
        self._actions[-1] = np.array(target, dtype=np.float32)  # controllers reuse their buffers
        self._step_count += 1

    def finish(self) -> StageRecord:
        """Check the recording and return it.

        Raises:
            ValueError: If no frame was recorded, or an array does not fit the format.
        """
        if not self._observations:
            raise ValueError(f"stage {self._start.name!r} must have at least one frame; got 0")
        frames = [observation.as_arrays() for observation in self._observations]
        return StageRecord(
            name=self._start.name,
            action=np.stack(self._actions),
            garment_point_cloud=self._start.garment_point_cloud,
            points_affordance_feature=self._start.points_affordance_feature,
            object_point_cloud=self._start.object_point_cloud,
            points=self._points,
            cloud_step=self._start.seen_at,
            first_step=self._first_step,
            approach_frames=self._approach_frames,
            **{key: np.stack([frame[key] for frame in frames]) for key in frames[0]},
        )


class EpisodeRecorder:
    """Records every stage of an attempt; implements `dgl_tasks.driver.Listener`."""

    def __init__(self, env: "GarmentEnv", *, with_approach: bool = False) -> None:
        """Prepare to record an attempt.

        Args:
            env: Gives the cameras' poses.
            with_approach: Record the approach to the grasp points, too.
        """
        self.records: dict[str, StageRecord] = {}
        """The last recording of each stage, by name."""
        self.seconds: dict[str, float] = {}
        """Wall-clock time by stage [s]."""
        self._began_at = 0.0
        self._env, self._with_approach = env, with_approach
        self._now: StageRecorder | None = None
        self._has_begun = False
        self._lost: StageRecorder | None = None

    def before_step(self, command: Command, look: Callable[..., "Sensed"]) -> None:
        """Record a command that belongs to a stage."""
        if self._now is None or command.recorded is None:
            return
        if command.recorded == "stage" and not self._has_begun:
            self._now.begin(look().step)
            self._has_begun = True
        if command.recorded == "stage" or self._with_approach:
            self._now.before_step(command.target, lambda: look(ENVIRONMENT_CAMERA).observe())

    def note(self, mark: Mark, sensed: "Sensed") -> None:
        """Note the beginning and the end of stages."""
        del sensed
        if isinstance(mark, StageBegins):
            self._now = StageRecorder(mark, points=self._describe(mark))
            self._has_begun = False
            self._began_at = time.perf_counter()
        elif isinstance(mark, StageEnds):
            # if a retry could not begin, the recording before it counts
            now, self._now = self._now or self._lost, None
            self._lost = None if mark.counts else now
            ended = time.perf_counter()
            self.seconds[mark.name] = self.seconds.get(mark.name, 0.0) + ended - self._began_at
            self._began_at = ended
            if mark.counts and now is not None and now.frame_count:
                self.records[mark.name] = now.finish()

    def _describe(self, mark: StageBegins) -> Points:
        camera = self._env.task.cameras[ENVIRONMENT_CAMERA]
        return {
            name: {"xyz": xyz.tolist(), "uv": camera.project(xyz[None])[0, :2].tolist()}
            for name, xyz in mark.points.items()
        }
