"""Parts of an episode that all methods share: approach, release and retreat, park, and wait."""

import logging
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal, TypeAlias

import numpy as np
from annotated_types import Ge, Le, Len

from dgl_assets.robots import SIDES, Side
from dgl_tasks.control import get_joint_limits, interpolate_action
from dgl_tasks.errors import PerceptionError, PolicyError, UnreachableError
from dgl_tasks.grasps import point_along_fingers, roll_thumb_down, wrist_to_grasp
from dgl_tasks.inputs import ActionBounds
from dgl_tasks.messages import Command, Mark, Message, Part, TakePictures
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.observation import STEPS_PER_ACTION, Observation
from dgl_tasks.sensing import ENVIRONMENT_CAMERA, SENSOR_CAMERAS, Sensed

logger = logging.getLogger(__name__)

APPROACH_FROM = (0.0, 0.0, 0.15)
"""Offset from which a hand comes to a grasp point [m]: straight down."""
ARRIVAL_FRAMES = 10
"""Control steps for the arm to arrive at the grasp points before the hand closes."""
RELEASE_FRAMES = 15
"""Control steps for the cloth to fall from an opened hand before it retreats."""
RETREAT_SPACING = 0.005
"""Distance between samples of the way out of the cloth [m]; 0.005 is 0.3 m/s."""
CAUGHT_DISTANCE = 0.12
"""Distance of visible cloth from a raised hand's grasp point that counts as stuck [m]."""
FREE_ROLLS = (0.0, 0.0, 0.5, 0.5, 0.5)
"""Turns of the thumb downwards, one for each attempt to shake off cloth stuck to the hand [rad]."""
FREE_BACKS = (0.12, 0.08, 0.04, 0.0)
"""Distances that a hand draws back from stuck cloth [m]: the first that is within reach."""
PARKED_FRAMES = 30
"""Control steps for the fingers to come to rest after the arms have parked.

The fingers lag by up to 0.08 rad. Without this wait the lag would tell a policy the elapsed time,
alike in all demonstrations.
"""
SETTLE_FRAMES = 50
"""Control steps for a garment to come to rest once the hands are away."""
SETTLE_WAITS = 8
"""Largest number of these waits, while the garment is seen to move."""
STILL_LOOK_FRAMES = 10
"""Control steps between the two pictures that are compared for motion."""
STILL_SHARE = 0.01
"""Share of the garment's pixels, from above and in front, that may differ between the pictures."""

TAUT_FRAMES = 5
"""Control steps over which the pull on a hand that keeps the garment taut is measured."""
TAUT_GAIN = 0.008
"""Its shift in these for each newton of difference [m/N]."""
TAUT_BY = 0.02
"""Most shift in these [m]."""
TAUT_MOST = 0.2
"""Largest shift from its way [m]."""


_Short: TypeAlias = Annotated[float, Ge(0.0), Le(1.0)]


@dataclass(frozen=True, kw_only=True)
class WayOut:
    """Way of an opened hand out of the cloth; of a palm that looks down, the thumb is under it."""

    pose: str = "flat"
    """Hand pose: laid flat, the thumb is beside the palm and takes no cloth along."""
    roll: Annotated[float, Ge(-np.pi), Le(np.pi)] = float(np.radians(30))
    """Turn of the thumb downwards [rad]."""
    rise: _Short = 0.0
    """Rise during the turn [m]."""
    wait: Annotated[int, Ge(0), Le(3600)] = 0
    """Control steps for the cloth to slide off the thumb then."""
    back: Annotated[tuple[_Short, ...], Len(1)] = (0.12, 0.08, 0.04, 0.0)
    """Distances to draw back along the fingers, level [m]: the first that is within reach."""
    up: _Short = 0.15
    """Rise at the end [m]."""
    spacing: Annotated[float, Ge(1e-4), Le(0.1)] = RETREAT_SPACING
    """Distance between samples of the way [m]."""
    frees: bool = True
    """Cloth that is seen to stick to the hand is put down again."""


def plan_approach(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
    *,
    come_from: Sequence[float] = APPROACH_FROM,
    spacing: float = 0.01,
) -> np.ndarray:
    """Plan the way to grasp points: to positions beside them, straight to them, and a wait.

    Args:
        motion: Plans the arms.
        points: Grasp point of each hand [m], shape (3,), world frame.
        orientations: Of `ee` of each of these hands, wxyz, shape (4,).
        come_from: Offset of the positions beside them [m]; its x is outward for both hands.
        spacing: Distance between samples of the last line [m].

    Returns:
        Joint targets [rad], shape (N, D).

    Raises:
        UnreachableError: If a grasp point is out of reach.
    """
    x, y, z = come_from
    beside: dict[Side, np.ndarray] = {
        side: point + np.array([-x if side == "left" else x, y, z])
        for side, point in points.items()
    }
    way = motion.reach(beside, orientations)
    return np.concatenate(
        [way, motion.move(points, orientations, spacing=spacing), motion.hold(ARRIVAL_FRAMES)]
    )


def plan_way_out(
    motion: BimanualMotion,
    starts: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
    out: WayOut,
) -> list[np.ndarray]:
    """Plan a way to `starts`, a wait, a way back along the fingers, and one up.

    Args:
        motion: Plans the arms.
        starts: First goal of each hand's grasp point [m], shape (3,), world frame.
        orientations: Of `ee` of each of these hands, wxyz, shape (4,).
        out: Distances and the wait.

    Returns:
        Joint targets of each part, shape (N, D) [rad].

    Raises:
        UnreachableError: If a hand has no way, not even straight up.
    """
    ways: dict[Side, tuple[np.ndarray, ...]] = {}
    for side, q in orientations.items():
        for length in out.back:
            back = starts[side] - length * point_along_fingers(q)
            ways[side] = (starts[side], back, back + np.array([0, 0, out.up]))
            with motion.rehearsal():
                try:
                    for target in ways[side]:
                        motion.move({side: target}, {side: q}, spacing=out.spacing)
                except UnreachableError:
                    if length == out.back[-1]:
                        raise
                else:
                    break
    parts = []
    for k in range(3):
        targets: dict[Side, np.ndarray] = {side: way[k] for side, way in ways.items()}
        parts.append(motion.move(targets, orientations, spacing=out.spacing))
        if k == 0:
            parts.append(motion.hold(out.wait))
    return parts


def plan_leave(
    motion: BimanualMotion,
    points: Mapping[Side, np.ndarray],
    orientations: Mapping[Side, np.ndarray],
    out: WayOut,
) -> list[np.ndarray]:
    """Plan the retreat of opened hands from present grasp points: roll, draw back, rise.

    Arguments and errors as of `plan_way_out`.
    """
    rolled: dict[Side, np.ndarray] = {
        side: roll_thumb_down(q, out.roll, side) for side, q in orientations.items()
    }
    starts: dict[Side, np.ndarray] = {
        side: points[side] + np.array([0, 0, out.rise]) for side in orientations
    }
    return plan_way_out(motion, starts, rolled, out)


class Handling:
    """Both arms and hands of one episode: plans motions, yields them, keeps the last snapshot."""

    def __init__(self, motion: BimanualMotion, sensed: Sensed) -> None:
        """Take over the arms after a reset.

        Args:
            motion: Plans the arms.
            sensed: Snapshot at that time.
        """
        self.motion = motion
        self.sensed = sensed
        """The present snapshot."""
        self._bounds = ActionBounds(*get_joint_limits(motion.robot))
        self._settled_at: int | None = None
        motion.obstacles = sensed.obstacles
        motion.reset(motion.robot.compute_start("open"))

    @property
    def is_parked(self) -> bool:
        """Both arms have been sent to their parking position."""
        robot = self.motion.robot
        return all(
            np.allclose(
                self.motion.target[robot.joint_slice(s, "arm")], robot.arm.parked[s], atol=1e-6
            )
            for s in SIDES
        )

    def mark(self, mark: Mark) -> Part:
        """Yield a mark."""
        self.sensed = yield mark

    def look(self, *cameras: str) -> Generator[Message, Sensed, Sensed]:
        """Ask for pictures; gives the present snapshot with them."""
        self.sensed = yield TakePictures(cameras)
        return self.sensed

    def observe(self) -> Generator[Message, Sensed, Observation]:
        """Give the present observation of a policy."""
        return (yield from self.look(ENVIRONMENT_CAMERA)).observe()

    def send(
        self,
        rows: np.ndarray,
        *,
        recorded: Literal["approach", "stage"] | None = None,
        is_passage: bool = False,
    ) -> Part:
        """Yield joint targets that `motion` has planned [rad], shape (N, D), one a control step."""
        for row in rows:
            self.sensed = yield Command(row, recorded, is_passage)

    def send_taut(
        self,
        rows: np.ndarray,
        tension: Mapping[Side, float],
        *,
        towards: np.ndarray,
        recorded: Literal["approach", "stage"] | None = None,
    ) -> Part:
        """Yield planned joint targets, and keep the garment between hands and a place taut.

        Hands shift level towards the place while the garment pulls them more than they are to be
        pulled, and away from it while it pulls less.

        Args:
            rows: Joint targets [rad], shape (N, D).
            tension: Pull that each of these hands keeps, in its mean over `TAUT_FRAMES` [N].
            towards: Place that the garment comes from [m], shape (3,), world frame.
            recorded: As of `send`.
        """
        wanted: dict[Side, float] = dict.fromkeys(tension, 0.0)
        shifts: dict[Side, float] = dict(wanted)
        for first in range(0, len(rows), TAUT_FRAMES):
            part = rows[first : first + TAUT_FRAMES]
            pulls = dict.fromkeys(tension, 0.0)
            for number, row in enumerate(part):
                share = 1 / (TAUT_FRAMES - number)
                nearer: dict[Side, float] = {
                    side: s + share * (wanted[side] - s) for side, s in shifts.items()
                }
                shifted, shifts = self.motion.shift(row, nearer, towards=towards)
                yield from self.send(shifted[None], recorded=recorded)
                for side in tension:
                    pulls[side] += float(np.linalg.norm(self.sensed.pulls[side])) / len(part)
            for side, pull in pulls.items():
                change = np.clip(TAUT_GAIN * (pull - tension[side]), -TAUT_BY, TAUT_BY)
                wanted[side] = float(np.clip(shifts[side] + change, -TAUT_MOST, TAUT_MOST))

    def execute(
        self, actions: np.ndarray, *, recorded: Literal["approach", "stage"] | None = None
    ) -> Part:
        """Yield a policy's actions [rad], shape (N, D), as `GarmentEnv.step` takes them.

        They are clipped to the joint limits, which is logged once.

        Raises:
            PolicyError: If the shape is another one, or a number is not finite.
        """
        actions = np.asarray(actions, dtype=float)
        wanted = self.motion.robot.dof
        if actions.ndim != 2 or actions.shape[1] != wanted:
            raise PolicyError(f"actions must have shape (N, {wanted}); got {actions.shape}")
        if not np.isfinite(actions).all():
            raise PolicyError("actions must be finite; got some that are not")
        actions = self._bounds.clip(actions.astype(np.float32)).astype(float)  # as commands are
        for action in actions:
            yield from self.send(interpolate_action(self.motion.target, action), recorded=recorded)
            self.motion.reset(action)

    def approach(self, rows: np.ndarray) -> Part:
        """Yield the way to the grasp points; its whole frames, from the end, may be recorded."""
        before = len(rows) % STEPS_PER_ACTION
        yield from self.send(rows[:before], is_passage=True)
        yield from self.send(rows[before:], recorded="approach", is_passage=True)

    def retreat(self, sides: tuple[Side, ...] = SIDES, out: WayOut | None = None) -> Part:
        """Release and retreat with hands, wherever they are, and park both arms.

        Without any way out within reach, the arms park at once.

        Args:
            sides: Hands that hold or touch the cloth.
            out: Their way out.
        """
        out = out or WayOut()
        if not all(self._is_open(side) for side in sides):
            yield from self.send(self.motion.set_hands(dict.fromkeys(sides, "open")))
        points, orientations = self.get_hands(sides)
        yield from self._pass(self.motion.hold(RELEASE_FRAMES))
        before = self.motion.target
        parts = [self.motion.set_hands(dict.fromkeys(sides, out.pose))]
        try:
            parts += plan_leave(self.motion, points, orientations, out)
        except (UnreachableError, ValueError) as err:
            logger.info("the hands park at once: %s", err)
            self.motion.reset(before)
        else:
            for rows in parts:
                yield from self._pass(rows)
            if out.frees:
                yield from self._free_hands(sides)
        yield from self.park()

    def park(self) -> Part:
        """Move both arms out of the pictures, open the hands, and wait until they are at rest."""
        yield from self._pass(self.motion.park())
        if not all(self._is_open(side) for side in SIDES):
            yield from self._pass(self.motion.set_hands(dict.fromkeys(SIDES, "open")))
        yield from self._pass(self.motion.hold(PARKED_FRAMES))

    def settle(self) -> Part:
        """Wait for the garment to come to rest; right after such a wait, do nothing."""
        if self._settled_at == self.sensed.step:
            return
        for _ in range(SETTLE_WAITS):
            yield from self._pass(self.motion.hold(SETTLE_FRAMES - STILL_LOOK_FRAMES))
            before = (yield from self.look(*SENSOR_CAMERAS)).see_mask()
            yield from self._pass(self.motion.hold(STILL_LOOK_FRAMES))
            after = (yield from self.look(*SENSOR_CAMERAS)).see_mask()
            if (before != after).sum() <= STILL_SHARE * max((before | after).sum(), 1):
                break
        self._settled_at = self.sensed.step

    def _free_hands(self, sides: tuple[Side, ...]) -> Part:
        """Put down cloth that is seen to stick to raised hands: down, wait, back, up."""
        for roll in FREE_ROLLS:
            yield from self.look(ENVIRONMENT_CAMERA)
            caught = self._see_caught(sides)
            if not caught:
                return
            points, orientations = self.get_hands(caught)
            down: dict[Side, np.ndarray] = {
                side: point - np.array([0, 0, 0.15]) for side, point in points.items()
            }
            rolled: dict[Side, np.ndarray] = {
                side: roll_thumb_down(q, roll, side) for side, q in orientations.items()
            }
            out = WayOut(wait=RELEASE_FRAMES, back=FREE_BACKS)
            try:
                parts = plan_way_out(self.motion, down, rolled, out)
            except UnreachableError as err:
                logger.info("cloth sticks to a hand that cannot go down again: %s", err)
                return
            for rows in parts:
                yield from self._pass(rows)

    def _see_caught(self, sides: Iterable[Side]) -> list[Side]:
        try:
            points = self.sensed.see_points()
        except PerceptionError:
            return []  # out of sight, if at all
        near = {
            side: np.linalg.norm(points - self.sensed.get_grasp_point(side), axis=1).min()
            for side in sides
        }
        return [side for side in sides if near[side] < CAUGHT_DISTANCE]

    def get_hands(
        self, sides: Iterable[Side]
    ) -> tuple[dict[Side, np.ndarray], dict[Side, np.ndarray]]:
        """Give grasp point and orientation of each of these hands at the last targets."""
        poses, robot = self.motion.compute_poses(), self.motion.robot
        orientations: dict[Side, np.ndarray] = {side: poses[side][3:] for side in sides}
        points: dict[Side, np.ndarray] = {
            side: wrist_to_grasp(poses[side][:3], q, side, robot=robot)
            for side, q in orientations.items()
        }
        return points, orientations

    def _is_open(self, side: Side) -> bool:
        robot = self.motion.robot
        target = self.motion.target[robot.joint_slice(side, "hand")]
        return np.allclose(target, robot.get_hand_pose("open"), atol=1e-6)

    def _pass(self, rows: np.ndarray) -> Part:
        yield from self.send(rows, is_passage=True)
