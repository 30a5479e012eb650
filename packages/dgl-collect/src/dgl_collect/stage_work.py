"""One stage at work: formulas computed, motions planned and executed."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from dgl_assets.robots import SIDES, Side
from dgl_collect.errors import DemonstrationError
from dgl_collect.formula import Value, evaluate_formula
from dgl_collect.hold_watch import HoldWatch
from dgl_collect.names import describe_cloud, list_anchors
from dgl_collect.skill import Skill, change_way
from dgl_collect.steps import (
    Approach,
    Follow,
    HandPose,
    Look,
    Move,
    Release,
    Retreat,
    Stage,
    Step,
    Stretch,
    Via,
    Wait,
)
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.grasps import Orientation, orient, point_along_fingers
from dgl_tasks.hand_span import HandSpan
from dgl_tasks.handling import Handling, plan_approach, plan_leave
from dgl_tasks.holding import find_empty
from dgl_tasks.messages import Believes, Carrying, Part, StageBegins
from dgl_tasks.rotations import to_quaternion, to_rotation
from dgl_tasks.sensing import ENVIRONMENT_CAMERA, GARMENT_CAMERA

LEAST_RISE = 0.004
"""Least rise of the sagging edge in each step of a stretch, else it ends [m]."""
FOLLOW_FRAMES = 20
"""Control steps between two checks of the hold while a way is followed; one action ends there."""
SWING_FRAMES = 20
"""Frames in which a lifted garment swings to rest before a stretch."""
REACHABLE_WITHIN = 0.1
"""Largest distance of a substitute from a grasp point that is out of reach [m]."""
REACHABLE_SPACING = 0.02
"""Spacing of the substitutes that are tried [m]."""

FollowedWays = tuple[dict[Side, np.ndarray], dict[Side, np.ndarray], dict[Side, np.ndarray]]
"""Grasp points [m], shape (N, 3), orientations wxyz (N, 4) and joints of the hands [rad] (N, H)."""
Reaction = Literal["give up", "lay down", "ignore"]
"""Reaction to an empty hand: end the stage at once; go on while the other hand holds the garment;
or do not check."""
Hold = Literal["all", "some"]
"""Working hands that held the garment throughout, as far as it was checked."""


class HoldLost(Exception):  # noqa: N818 - it leads to a retry
    """The hands have lost the garment."""


@dataclass(kw_only=True, eq=False)
class StageWork:
    """A stage being carried out."""

    stage: Stage
    hands: Handling
    names: Mapping[str, Value]
    """Values for the formulas, besides definitions and what is `seen`."""
    cloud: np.ndarray
    """Visible points of the garment [m], shape (2048, 3), world frame."""
    places: Mapping[Side, np.ndarray]
    """Matched grasp point of each working hand [m], shape (3,), world frame."""
    begins: StageBegins
    """Message at the beginning of the stage."""
    reaction: Reaction
    draw: tuple[int, int, int]
    """Numbers of stage, try and round from 1; they seed the policy."""
    skill: Skill | None = None
    """Ways of the steps that follow recordings."""
    hold: Hold = "all"
    seen: dict[str, Value] = field(default_factory=dict)
    """Values seen during the stage, by name [m]."""
    grasp: dict[Side, np.ndarray] = field(default_factory=dict)
    """Grasp point actually used by each working hand [m], shape (3,), world frame."""
    _turns: dict[Side, float] = field(default_factory=dict)
    _orientation: Orientation = "standard"
    _turned: float = 0.0
    _free: dict[Side, np.ndarray] = field(default_factory=dict)
    _targets: dict[Side, np.ndarray] = field(default_factory=dict)
    _lifts: int = 0
    _has_closed: bool = False
    _has_released: bool = False

    def __post_init__(self) -> None:
        self.grasp = {side: self._place(side, point) for side, point in self.places.items()}

    @property
    def orientations(self) -> dict[Side, np.ndarray]:
        """Present orientation of `ee` of each working hand, wxyz, shape (4,)."""
        named: dict[Side, np.ndarray] = {
            side: orient(self._orientation, side, turn + _to_inward(self._turned, side))
            for side, turn in self._turns.items()
        }
        return named | self._free

    # Before it begins ----------------------------------------------------------------------

    def find_reachable(self) -> None:
        """Replace grasp points that are out of reach by the nearest ones within reach.

        Raises:
            UnreachableError: If no point of the garment within `REACHABLE_WITHIN` can be reached.
        """
        for side, point in self.places.items():
            refused: UnreachableError | None = None
            for place in (point, *_get_places(point, self.cloud)):
                self.grasp[side] = self._place(side, place)
                try:
                    self.hands.motion.choose_turns((side,), self._plan_coming)
                    break
                except UnreachableError as err:
                    refused = refused or err
            else:
                assert refused is not None
                raise refused

    def choose_turns(self, *, must_do_all: bool) -> None:
        """Turn the hands so that all steps are within reach.

        Args:
            must_do_all: Refuse a stage with a step out of reach. Otherwise leave out as many of the
                last steps as necessary, down to the approach.

        Raises:
            UnreachableError: If no turn of a hand is enough.
        """
        counts = [len(self.stage.steps)]
        if not must_do_all:
            first = self.stage.steps.index(self.stage.approach) + 1
            counts = list(range(counts[0], first - 1, -1))

        def rehearse(count: int, side: Side, turn: float) -> None:
            self._rehearse(self.stage.steps[:count], side, turn, at=self.grasp[side])

        self._turns = self.hands.motion.choose_turns(
            tuple(self.grasp), *(lambda s, t, n=n: rehearse(n, s, t) for n in counts)
        )

    def _rehearse(self, steps: Sequence[Step], side: Side, turn: float, *, at: np.ndarray) -> None:
        """Plan steps for one hand, from `at`; raises `UnreachableError`."""
        motion, turned, free = self.hands.motion, self._turned, self._free.get(side)
        name: Orientation = self._orientation

        def get_orientation() -> dict[Side, np.ndarray]:
            if free is not None:
                return {side: free}
            return {side: orient(name, side, turn + _to_inward(turned, side))}

        for step in steps:
            match step:
                case Approach():
                    name = step.orientation
                    self._plan_coming(side, turn)
                case Move(targets=targets) if side in targets:
                    at, turned = self._compute(targets[side]), self._compute_turn(step, turned)
                    if step.orientation is not None:
                        name, free = step.orientation, None
                    motion.move({side: at}, get_orientation(), spacing=step.spacing)
                case Via(targets=targets) if side in targets:
                    way: dict[Side, np.ndarray] = {side: self._compute_all(targets[side])}
                    _, ends = self._pass_through(step, way)
                    at, free = way[side][-1], ends[side]
                case Follow():
                    ways, _ = self._plan_follow(step, {**self.grasp, side: at}, get_orientation())
                    motion.follow(*ways)
                    at = ways[0][side][-1]
                case Retreat():
                    plan_leave(motion, {side: at}, get_orientation(), step)

    def _pass_through(
        self, step: Via, ways: Mapping[Side, np.ndarray]
    ) -> tuple[np.ndarray, dict[Side, np.ndarray]]:
        towards = None if step.towards is None else self._compute(step.towards)
        return self.hands.motion.pass_through(ways, spacing=step.spacing, towards=towards)

    def _plan_coming(self, side: Side, turn: float) -> None:
        self._plan_approach({side: self.grasp[side]}, {side: turn})

    def _plan_approach(
        self, grasp: Mapping[Side, np.ndarray], turns: Mapping[Side, float]
    ) -> np.ndarray:
        step = self.stage.approach
        orientations: dict[Side, np.ndarray] = {
            side: orient(step.orientation, side, turn) for side, turn in turns.items()
        }
        return plan_approach(
            self.hands.motion, grasp, orientations, come_from=step.come_from, spacing=step.spacing
        )

    def _place(self, side: Side, point: np.ndarray) -> np.ndarray:
        """Compute the grasp point of a hand at a point of the garment [m], shape (3,)."""
        step = self.stage.approach
        height = point[2] if step.height is None else step.height
        grasp = np.array([point[0], point[1], height], dtype=float)
        if step.short_by:
            grasp -= step.short_by * point_along_fingers(orient(step.orientation, side))
        return grasp

    def _compute_turn(self, step: Move, before: float) -> float:
        """Compute the turn of both hands at the end of a move, counter-clockwise [rad]."""
        if step.turn is None:
            return before
        return float(np.radians(self._compute((step.turn,))[0]))

    def _compute(self, formulas: Sequence[str]) -> np.ndarray:
        try:
            names = self._known
            return np.array([evaluate_formula(formula, names) for formula in formulas])
        except ValueError as err:
            raise DemonstrationError(f"stage {self.stage.name!r}: {err}") from err

    def _compute_all(self, way: Sequence[Sequence[str]]) -> np.ndarray:
        return np.stack([self._compute(formulas) for formulas in way])

    @property
    def _known(self) -> Mapping[str, Value]:
        # before the first look, the garment is expected at the grasp points
        hands = {f"{side}_hand": place for side, place in self.grasp.items()}
        names = {**self.names, "now": {**describe_cloud(self.cloud), **hands}, **self.seen}
        for name, formula in self.stage.definitions.items():
            known = self.seen.get(name)
            names[name] = evaluate_formula(formula, names) if known is None else known
        return names

    # Carrying it out -------------------------------------------------------------------------

    def iterate_scripted(self, *, is_after: bool) -> Iterator[Step]:
        """Iterate over the unrecorded steps before or after the recorded ones.

        Without recorded steps, all come before.
        """
        is_past = False
        for step in self.stage.steps:
            is_past |= step.recorded
            if not step.recorded and is_past == is_after:
                yield step

    def perform(self, step: Step) -> Part:
        """Carry out one step of the demonstration.

        Raises:
            HoldLost: If the hands have lost the garment, and that ends the stage.
            UnreachableError: If a target is out of reach.
        """
        hands, motion = self.hands, self.hands.motion
        recorded = "stage" if step.recorded else None
        match step:
            case Approach():
                self._orientation = step.orientation
                yield from hands.approach(self._plan_approach(self.grasp, self._turns))
            case HandPose(pose=pose):
                rows = motion.set_hands(dict.fromkeys(step.hands or self.grasp, pose))
                yield from hands.send(rows, recorded=recorded)
                self._has_released |= isinstance(step, Release)
                self._has_closed = True
            case Move():
                self._orientation = step.orientation or self._orientation
                self._turned = self._compute_turn(step, self._turned)
                if step.orientation is not None:
                    self._free.clear()
                targets: dict[Side, np.ndarray] = {
                    side: self._compute(formulas) for side, formulas in step.targets.items()
                }
                rows = motion.move(targets, self.orientations, spacing=step.spacing)
                yield from self._carry(step, rows, targets)
            case Via():
                ways: dict[Side, np.ndarray] = {
                    side: self._compute_all(way) for side, way in step.targets.items()
                }
                rows, ends = self._pass_through(step, ways)
                self._free |= ends
                targets = {side: way[-1] for side, way in ways.items()}
                yield from self._carry(step, rows, targets)
            case Stretch():
                if self.hold == "all":  # a lost garment cannot be stretched
                    yield from self._stretch(step)
                    yield from self._check(step, "stretch")
            case Look():
                yield from self.hands.look(GARMENT_CAMERA)
                self.seen["now"] = self._look()
                self._turn_further(after=step)
            case Wait(frames=frames):
                yield from hands.send(motion.hold(frames), recorded=recorded)
            case Follow():
                yield from self._follow(step, recorded)
            case Retreat():
                yield from hands.retreat(self.stage.hands, step)

    def _carry(
        self, step: Move | Via, rows: np.ndarray, targets: Mapping[Side, np.ndarray]
    ) -> Part:
        """Move the hands to their targets [m], and check the hold at the end."""
        recorded = "stage" if step.recorded else None
        if isinstance(step, Via) and step.tension and step.towards:
            towards = self._compute(step.towards)
            yield from self.hands.send_taut(rows, step.tension, towards=towards, recorded=recorded)
            targets, _ = self.hands.get_hands(tuple(targets))
        else:
            yield from self.hands.send(rows, recorded=recorded)
        self._targets |= targets
        if self._has_closed and not self._has_released:
            yield from self._check(step, f"move {self._lifts + 1}")
            self._lifts += 1

    def _check(self, step: Move | Via | Stretch, where: str) -> Part:
        """Check the hold, if the step asks for it."""
        if step.checked and self.reaction != "ignore":
            yield from self.hands.look(ENVIRONMENT_CAMERA)
            self.react(self.find_empty())
        stage, is_first = self.stage, self._lifts == 0
        yield from self.hands.mark(
            Carrying(stage=stage.name, hands=stage.hands, is_first=is_first, where=where)
        )

    def _look(self) -> dict[str, Value]:
        sensed = self.hands.sensed
        hands = {f"{side}_hand": sensed.get_grasp_point(side) for side in SIDES}
        return {**describe_cloud(sensed.see_garment()), **hands}

    def _turn_further(self, *, after: Step) -> None:
        """Turn the hands for the steps to come, whose targets follow from the last look."""
        steps = self.stage.steps
        to_come = steps[next(k for k, step in enumerate(steps) if step is after) + 1 :]
        places = self.grasp | self._targets

        def rehearse(side: Side, more: float) -> None:
            self._rehearse(to_come, side, self._turns[side] + more, at=places[side])

        further = self.hands.motion.choose_turns(tuple(self._turns), rehearse)
        self._turns = {side: turn + further[side] for side, turn in self._turns.items()}

    def find_empty(self) -> set[Side]:
        """Find raised working hands that are empty; none if the garment is out of sight."""
        sensed = self.hands.sensed
        try:
            return set(find_empty(sensed, self.stage.hands, sensed.see_points()))
        except PerceptionError:
            return set()

    def react(self, empty: set[Side]) -> None:
        """React to empty hands.

        Raises:
            HoldLost: If that ends the stage.
        """
        if not empty or self.reaction == "ignore":
            return
        self.hold = "some"
        if self.reaction == "give up" or len(empty) == len(self.stage.hands):
            raise HoldLost

    def _stretch(self, step: Stretch) -> Part:
        """Move the hands apart until the garment between them is taut, and measure it."""
        hands, motion = self.hands, self.hands.motion
        recorded = "stage" if step.recorded else None
        targets = dict(self._targets)
        outwards = targets["right"] - targets["left"]
        outwards /= np.linalg.norm(outwards)
        yield from hands.send(motion.hold(SWING_FRAMES), recorded=recorded)
        hanging = (yield from hands.look(ENVIRONMENT_CAMERA)).see_hanging()
        for _ in range(round(step.at_most / step.by)):
            # an edge as low as the garment is long: the garment hangs from one hand
            if not step.sag < hanging.sag < hanging.length:
                break
            targets["left"] = targets["left"] - step.by * outwards
            targets["right"] = targets["right"] + step.by * outwards
            rows = motion.move(targets, self.orientations, spacing=step.spacing)
            yield from hands.send(rows, recorded=recorded)
            before = hanging
            hanging = (yield from hands.look(ENVIRONMENT_CAMERA)).see_hanging()
            if hanging.sag > before.sag - LEAST_RISE:
                break  # it slips from a hand
        span = float(np.linalg.norm(targets["right"] - targets["left"]))
        self.seen |= {
            "half_span": span / 2,
            "hanging": hanging.length,
        }

    def _plan_follow(
        self,
        step: Follow,
        starts: Mapping[Side, np.ndarray],
        orientations: Mapping[Side, np.ndarray],
    ) -> tuple[FollowedWays, float]:
        """Plan the hands' ways, and tell the standard deviation of their ends [m]."""
        if self.skill is None:
            raise DemonstrationError(f"stage {self.stage.name!r}: no recordings to follow")
        way = self.skill.plan(self.stage.name, starts, list_anchors(self.names))
        span = HandSpan(self.hands.motion.robot)
        points, turned, joints = {}, {}, {}
        for side, q in orientations.items():
            points[side], turns, poses = change_way(way.hands[side], starts[side], side, step)
            turned[side] = to_quaternion(to_rotation(q) * Rotation.from_rotvec(turns))
            joints[side] = span.to_joints(poses)
        return (points, turned, joints), way.spread

    def _follow(self, step: Follow, recorded: Literal["stage"] | None) -> Part:
        """Follow the recordings, and watch the hold."""
        hands, motion = self.hands, self.hands.motion
        starts = self.grasp | self._targets
        ways, spread = self._plan_follow(step, starts, self.orientations)
        yield from hands.mark(Believes(values={f"spread_{self.stage.name}_m": spread}))
        rows = motion.follow(*ways, must_reach=False)
        watch = HoldWatch(hands, self.stage.hands)
        self._has_closed = True
        for part in np.split(rows, range(FOLLOW_FRAMES, len(rows), FOLLOW_FRAMES)):
            yield from hands.send(part, recorded=recorded)
            watch.note(part[-1])
            yield from hands.look(ENVIRONMENT_CAMERA)
            self.react(watch.confirm(self.find_empty()))


def _to_inward(turn: float, side: Side) -> float:
    """Convert a counter-clockwise turn [rad] to one towards the other hand."""
    return turn if side == "right" else -turn


def _get_places(point: np.ndarray, cloud: np.ndarray) -> np.ndarray:
    """Find spaced points of a cloud around a point [m], shape (M, 3), nearest first."""
    distances = np.linalg.norm(cloud[:, :2] - point[:2], axis=1)
    order = np.argsort(distances, kind="stable")
    order = order[distances[order] <= REACHABLE_WITHIN]
    squares = np.floor(cloud[order, :2] / REACHABLE_SPACING)
    _, first = np.unique(squares, axis=0, return_index=True)
    return cloud[order[np.sort(first)]]
