"""What a demonstration is made of: stages, each a sequence of typed steps."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dgl_assets.robots import HAND_POSES, SIDES, Side
from dgl_tasks.grasps import GRASP_ORIENTATIONS, GraspName
from dgl_tasks.handling import APPROACH_FROM, WayOut

Formulas = tuple[str, str, str]
"""x, y and z of a place [m], world frame, as formulas; see `dgl_collect.formula`."""
OnLoss = Literal["again", "lay down"]
"""What becomes of a stage in which a hand is seen to hold nothing: the hands let go and begin it again, three times at
most; or they go on, and lay down what one of them still holds."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One thing that the hands do."""

    recorded: bool = True
    """Whether it is part of what is recorded, and what a policy learns and then does in its own way."""


@dataclass(frozen=True, kw_only=True)
class Approach(Step):
    """The open hands come to where the stage grasps: to a place beside it, and straight there."""

    recorded: bool = False
    orientation: GraspName = "standard"
    """Of the hands; they are turned about the vertical as little as what follows allows."""
    height: float | None = 0.03
    """Height of the grasp points over the ground [m]: a hand closes around what lies there. None takes that of the places."""
    short_by: float = 0.0
    """How far before the grasp point a hand stops, along its fingers [m]: it takes less of what lies beyond."""
    come_from: tuple[float, float, float] = APPROACH_FROM
    """Offset of the place beside it [m]; its x is outward for both hands."""
    spacing: float = 0.01
    """Distance between samples of the line from there [m], one a control step; 0.01 is 0.6 m/s."""

    def __post_init__(self) -> None:
        _check_name("orientation", self.orientation, GRASP_ORIENTATIONS)
        _check_positive("spacing", self.spacing)
        if len(self.come_from) != 3:
            raise ValueError(f"come_from must be three numbers; got {self.come_from!r}")


@dataclass(frozen=True, kw_only=True)
class HandPose(Step):
    """The working hands take a pose."""

    pose: str
    """One of `HAND_POSES`."""

    def __post_init__(self) -> None:
        _check_name("pose", self.pose, HAND_POSES)


@dataclass(frozen=True, kw_only=True)
class Release(HandPose):
    """The working hands open, and carry nothing from now on."""

    pose: str = "open"


@dataclass(frozen=True, kw_only=True)
class Move(Step):
    """Grasp points of hands go somewhere on straight lines, leaving and arriving together."""

    targets: Mapping[Side, Formulas]
    """Where those of the moving hands go."""
    orientation: GraspName | None = None
    """Of the hands at the end; None keeps it."""
    spacing: float = 0.01
    """Distance between samples of the longer line [m], one a control step; 0.01 is 0.6 m/s."""
    checked: bool = False
    """Whether it is looked, at the end, whether the hands hold the garment."""

    def __post_init__(self) -> None:
        if not self.targets or set(self.targets) - set(SIDES):
            raise ValueError(f"a move has targets for some of {SIDES}; got {sorted(self.targets)}")
        for side, formulas in self.targets.items():
            if len(formulas) != 3:
                raise ValueError(f"{side} must have formulas for x, y, z; got {formulas!r}")
        if self.orientation is not None:
            _check_name("orientation", self.orientation, GRASP_ORIENTATIONS)
        _check_positive("spacing", self.spacing)


@dataclass(frozen=True, kw_only=True)
class Stretch(Step):
    """Both hands move apart until what hangs between them is seen to be taut.

    Then `half_span`, half the distance of the hands [m], and `hanging`, how far the garment hangs below them [m], are what is
    seen, whatever the stage's definitions have expected.
    """

    sag: float
    """How far the upper edge may hang below the hands midway between them [m]."""
    by: float
    """How much farther each hand moves at a time [m]."""
    at_most: float
    """How much farther each hand moves in all [m]."""
    spacing: float
    """As in `Move`."""
    checked: bool = False
    """As in `Move`."""

    def __post_init__(self) -> None:
        for name in ("sag", "by", "at_most", "spacing"):
            _check_positive(name, getattr(self, name))


SEEN_NAMES = ("half_span", "hanging")
"""What a stretch sees, by its name in formulas."""


@dataclass(frozen=True, kw_only=True)
class Look(Step):
    """The garment is looked at from above, as the hands hold it.

    Formulas and definitions of a stage with a look may name `now.min`, `now.max` and `now.centre`, corners and centre of
    what was seen of it last, and `now.left_hand` and `now.right_hand`, where the hands' grasp points were [m]; before the
    first look, where the hands have taken hold of it. Where that leads out of reach, the hands are turned about the
    vertical, as at the beginning.
    """


@dataclass(frozen=True, kw_only=True)
class Wait(Step):
    """Nothing moves but the garment."""

    frames: int
    """Control steps of 1/60 s."""

    def __post_init__(self) -> None:
        _check_positive("frames", self.frames)


@dataclass(frozen=True, kw_only=True)
class Retreat(Step, WayOut):
    """The open hands leave the garment in this way, and the arms park."""

    recorded: bool = False

    def __post_init__(self) -> None:
        _check_name("pose", self.pose, HAND_POSES)


STEPS: Mapping[str, type[Step]] = {
    "approach": Approach,
    "hand_pose": HandPose,
    "move": Move,
    "stretch": Stretch,
    "release": Release,
    "retreat": Retreat,
    "wait": Wait,
    "look": Look,
}
"""Name of a step in files to its class."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Where a hand takes hold: at a point of the garment, midway between several, or at a place."""

    points: tuple[str, ...] = ()
    """Names of points of the demonstration. Midway between several a hand takes hold of layers that do not lie quite on
    each other."""
    at: Formulas | None = None
    """A place instead, for garments whose shape alone says where."""

    def __post_init__(self) -> None:
        if (self.at is None) == (not self.points):
            raise ValueError(f"a grasp must have points or a place; got {self}")
        if self.at is not None and len(self.at) != 3:
            raise ValueError(f"a place must have formulas for x, y, z; got {self.at!r}")


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One part of a task, from parked arms to parked arms."""

    name: str
    grasp: Mapping[Side, Grasp]
    """Where each working hand takes hold."""
    steps: tuple[Step, ...]
    definitions: Mapping[str, str] = field(default_factory=dict)
    """Numbers by name, as formulas over all that is known and the numbers before them."""
    looks_again: bool = False
    """The points are found anew when the stage begins, instead of those on the initial
    garment: for a garment that the stages before have laid out differently."""
    moved_at_most: float | None = 0.15
    """How far the grasp points may have moved since the garment was first seen [m]: they are looked for this near
    to where they lay then, as what is folded no longer tells left from right. None where an earlier stage has
    moved them on purpose."""
    on_loss: OnLoss = "again"
    again: bool = True
    """Whether further rounds go through it too; what has been done by one that they leave out stays done."""
    when: str | None = None
    """A condition for it to be begun: a formula over points, objects, what is seen of the garment once it is at rest, and
    `round`, its number from 1; `held`, whether the stage before has kept hold of the garment; `skipped`, whether the last
    round left this stage out; and `value`, what the task's rule measures on what is believed of the scene."""

    def __post_init__(self) -> None:
        if not self.grasp or set(self.grasp) - set(SIDES):
            raise ValueError(f"grasp must be of some of {SIDES}; got {sorted(self.grasp)}")
        marks = "".join("r" if step.recorded else "-" for step in self.steps).strip("-")
        if "-" in marks:
            raise ValueError(f"recorded steps must follow each other; got {marks}")
        approaches = sum(isinstance(step, Approach) for step in self.steps)
        if approaches != 1:
            raise ValueError(f"steps must have one approach; got {approaches}")
        if self.moved_at_most is not None:
            _check_positive("moved_at_most", self.moved_at_most)
        has_closed = has_released = False
        for step in self.steps:
            if getattr(step, "checked", False) and (has_released or not has_closed):
                raise ValueError(
                    "checked must be of steps between the hands' closing and their release"
                )
            has_closed |= isinstance(step, HandPose)
            has_released |= isinstance(step, Release)
            if isinstance(step, Move) and set(step.targets) - set(self.grasp):
                raise ValueError(
                    f"moves must be of {sorted(self.grasp)}; got {sorted(step.targets)}"
                )
            named = step.orientation if isinstance(step, Approach | Move) else None
            lacking = [s for s in self.grasp if named and s not in GRASP_ORIENTATIONS[named]]
            if lacking:
                raise ValueError(f"orientation {named!r} is not for the {lacking[0]} hand")

    @property
    def is_learned(self) -> bool:
        """Whether a policy learns it; otherwise it is scripted whoever acts."""
        return any(step.recorded for step in self.steps)

    @property
    def hands(self) -> tuple[Side, ...]:
        """The working hands."""
        return tuple(side for side in SIDES if side in self.grasp)

    @property
    def approach(self) -> Approach:
        """The way to where it grasps."""
        return next(step for step in self.steps if isinstance(step, Approach))

    @property
    def grasp_pose(self) -> str:
        """The hand pose that takes hold: the last before the hands release."""
        poses = [s for s in self.steps if isinstance(s, HandPose)]
        held = [s.pose for s in poses if not isinstance(s, Release)]
        return held[-1] if held else "close"

    @property
    def retreat(self) -> Retreat:
        """The way out of the garment."""
        return next((step for step in self.steps if isinstance(step, Retreat)), Retreat())


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """One demonstration on one garment."""

    task: str
    garment: str
    """Catalogue id of the garment it was given on."""
    points: Mapping[str, np.ndarray]
    """Marked places [m], shape (3,), frame of that garment lying flat."""
    stages: tuple[Stage, ...]
    rounds: int = 1
    """How often the stages are gone through at most, while the task is believed not to be done."""
    turns_over: bool = False
    """The garment may come to lie on its face, its left to the right: the hands exchange their points then."""

    def __post_init__(self) -> None:
        if not self.stages:
            raise ValueError("stages must have at least one stage; got none")
        names = [stage.name for stage in self.stages]
        if len(set(names)) < len(names):
            raise ValueError(f"stages must have different names; got {names}")
        if self.rounds < 1:
            raise ValueError(f"rounds must be at least 1; got {self.rounds}")
        first = self.stages[0].grasp
        if self.turns_over and (len(first) < 2 or any(g.at for g in first.values())):
            raise ValueError("turns_over needs a first stage in which both hands grasp points")

    @property
    def learned_stages(self) -> tuple[Stage, ...]:
        """The stages that a policy learns."""
        return tuple(stage for stage in self.stages if stage.is_learned)


def _check_positive(name: str, value: float) -> None:
    if not 0 < value < np.inf:
        raise ValueError(f"{name} must be positive; got {value}")


def _check_name(what: str, name: str, known: Mapping[str, object]) -> None:
    if name not in known:
        raise ValueError(f"{what} must be one of {sorted(known)}; got {name!r}")
