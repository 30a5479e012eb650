"""One episode in an environment: what is scripted, seen and judged alike for every method."""

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_tasks import perception as see
from dgl_tasks.approach import RELEASE_FRAMES, plan_approach, plan_free, plan_leave
from dgl_tasks.declaration import Stage
from dgl_tasks.env import GarmentEnv
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.grasps import roll_thumb_down, wrist_to_grasp
from dgl_tasks.hanging import Hanging, measure_hanging
from dgl_tasks.leaving import LeaveName
from dgl_tasks.motion import BimanualMotion, Rehearsal
from dgl_tasks.observation import STEPS_PER_FRAME, Observation
from dgl_tasks.success import Before, Verdict

logger = logging.getLogger(__name__)

FINAL_FRAMES = 50
"""Control steps between the hands being out of the way and the verdict."""
FINAL_WAITS = 4
"""How often these are waited for at most, while the garment still moves."""
CAUGHT_DISTANCE = 0.12
"""A risen hand is taken to carry cloth that is seen so near to its grasp point [m]; what lies is 0.15 m below."""
HELD_DISTANCE = 0.12
"""A hand holds the garment while a raised point is this near its grasp point [m]."""
HELD_HEIGHT = 0.05
"""What lies higher than this over the ground counts as raised [m]."""
FREE_ROLLS = (0.0, 0.0, 0.5, 0.5, 0.5)
"""How far a hand rolls on for its thumb to point down, in each of the tries to get rid of cloth that has come along [rad];
then it goes away with it."""
PARKED_FRAMES = 30
"""Control steps in which the fingers come to rest after the arms have swung to their parking place: they lag behind by
0.08 rad. A policy that begins there would be told by them how long ago that was, in every demonstration alike, and would
take a hand that has been at rest for longer to be further on its way."""
PASSAGE_FILM_STEPS = 3 * STEPS_PER_FRAME
"""Control steps between pictures for people while the arms come and go: the film runs three times as fast
there, since a picture costs as much as two steps of the simulation."""


@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What the end of an episode amounts to."""

    verdict: Verdict
    """What the task's rule said of what the garment camera sees."""
    is_seen: bool
    """Whether the camera saw anything of the garment."""
    is_released: bool
    """Whether no hand touches the garment."""
    is_still: bool
    """Whether the garment lies still."""
    picture: np.ndarray
    """What was judged, shape (H, W, 3), uint8."""

    @property
    def reason(self) -> str | None:
        """Why it is no success, in words that can be counted; None for a success."""
        if not self.is_seen:
            return "out of sight"
        if not self.verdict.success:
            return "below the threshold"
        if not self.is_released:
            return "not released"
        return None if self.is_still else "still moving"


class StepListener(Protocol):
    """Is told before every control step; `StageRecorder` of `dgl_collect` is one."""

    def before_step(self, target: np.ndarray, observe: Callable[[], Observation]) -> None:
        """Take note of the commanded targets [rad], shape (D,); `observe` renders when called."""
        ...


class Driver:
    """The environment's own controller for one episode, and its record.

    Everything that is the same for all methods is here: the start from a seed, looking, going to
    grasp points, leaving the cloth, parking and judging. What happens in between is the method's.
    What is seen depends on the seed and the control step alone, not on what was looked at before.
    """

    def __init__(
        self,
        env: GarmentEnv,
        motion: BimanualMotion,
        *,
        seed: int,
        film: Callable[[np.ndarray], None] | None = None,
    ) -> None:
        """Prepare the episode of a seed.

        Args:
            env: The environment.
            motion: Plans its arms.
            seed: Of the episode, at least 0.
            film: Receives pictures for people, shape (H, W, 3), uint8: one at every fifth control step,
                and at every fifteenth while the arms come and go.
        """
        self.env, self.motion, self.seed = env, motion, seed
        self.commands: list[np.ndarray] = []
        """Joint targets of every control step so far [rad], each of shape (D,), float32."""
        self.measurements: dict[str, float] = {}
        """Largest strain and penetration so far, and what a method adds."""
        self.events: list[tuple[str, str]] = []
        """What a method saw going wrong on the way, in order: a reason that can be counted, and where."""
        self._film = film
        self._settled_at: int | None = None

    @property
    def step_count(self) -> int:
        """Control steps since the reset."""
        return len(self.commands)

    @property
    def is_parked(self) -> bool:
        """Whether both arms have been sent to their parking place."""
        robot = self.motion.robot
        return all(
            np.allclose(
                self.motion.target[robot.joint_slice(s, "arm")], robot.arm.parked[s], atol=1e-6
            )
            for s in SIDES
        )

    # Acting ----------------------------------------------------------------------------------

    def start(self, garment: str | None = None) -> None:
        """Reset the environment, bring the arms out of the picture, and wait until the hands are at rest.

        Args:
            garment: Catalogue id; drawn from the seed when None.
        """
        self.env.reset(seed=self.seed, options={} if garment is None else {"garment": garment})
        self.motion.reset(self.motion.robot.compute_start("open"))
        self._park()

    def send(
        self,
        rows: np.ndarray,
        listener: StepListener | None = None,
        *,
        film_steps: int = STEPS_PER_FRAME,
    ) -> None:
        """Send joint targets that `motion` has planned, one a control step.

        Args:
            rows: The targets [rad], shape (N, D).
            listener: Is told before every step.
            film_steps: Control steps between two pictures of the film.
        """
        for row in rows:
            target = row.astype(np.float32)
            if listener is not None:
                listener.before_step(target, self.observe)
            if self._film is not None and self.step_count % film_steps == 0:
                self._film(see.film(self.env))
            if self.step_count % STEPS_PER_FRAME == 0:
                self._measure()
            self.env.advance(target)
            self.commands.append(target)

    def execute(self, actions: np.ndarray, listener: StepListener | None = None) -> None:
        """Send a policy's actions [rad], shape (N, D), each reached in a straight line within five control steps.

        That is how demonstrations move: their targets are given at every control step, and recorded at every fifth.

        Raises:
            ValueError: If the shape is another one, or a number is not finite.
        """
        actions = np.asarray(actions, dtype=float)
        wanted = self.motion.robot.dof
        if actions.ndim != 2 or actions.shape[1] != wanted:
            raise ValueError(f"actions must have shape (N, {wanted}); got {actions.shape}")
        if not np.isfinite(actions).all():
            raise ValueError("actions must be finite; got some that are not")
        if len(actions):
            knots = np.concatenate([self.motion.target[None], actions])
            share = np.arange(1, STEPS_PER_FRAME + 1)[:, None] / STEPS_PER_FRAME
            rows = (1 - share) * knots[:-1, None] + share * knots[1:, None]
            self.send(rows.reshape(-1, wanted), listener)
            self.motion.reset(actions[-1])

    def approach(
        self,
        stage: Stage,
        points: Mapping[Side, np.ndarray],
        rehearsals: Sequence[Rehearsal] = (),
        listener: StepListener | None = None,
    ) -> dict[Side, np.ndarray]:
        """Bring hands to grasp points: above them, straight down, and a wait.

        Args:
            stage: Names the orientation; a hand is turned about the vertical as little as needed.
            points: Grasp point of each working hand [m], shape (3,), world frame.
            rehearsals: What each hand has to be able to do, from the best to what has to do, see
                `BimanualMotion.choose_turns`; the approach alone when there are none.
            listener: Is told before every step of whole frames, counted from the end.

        Returns:
            Orientation of each working hand, wxyz, shape (4,).

        Raises:
            UnreachableError: If a hand cannot go there.
        """

        def come(side: Side, orientation: np.ndarray) -> None:
            plan_approach(self.motion, {side: points[side]}, {side: orientation})

        orientations = self.motion.choose_turns(
            stage.orientation, tuple(points), *(rehearsals or (come,))
        )
        rows = plan_approach(self.motion, points, orientations)
        before = len(rows) % STEPS_PER_FRAME
        self._pass(rows[:before])
        self._pass(rows[before:], listener)
        return orientations

    def leave(
        self,
        points: Mapping[Side, np.ndarray],
        orientations: Mapping[Side, np.ndarray],
        name: LeaveName = "slide",
    ) -> None:
        """Let opened hands leave the cloth and park, from where `motion` is; what is seen to come along is put down again.

        They are laid flat first: the thumb of an open hand is under the cloth and takes it along.

        Args:
            points: Grasp point of each of these hands [m], shape (3,), world frame.
            orientations: Of `ee` of each of these hands, wxyz, shape (4,).
            name: In which way, see `dgl_tasks.leaving`.

        Raises:
            UnreachableError: If a hand cannot even go straight up.
        """
        self._pass(self.motion.hold(RELEASE_FRAMES))
        self._pass(self.motion.set_hands(dict.fromkeys(orientations, "flat")))
        for rows in plan_leave(self.motion, points, orientations, name):
            self._pass(rows)
        self._free_hands(tuple(orientations))
        self._park()

    def _free_hands(self, sides: tuple[Side, ...]) -> None:
        """Put cloth that is seen to hang on risen hands down again."""
        for roll in FREE_ROLLS:
            caught = self._see_caught(sides)
            if not caught:
                return
            poses = self.motion.compute_poses()
            points = {side: self._to_grasp(poses[side], side) for side in caught}
            rolled = {side: roll_thumb_down(poses[side][3:], roll, side) for side in caught}
            try:
                parts = plan_free(self.motion, points, rolled)
            except UnreachableError as err:
                logger.info("cloth hangs on a hand that cannot go down again: %s", err)
                return
            for rows in parts:
                self._pass(rows)
            self.measurements["freed_hands"] = self.measurements.get("freed_hands", 0.0) + len(
                caught
            )

    def _see_caught(self, sides: tuple[Side, ...]) -> list[Side]:
        try:
            points = self.see_points()
        except PerceptionError:
            return []  # hangs out of sight, if at all
        near = {
            side: np.linalg.norm(points - self.get_grasp_point(side), axis=1).min()
            for side in sides
        }
        return [side for side in sides if near[side] < CAUGHT_DISTANCE]

    def retreat(self, sides: tuple[Side, ...] = SIDES, name: LeaveName = "slide") -> None:
        """Open hands, wherever a policy has left them, and let them leave the cloth and park.

        From where there is no way straight up the arms swing to their parking place at once.

        Args:
            sides: Hands that leave the cloth; both arms park.
            name: In which way they leave it, see `dgl_tasks.leaving`.
        """
        self.send(self.motion.set_hands(dict.fromkeys(sides, "open")))
        poses = self.motion.compute_poses()
        orientations: dict[Side, np.ndarray] = {side: poses[side][3:] for side in sides}
        points: dict[Side, np.ndarray] = {s: self._to_grasp(poses[s], s) for s in sides}
        try:
            with self.motion.rehearsal():
                plan_leave(self.motion, points, orientations, name)
        except (UnreachableError, ValueError) as err:
            logger.info("the hands park at once: %s", err)
            self._pass(self.motion.hold(RELEASE_FRAMES))
            self._park()
        else:
            self.leave(points, orientations, name)

    # Seeing ----------------------------------------------------------------------------------

    @property
    def cloud_seed(self) -> int:
        """Seed of the sampling of what is seen now."""
        rng = np.random.default_rng([self.seed, 1, self.step_count])
        return int(rng.integers(2**31))

    def observe(self) -> Observation:
        """Look with the environment camera and feel the joints."""
        picture = see.take_picture(self.env, "environment_camera")
        return Observation(
            joint_state=self.get_joint_state(),
            ee_pose=self._get_poses().astype(np.float32),
            image=picture.rgb,
            env_point_cloud=see.get_environment_cloud(self.env, picture, seed=self.cloud_seed),
        )

    def see_garment(self) -> np.ndarray:
        """Look at the garment from above: its cloud [m], shape (2048, 3), float32.

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        picture = see.take_picture(self.env, "garment_camera")
        return see.get_garment_cloud(self.env, picture, seed=self.cloud_seed)

    def see_points(self) -> np.ndarray:
        """Look at the garment from the front: all points that are seen of it [m], shape (N, 3).

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        picture = see.take_picture(self.env, "environment_camera")
        return see.get_garment_points(self.env, picture)

    def see_hanging(self) -> Hanging:
        """Look at the garment that hangs between both hands, from the front.

        Raises:
            PerceptionError: If the camera sees nothing of it.
        """
        left, right = self.get_grasp_point("left"), self.get_grasp_point("right")
        return measure_hanging(self.see_points(), left, right)

    def get_joint_state(self) -> np.ndarray:
        """Measured joint positions [rad], shape (D,), float32."""
        state = self.env.agent.get_joint_state()[0]  # pyright: ignore[reportAttributeAccessIssue]
        return state.cpu().numpy().astype(np.float32)

    def get_grasp_point(self, side: Side) -> np.ndarray:
        """Tell where the grasp point of a hand is now [m], shape (3,), world frame."""
        return self._to_grasp(self._get_poses()[SIDES.index(side)], side)

    def is_low(self, side: Side) -> bool:
        """Say whether a hand is so low that what it holds need not be raised."""
        return bool(self.get_grasp_point(side)[2] < HELD_HEIGHT + HELD_DISTANCE / 2)

    def find_empty(self, stage: Stage, points: np.ndarray) -> dict[Side, float]:
        """Find the working hands that are up and hold nothing of a garment.

        Args:
            stage: Says which hands work.
            points: What is known of the garment [m], shape (N, 3), world frame.

        Returns:
            How far the nearest raised point is from each of them [m].
        """
        raised = points[points[:, 2] > HELD_HEIGHT]
        empty: dict[Side, float] = {}
        for side in stage.grasp:
            if self.is_low(side):
                continue
            grasp = self.get_grasp_point(side)
            distances = np.linalg.norm(raised - grasp, axis=1)
            nearest = float(distances.min(initial=np.inf))
            if nearest > HELD_DISTANCE:
                empty[side] = nearest
        return empty

    # Judging ---------------------------------------------------------------------------------

    def settle(self) -> None:
        """Wait for the garment to come to rest before it is judged; nothing is left to wait for right after a wait."""
        if self._settled_at == self.step_count:
            return
        for _ in range(FINAL_WAITS):
            self._pass(self.motion.hold(FINAL_FRAMES))
            if self.env.is_still():
                break
        self._settled_at = self.step_count

    def judge(self, points: Mapping[str, np.ndarray] | None = None) -> Judgement:
        """Judge what the garment camera sees, with the arms where they are.

        Args:
            points: Where the places that the rule names lay on the garment before it was touched
                [m], shape (3,); the true ones when None.
        """
        picture = see.take_picture(self.env, "garment_camera")
        try:
            seen = see.get_garment_points(self.env, picture)
        except PerceptionError:  # it has been carried away
            seen = np.empty((0, 3))
        rule = self.env.task.success
        # The flat garment is known of every garment that is to be flung.
        before = self.env.before
        if points is not None:
            named = {name: points[name] for name in rule.points}
            before = Before(points=named, flat_area=before.flat_area)
        state = self.env.evaluate()
        return Judgement(
            verdict=rule(seen, before),
            is_seen=len(seen) > 0,
            is_released=bool(state["is_released"].item()),
            is_still=bool(state["is_still"].item()),
            picture=picture.rgb,
        )

    def is_nearly_done(self, points: Mapping[str, np.ndarray] | None = None) -> bool:
        """Whether what is seen, once it lies still, comes to `Task.nearly_done`; false for tasks without it.

        Args:
            points: As of `judge`.
        """
        least = self.env.task.nearly_done
        if least is None:
            return False
        self.settle()
        return self.judge(points).verdict.value >= least

    # -----------------------------------------------------------------------------------------

    def _park(self) -> None:
        """Bring both arms out of the picture, open the hands, and wait until they are at rest."""
        self._pass(self.motion.park())
        if not all(self._is_open(side) for side in SIDES):
            self._pass(self.motion.set_hands(dict.fromkeys(SIDES, "open")))
        self._pass(self.motion.hold(PARKED_FRAMES))

    def _is_open(self, side: Side) -> bool:
        robot = self.motion.robot
        target = self.motion.target[robot.joint_slice(side, "hand")]
        return np.allclose(target, robot.get_hand_pose("open"), atol=1e-6)

    def _pass(self, rows: np.ndarray, listener: StepListener | None = None) -> None:
        self.send(rows, listener, film_steps=PASSAGE_FILM_STEPS)

    def _get_poses(self) -> np.ndarray:
        poses = self.env.agent.get_ee_poses()[0]  # pyright: ignore[reportAttributeAccessIssue]
        return poses.cpu().numpy()

    def _to_grasp(self, pose: np.ndarray, side: Side) -> np.ndarray:
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=self.motion.robot)

    def _measure(self) -> None:
        cloth = self.env.cloth
        strain = cloth.measure_strain()
        values = {
            "strain_mean": float(strain.mean()),
            "strain_p999": float(np.quantile(strain, 0.999)),
            "penetration_m": float(cloth.solver.measure_penetration(cloth.state)[0]),
        }
        for name, value in values.items():
            self.measurements[f"max_{name}"] = max(value, self.measurements.get(f"max_{name}", 0.0))
