"""The loop of one episode: steps the environment, films it, and measures the truth."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Protocol

import numpy as np

from dgl_tasks.clearance import Obstacle
from dgl_tasks.env import GarmentEnv
from dgl_tasks.holding import find_empty
from dgl_tasks.messages import BeginsAgain, Believes, Carrying, Command, Mark, Part, TakePictures
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.sensing import Sensed
from dgl_tasks.success import Verdict

PASSAGE_FILM_STEPS = 3 * STEPS_PER_ACTION
"""Control steps between pictures of the film while the arms come and go: three times as fast."""


class Listener(Protocol):
    """Receives commands and marks; `EpisodeRecorder` of `dgl_collect` is one."""

    def before_step(self, command: Command, look: Callable[..., Sensed]) -> None:
        """Take note of a command before its control step.

        Args:
            command: The command.
            look: Gives the present snapshot, with pictures of the cameras it is called with.
        """
        ...

    def note(self, mark: Mark, sensed: Sensed) -> None:
        """Take note of a mark."""
        ...


class Driver:
    """Steps an environment as a part of an episode says; keeps truth and beliefs apart.

    Commands pass through the environment's control mode: in `pd_hand_poses` a hand follows those
    that mix its poses exactly, others by the nearest that does.
    """

    def __init__(
        self,
        env: GarmentEnv,
        *,
        seed: int,
        film: Callable[[np.ndarray], None] | None = None,
        listener: Listener | None = None,
    ) -> None:
        """Prepare the episode of a seed.

        Args:
            env: The environment.
            seed: Of the episode, at least 0.
            film: Receives pictures for people, shape (H, W, 3), uint8: at every fifth control step,
                and at every fifteenth while the arms come and go.
            listener: Receives commands and marks.
        """
        self.env, self.seed = env, seed
        self.commands: list[np.ndarray] = []
        """Joint targets of every control step so far [rad], each of shape (D,), float32."""
        self.measurements: dict[str, float] = {}
        """Largest strain and penetration so far, and numbers of retries."""
        self.mishaps: list[tuple[str, str, str]] = []
        """Mishaps in order: stage, reason and place; a stage that is done again drops its own."""
        self.first_try: Verdict | None = None
        """Verdict before any retry; None without a retry."""
        self.beliefs: dict[str, float] = {}
        """The method's estimates, the last of each name."""
        self._film, self._listener = film, listener

    def reset(self, garment: str | None = None) -> Sensed:
        """Reset the environment.

        Args:
            garment: Catalogue id; drawn from the seed when None.

        Returns:
            The first snapshot.
        """
        self.env.reset(seed=self.seed, options={} if garment is None else {"garment": garment})
        return self.sense()

    def sense(self, *cameras: str) -> Sensed:
        """Give the present snapshot, with pictures of these cameras."""
        env = self.env
        return Sensed(
            seed=self.seed,
            step=len(self.commands),
            robot=env.agent.model,
            joint_state=env.agent.read_joints(),
            ee_pose=env.agent.read_hands(),
            frames=env.get_frames(),
            pulls=env.measure_pulls(),
            obstacles=[
                Obstacle(name=name, prop=item.prop, pose=item.pose)
                for name, item in env.objects.items()
                if item.declared.avoided
            ],
            workspace=env.task.workspace,
            cloud=env.cloud,
            pictures={camera: env.take_picture(camera) for camera in cameras},
            segments=env.segments if cameras else None,
        )

    def follow(self, part: Part) -> Iterator[Command]:
        """Carry out a part of an episode; gives each command once its control step is made."""
        try:
            item = next(part)
            while True:
                cameras: tuple[str, ...] = ()
                if isinstance(item, Command):
                    self.step(item)
                    yield item
                elif isinstance(item, TakePictures):
                    cameras = item.cameras
                else:
                    self._note(item)
                item = part.send(self.sense(*cameras))
        except StopIteration:
            return

    def drive(self, part: Part) -> None:
        """Carry out a part of an episode to its end."""
        for _ in self.follow(part):
            pass

    def step(self, command: Command) -> None:
        """Make one control step."""
        number = len(self.commands)
        agent, action = self.env.agent, command.target.astype(np.float32)
        if agent.control_mode == "pd_hand_poses":
            action = agent.make_action(command.target).astype(np.float32)
            command = replace(command, target=agent.read_targets(action).astype(np.float32))
        if self._listener is not None:
            self._listener.before_step(command, self.sense)
        every = PASSAGE_FILM_STEPS if command.is_passage else STEPS_PER_ACTION
        if self._film is not None and number % every == 0:
            self._film(self.env.film())
        if number % STEPS_PER_ACTION == 0:
            self._measure()
        self.env.advance(action)
        self.commands.append(command.target.astype(np.float32))
        for name, force in self.env.measure_touch().items():
            self._keep_largest(f"max_force_on_{name}_N", force)

    def _note(self, mark: Mark) -> None:
        if self._listener is not None:
            self._listener.note(mark, self.sense())
        if isinstance(mark, Carrying):
            reason = "missed grasp" if mark.is_first else "slipped"
            empty = find_empty(self.sense(), mark.hands, self.env.get_particles())
            for side, nearest in empty.items():
                far = f"{nearest:.2f} m" if np.isfinite(nearest) else "nothing raised"
                where = f"{mark.stage}, {mark.where}, {side} hand: nearest raised cloth {far}"
                self.mishaps.append((mark.stage, reason, where))
        elif isinstance(mark, Believes):
            self.beliefs |= mark.values
        elif isinstance(mark, BeginsAgain):
            if self.first_try is None:
                self.first_try = self.env.judge()
            name = {"try": "further_tries", "round": "further_rounds"}[mark.what]
            self.measurements[name] = self.measurements.get(name, 0.0) + 1.0
            self.mishaps = [mishap for mishap in self.mishaps if mishap[0] not in mark.stages]

    def _measure(self) -> None:
        cloth = self.env.cloth
        strain = cloth.measure_strain()
        values = {
            "strain_mean": float(strain.mean()),
            "strain_p999": float(np.quantile(strain, 0.999)),
            "penetration_m": float(cloth.solver.measure_penetration(cloth.state)[0]),
        }
        for name, value in values.items():
            self._keep_largest(f"max_{name}", value)

    def _keep_largest(self, name: str, value: float) -> None:
        self.measurements[name] = max(value, self.measurements.get(name, 0.0))
