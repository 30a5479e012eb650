"""Parts of a demonstration: stages, each a sequence of typed steps."""

import keyword
import unicodedata
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, ClassVar, Literal, TypeAlias

import numpy as np
from annotated_types import Ge, Le, Len
from pydantic import AfterValidator, BeforeValidator, PlainValidator

from dgl_assets.robots import HAND_POSES, SIDES, Side
from dgl_collect.formula import FUNCTIONS
from dgl_collect.parameters import Parameter
from dgl_files.fields import STRICT, check_fields, from_plain, show
from dgl_tasks.grasps import Orientation, find_sides
from dgl_tasks.handling import APPROACH_FROM, WayOut

GARMENT_NAMES = ("min", "max", "centre")
"""Corners and centre of the visible garment: `garment.min.x` and so on in formulas."""
CONDITION_NAMES = ("round", "held", "skipped", "value")
"""Further names that the condition of a stage may use."""
SEEN_NAMES = ("half_span", "hanging")
"""Measurements of a stretch, by their names in formulas."""
_TAKEN = {"garment", "now", *CONDITION_NAMES, *SEEN_NAMES, *FUNCTIONS}


def _check_name(name: str) -> str:
    plain = name.isidentifier() and not keyword.iskeyword(name) and len(name) <= 64
    if not plain or unicodedata.normalize("NFKC", name) != name:
        raise ValueError(
            f"a name must be at most 64 letters, digits and '_', and start with a letter; "
            f"got {show(name)}"
        )
    if name in _TAKEN - set(SEEN_NAMES):  # a stage may define values that a stretch will measure
        raise ValueError(f"a name must not be one that formulas have already; got {name!r}")
    return name


def _check_pose(name: str) -> str:
    if name not in HAND_POSES:
        raise ValueError(f"a hand pose is one of {sorted(HAND_POSES)}; got {show(name)}")
    return name


def _to_formula(value: object) -> object:
    """Write a number as a formula."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return str(value) if is_number else value


def _to_point(value: Any) -> np.ndarray:
    numbers = value.tolist() if isinstance(value, np.ndarray) else value
    is_list = isinstance(numbers, list | tuple) and len(numbers) == 3
    if not is_list or not all(type(v) in (int, float) for v in numbers):
        raise ValueError(f"a point must be three numbers [m]; got {show(value)}")
    if not all(abs(v) <= 3 for v in numbers):
        raise ValueError(f"a point must be three numbers within 3 m; got {show(value)}")
    return np.array(numbers, dtype=np.float64)


Formula: TypeAlias = Annotated[str, BeforeValidator(_to_formula)]
Formulas: TypeAlias = tuple[Formula, Formula, Formula]
"""Position x, y, z [m], world frame, as formulas; see `dgl_collect.formula`."""
Name: TypeAlias = Annotated[str, AfterValidator(_check_name)]
"""Name of a point or a definition, as formulas use it."""
PoseName: TypeAlias = Annotated[str, AfterValidator(_check_pose)]
"""One of `HAND_POSES`."""
Distance: TypeAlias = Annotated[float, Ge(1e-3), Le(3.0)]
Offset: TypeAlias = Annotated[float, Ge(-1.0), Le(1.0)]
Force: TypeAlias = Annotated[float, Ge(0.1), Le(100.0)]
Spacing: TypeAlias = Annotated[float, Ge(1e-4), Le(0.1)]
"""Distance between samples of a line [m], one a control step; 0.01 is 0.6 m/s."""
Frames: TypeAlias = Annotated[int, Ge(1), Le(3600)]
"""Control steps of 1/60 s; one minute at most."""
OnLoss: TypeAlias = Literal["again", "lay down"]
"""Reaction to an empty hand. `again`: release, and begin the stage again, up to three tries. `lay
down`: go on, and lay down what the other hand holds."""


@dataclass(frozen=True, kw_only=True)
class Step:
    """One motion of the hands.

    Raises:
        ValueError: If a field is of another type, or out of its range.
    """

    __pydantic_config__: ClassVar = STRICT

    recorded: bool = True
    """Record the step; a policy learns recorded steps and replaces them."""

    def __post_init__(self) -> None:
        check_fields(self)


@dataclass(frozen=True, kw_only=True)
class Approach(Step):
    """Bring the open hands beside the grasp points, then straight to them."""

    recorded: bool = False
    orientation: Orientation = "standard"
    """Orientation of the hands; they turn about the vertical only if later steps need it."""
    height: Annotated[float, Ge(-0.5), Le(3.0)] | None = 0.03
    """Height of the grasp points above the ground [m]; None keeps the matched height."""
    short_by: Offset = 0.0
    """Distance by which a hand stops short of the grasp point, along its fingers [m], to grasp less
    of the cloth beyond."""
    come_from: tuple[Offset, Offset, Offset] = APPROACH_FROM
    """Offset of the start of the straight line [m]; x points outward for both hands."""
    spacing: Spacing = 0.01


@dataclass(frozen=True, kw_only=True)
class HandPose(Step):
    """Give the working hands a pose."""

    pose: PoseName
    hands: Annotated[tuple[Side, ...], Len(1)] | None = None
    """Hands that take it; None for all working hands."""


@dataclass(frozen=True, kw_only=True)
class Release(HandPose):
    """Open the working hands, which hold nothing afterwards."""

    pose: PoseName = "open"


@dataclass(frozen=True, kw_only=True)
class Move(Step):
    """Move grasp points along straight lines that begin and end together."""

    targets: Mapping[Side, Formulas]
    """Target of each moving hand."""
    orientation: Orientation | None = None
    """Orientation of the hands at the end; None keeps it."""
    turn: Formula | None = None
    """Turn of both hands about the vertical at the end, counter-clockwise [degrees], beside that of
    the orientation: with an object that stands turned. None keeps it."""
    spacing: Spacing = 0.01
    """Spacing on the longer line."""
    checked: bool = False
    """Check at the end if the hands hold the garment."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.targets:
            raise ValueError(f"a move has targets for some of {SIDES}; got none")


@dataclass(frozen=True, kw_only=True)
class Via(Step):
    """Carry grasp points through via points without a stop, clear of objects to be avoided.

    The hands turn as the arms need, palms down; all pass their points of one number together.
    """

    targets: Mapping[Side, Annotated[tuple[Formulas, ...], Len(1, 200)]]
    """Via points and goal of each moving hand."""
    towards: Formulas | None = None
    """Position that the fingers point at where the arms allow it: closed fingers hold most against
    a pull along them."""
    spacing: Spacing = 0.01
    """Spacing on the longer line."""
    tension: Mapping[Side, Force] = field(default_factory=dict)
    """Pull of the garment, from `towards`, that these hands keep by shifts from their way [N]."""
    checked: bool = False
    """As in `Move`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        counts = {side: len(points) for side, points in self.targets.items()}
        if len(set(counts.values())) != 1:
            raise ValueError(f"hands must have equally many via points; got {counts}")
        if self.tension and (self.towards is None or not set(self.tension) <= set(self.targets)):
            raise ValueError("a tension needs `towards` and via points of its hands")


@dataclass(frozen=True, kw_only=True)
class Stretch(Step):
    """Move both hands apart until the camera sees a taut garment between them.

    Afterwards `half_span`, half the distance of the hands [m], and `hanging`, the length of the
    garment below them [m], have their measured values instead of those in the definitions.
    """

    sag: Distance
    """Largest distance of the taut upper edge below the hands, midway between them [m]."""
    by: Distance
    """Distance that each hand moves between two looks [m]."""
    at_most: Distance
    """Distance that each hand moves in all, at most [m]."""
    spacing: Spacing
    checked: bool = False
    """As in `Move`."""


@dataclass(frozen=True, kw_only=True)
class Look(Step):
    """Look at the garment in the hands, from above.

    In a stage with a look, formulas may use `now.min`, `now.max` and `now.centre`, corners and
    centre of the garment as last seen, and `now.left_hand` and `now.right_hand`, the grasp points
    at that time [m]; before the first look, those of the grasp. If a target is then out of reach,
    the hands turn about the vertical, as at the beginning.
    """


@dataclass(frozen=True, kw_only=True)
class Follow(Step):
    """Follow the way that a primitive has learnt from recordings, fingers included.

    The numbers change the way; a search may tune them.
    """

    speed: Annotated[float, Ge(0.1), Le(10.0)] = 1.0
    """Factor on the speed."""
    lift: Annotated[float, Ge(0.1), Le(10.0)] = 1.0
    """Factor on heights above the grasp point."""
    shift: tuple[Offset, Offset, Offset] = (0.0, 0.0, 0.0)
    """Offset of the end [m], which grows along the way; x points outward for both hands."""


@dataclass(frozen=True, kw_only=True)
class Wait(Step):
    """Keep the hands still."""

    frames: Frames


@dataclass(frozen=True, kw_only=True)
class Retreat(Step, WayOut):
    """Draw the open hands out of the garment, and park the arms."""

    recorded: bool = False
    pose: PoseName = "flat"


STEPS: Mapping[str, type[Step]] = {
    "approach": Approach,
    "hand_pose": HandPose,
    "move": Move,
    "via": Via,
    "stretch": Stretch,
    "release": Release,
    "retreat": Retreat,
    "wait": Wait,
    "follow": Follow,
    "look": Look,
}
"""Name of a step in files to its class."""


def _to_step(content: Any) -> Step:
    """Make a step of its JSON object."""
    if isinstance(content, Step):
        return content
    if not isinstance(content, dict) or content.get("step") not in list(STEPS):
        kind = content.get("step") if isinstance(content, dict) else content
        raise ValueError(f"a step is one of {sorted(STEPS)}; got {show(kind)}")
    kind = STEPS[content["step"]]
    fields = {key: value for key, value in content.items() if key != "step"}
    if kind in (Move, Via):
        fields["targets"] = {side: fields.pop(side) for side in SIDES if side in fields}
    return from_plain(kind, fields)


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Grasp point of a hand: a point of the garment, the middle of several, or a position."""

    __pydantic_config__: ClassVar = STRICT

    points: tuple[str, ...] = ()
    """Names of points of the demonstration. The middle of several grasps layers whose edges do not
    lie exactly on each other."""
    at: Formulas | None = None
    """A position instead, for garments whose shape decides the grasp point."""

    def __post_init__(self) -> None:
        check_fields(self)
        if (self.at is None) == (not self.points):
            raise ValueError(f"a grasp must have either points or a position; got {self}")


def _to_grasp(content: Any) -> Grasp:
    """Make a grasp of a point's name, a list of them, or a JSON object."""
    if isinstance(content, Grasp):
        return content
    if isinstance(content, str | list):
        content = {"points": [content] if isinstance(content, str) else content}
    return from_plain(Grasp, content)


@dataclass(frozen=True, kw_only=True)
class Stage:
    """One part of a task, from parked arms to parked arms."""

    __pydantic_config__: ClassVar = STRICT

    name: Annotated[str, Len(1, 64)]
    grasp: Mapping[Side, Annotated[Grasp, PlainValidator(_to_grasp)]]
    """Grasp point of each working hand."""
    steps: tuple[Annotated[Step, PlainValidator(_to_step)], ...]
    definitions: Mapping[Name, Formula] = field(default_factory=dict)
    """Numbers by name, as formulas; each may use the ones before it."""
    looks_again: bool = False
    """Find the points again when the stage begins, after earlier stages have changed the
    garment."""
    moved_at_most: Annotated[float, Ge(1e-3), Le(10.0)] | None = 0.15
    """Largest distance of a grasp point from its first position [m], since the shape of a folded
    garment does not tell left from right. None if an earlier stage has moved it on purpose."""
    on_loss: OnLoss = "again"
    again: bool = True
    """Repeat this stage in later rounds."""
    when: str | None = None
    """Condition for the stage to begin: a formula over points, objects and the visible garment at
    rest. It may also use `round`, counted from 1; `held`, true if the stage before kept its hold;
    `skipped`, true if the last round skipped this stage; and `value`, the value of the rule in the
    belief."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.name.isprintable():
            raise ValueError(f"name must be printable; got {show(self.name)}")
        if not self.grasp:
            raise ValueError(f"grasp must be of some of {SIDES}; got none")
        marks = "".join("r" if step.recorded else "-" for step in self.steps).strip("-")
        if "-" in marks:
            raise ValueError(f"recorded steps must follow each other; got {marks}")
        approaches = sum(isinstance(step, Approach) for step in self.steps)
        if approaches != 1:
            raise ValueError(f"steps must have one approach; got {approaches}")
        has_closed = has_released = False
        for step in self.steps:
            if getattr(step, "checked", False) and (has_released or not has_closed):
                raise ValueError(
                    "checked must be of steps between the hands' closing and their release"
                )
            has_closed |= isinstance(step, HandPose)
            has_released |= isinstance(step, Release)
            if isinstance(step, Stretch) and len(self.grasp) < len(SIDES):
                raise ValueError(f"a stretch needs both hands; got {sorted(self.grasp)}")
            if isinstance(step, Move | Via) and set(step.targets) - set(self.grasp):
                raise ValueError(
                    f"moves must be of {sorted(self.grasp)}; got {sorted(step.targets)}"
                )
            if isinstance(step, HandPose) and set(step.hands or ()) - set(self.grasp):
                raise ValueError(f"hands must be of {sorted(self.grasp)}; got {step.hands}")
            named = step.orientation if isinstance(step, Approach | Move) else None
            lacking = [s for s in self.grasp if named and s not in find_sides(named)]
            if lacking:
                raise ValueError(f"orientation {named!r} is not for the {lacking[0]} hand")

    @property
    def is_learned(self) -> bool:
        """True if a policy learns the stage; otherwise it is scripted for every actor."""
        return any(step.recorded for step in self.steps)

    @property
    def hands(self) -> tuple[Side, ...]:
        """The working hands."""
        return tuple(side for side in SIDES if side in self.grasp)

    @property
    def approach(self) -> Approach:
        """The approach."""
        return next(step for step in self.steps if isinstance(step, Approach))

    @property
    def grasp_pose(self) -> str:
        """The hand pose of the grasp: the last one before the release."""
        poses = [s for s in self.steps if isinstance(s, HandPose)]
        held = [s.pose for s in poses if not isinstance(s, Release)]
        return held[-1] if held else "close"

    @property
    def retreat(self) -> Retreat:
        """The retreat."""
        return next((step for step in self.steps if isinstance(step, Retreat)), Retreat())


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """One demonstration on one garment."""

    __pydantic_config__: ClassVar = STRICT

    task: Annotated[str, Len(1, 200)]
    garment: Annotated[str, Len(1, 200)]
    """Catalogue id of the demonstrated garment."""
    points: Mapping[Name, Annotated[np.ndarray, PlainValidator(_to_point)]]
    """Marked points [m], shape (3,), in the frame of that garment lying flat."""
    stages: tuple[Stage, ...]
    rounds: Annotated[int, Ge(1), Le(100)] = 1
    """Most rounds; the task ends once it is believed done."""
    parameters: Mapping[Name, Parameter] = field(default_factory=dict)
    """Numbers that formulas use by name; `dgl tune` searches their ranges."""
    recordings: Annotated[str, Len(1, 4096)] | None = None
    """Folder of episodes, or file of primitives, whose ways the `follow` steps take; relative to
    the demonstration's file."""
    turns_over: bool = False
    """The garment may end face down, with left and right exchanged; the hands then exchange their
    points."""

    def __post_init__(self) -> None:
        check_fields(self)
        if not self.stages:
            raise ValueError("stages must have at least one stage; got none")
        names = [stage.name for stage in self.stages]
        defined = {name for stage in self.stages for name in stage.definitions}
        if twice := set(self.parameters) & ({*self.points} | defined):
            raise ValueError(f"parameters must not have the names of others; got {sorted(twice)}")
        if len(set(names)) < len(names):
            raise ValueError(f"stages must have different names; got {names}")
        first = self.stages[0].grasp
        if self.turns_over and (len(first) < 2 or any(g.at for g in first.values())):
            raise ValueError("turns_over needs a first stage in which both hands grasp points")

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters, as formulas name them."""
        return {name: parameter.value for name, parameter in self.parameters.items()}

    @property
    def learned_stages(self) -> tuple[Stage, ...]:
        """The stages that a policy learns."""
        return tuple(stage for stage in self.stages if stage.is_learned)
