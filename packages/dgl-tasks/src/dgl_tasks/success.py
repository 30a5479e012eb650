"""Success rules: pure functions of a scene, which give named criteria with what was measured."""

import math
import operator
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Literal, Protocol, runtime_checkable

import numpy as np

from dgl_tasks.fields import check_fields

AREA_CELL = 0.01
"""Side of the cells in which covered area is counted [m]."""

TOP = 0.02
"""What is lower than the highest point by less than this counts as a garment's highest part [m]."""

_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}

Box = tuple[float, float, float, float]
"""A horizontal box: x low, y low, x high, y high [m]."""


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """One condition of a success rule, with what was measured."""

    name: str
    """What is measured, such as `share inside the box`."""
    value: float
    """The measured value."""
    comparison: Literal["<", "<=", ">", ">="]
    """How the value must compare with the threshold."""
    threshold: float
    """The limit."""
    unit: str = ""
    """Unit of value and threshold."""
    failure: str = "below the threshold"
    """What not to meet it is called, in words that can be counted."""

    @property
    def is_met(self) -> bool:
        """Whether the value satisfies the condition."""
        return bool(_COMPARE[self.comparison](self.value, self.threshold))


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a rule."""

    criteria: tuple[Criterion, ...]
    """All of them have to be met; the first is the one that the task is about."""
    box: Box | None = None
    """The box that the rule looked at, for pictures."""

    def __post_init__(self) -> None:
        if not self.criteria:
            raise ValueError("criteria must have at least one criterion; got none")

    @property
    def success(self) -> bool:
        """Whether all criteria are met."""
        return self.reason is None

    @property
    def reason(self) -> str | None:
        """What the first criterion that is not met is called; None for a success."""
        return next((c.failure for c in self.criteria if not c.is_met), None)

    @property
    def value(self) -> float:
        """What was measured for the first criterion."""
        return self.criteria[0].value

    def describe_shortfalls(self) -> str:
        """Put what is not met into words."""
        return "; ".join(
            f"{c.name}: {c.value:.3f}{c.unit}, needed {c.comparison} {c.threshold:g}{c.unit}"
            for c in self.criteria
            if not c.is_met
        )


class SceneView(Protocol):
    """What a rule judges: the scene as it is, or as somebody believes it to be."""

    @property
    def top(self) -> np.ndarray:
        """What can be seen of the garment from straight above [m], shape (N, 3): each point stands for the same area.

        N is 0 when it is out of sight.
        """
        ...

    @property
    def surface(self) -> np.ndarray:
        """Points all over the garment [m], shape (N, 3)."""
        ...

    @property
    def tilt(self) -> float:
        """How far the garment as a whole leans from how it stands upright [rad]; NaN where that is not known."""
        ...

    @property
    def landmarks(self) -> Mapping[str, np.ndarray]:
        """Places of the garment by name as it lay before it was touched [m], shape (3,)."""
        ...

    @property
    def flat_area(self) -> float:
        """Area that the garment covers when it lies flat [m^2], counted as `compute_covered_area` does."""
        ...

    @property
    def frames(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """Named places of the objects in the scene, by object and name [m], shape (3,)."""
        ...


@runtime_checkable
class SuccessRule(Protocol):
    """Judges a scene."""

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Names of the places in `SceneView.landmarks` that the rule needs."""
        ...

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the objects' places that the rule needs, such as "hanger.target"."""
        ...

    def __call__(self, view: SceneView) -> Verdict:
        """Judge what is there."""
        ...


def compute_covered_area(points: np.ndarray, *, cell: float = AREA_CELL) -> float:
    """Compute the horizontal area that points cover.

    Args:
        points: At most half of `cell` apart where there is cloth [m], shape (N, 2) or (N, 3).
        cell: Side of the cells that are counted [m].

    Returns:
        Area of the cells with a point in them [m^2]; larger than the true one by about half a cell
        along the outline, for whatever is compared with it as well. None is covered without points.

    Raises:
        ValueError: If the shape is another one.
    """
    points = _check_points(points)
    return len(np.unique(np.floor(points[:, :2] / cell).astype(np.int64), axis=0)) * cell**2


def compute_box_share(points: np.ndarray, box: Box) -> float:
    """Compute the share of points inside a horizontal box.

    Args:
        points: [m], shape (N, 2) or (N, 3), world frame.
        box: Its sides [m].

    Returns:
        Share in [0, 1]; 0 without points: of what is out of sight nothing is seen to be inside.

    Raises:
        ValueError: If the shape is another one.
    """
    points = _check_points(points)
    if len(points) == 0:
        return 0.0
    x0, y0, x1, y1 = box
    inside = (
        (points[:, 0] >= x0) & (points[:, 0] <= x1) & (points[:, 1] >= y0) & (points[:, 1] <= y1)
    )
    return float(inside.mean())


def _check_numbers(rule: object, *shares: str) -> None:
    """Check the types of a rule's fields, that its numbers are not negative, and that shares are at most 1.

    Raises:
        ValueError: If one is not.
    """
    check_fields(rule)
    for declared in fields(rule):  # pyright: ignore[reportArgumentType] - rules are dataclasses
        value = getattr(rule, declared.name)
        if declared.type not in (float, float | None) or value is None:
            continue
        most = 1.0 if declared.name in shares else math.inf
        if not 0 <= value <= most:
            allowed = "in [0, 1]" if most == 1.0 else "a finite number of at least 0"
            raise ValueError(f"{declared.name} must be {allowed}; got {value!r}")


@dataclass(frozen=True, kw_only=True)
class ShareInBox:
    """Enough of what is seen from above lies inside a box of key points of the garment before it was touched."""

    left: tuple[str, ...]
    """Points whose mean x is the left side of the box."""
    right: tuple[str, ...]
    """Points whose mean x is the right side."""
    near: str
    """Point whose y is the side next to the robots."""
    far: str
    """Point whose y is the far side."""
    margins: tuple[float, float, float, float]
    """How far the box reaches beyond its left, near, right and far side [m]."""
    threshold: float
    """Least share of the visible area, in [0, 1]."""
    frames: tuple[str, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        _check_numbers(self, "threshold")

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Names of the key points."""
        return tuple(dict.fromkeys((*self.left, *self.right, self.near, self.far)))

    def __call__(self, view: SceneView) -> Verdict:
        """Measure the share of the visible points inside the box."""
        left, right = (
            float(np.mean([view.landmarks[name][0] for name in side]))
            for side in (self.left, self.right)
        )
        near, far = (float(view.landmarks[name][1]) for name in (self.near, self.far))
        box = (
            left - self.margins[0],
            near - self.margins[1],
            right + self.margins[2],
            far + self.margins[3],
        )
        share = Criterion(
            name="share of the garment's visible area inside the box of the key points",
            value=compute_box_share(view.top, box),
            comparison=">=",
            threshold=self.threshold,
        )
        return Verdict(criteria=(share,), box=box)


@dataclass(frozen=True, kw_only=True)
class CoversFlatArea:
    """The garment covers nearly the area that it covers when it lies flat (paper)."""

    tolerance: float = 0.2
    """How far the ratio of the areas may be from 1; the paper's bound, which it must stay below."""
    landmarks: tuple[str, ...] = field(default=(), init=False)
    frames: tuple[str, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        _check_numbers(self, "tolerance")

    def __call__(self, view: SceneView) -> Verdict:
        """Compare the covered area with the flat one."""
        ratio = compute_covered_area(view.top) / view.flat_area
        flatness = Criterion(
            name="1 - |1 - covered area / area of the flat garment|",
            value=1.0 - abs(1.0 - ratio),
            comparison=">",
            threshold=1.0 - self.tolerance,
        )
        return Verdict(criteria=(flatness,))


@dataclass(frozen=True, kw_only=True)
class AtPlace:
    """What rules about a place of an object share."""

    place: str
    """The object's place, such as "hanger.target"."""
    landmarks: tuple[str, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        _check_numbers(self)

    @property
    def frames(self) -> tuple[str, ...]:
        """The place alone."""
        return (self.place,)

    def get_target(self, view: SceneView) -> np.ndarray:
        """Look the place up [m], shape (3,)."""
        owner, _, name = self.place.partition(".")
        return view.frames[owner][name]


@dataclass(frozen=True, kw_only=True)
class HangsOver(AtPlace):
    """The garment hangs over a bar or a hook at the place, in its middle, and hardly any of it is near the ground."""

    sideways: float
    """How far the garment's middle may be from the place in x [m]."""
    below: float | None = None
    """How far the garment's middle may be below the place [m]; as far as may be when None."""
    height: float = 0.01
    """What is lower counts as lying on the ground [m] (original code)."""
    on_ground: float = 15 / 2048
    """Largest share of the garment that may lie there (original code)."""
    over: float = 0.08
    """How far the garment's highest part may be from the place in y and z [m]."""

    def __post_init__(self) -> None:
        _check_numbers(self, "on_ground")

    def __call__(self, view: SceneView) -> Verdict:
        """Measure what lies on the ground, how far off the middle hangs, and where the garment's top is."""
        points = view.surface if len(view.surface) else np.full((1, 3), -1e3)
        target = self.get_target(view)
        middle = points.mean(axis=0)
        top = points[points[:, 2] > points[:, 2].max() - TOP].mean(axis=0)
        limits = [
            ("share of the garment on the ground", float((points[:, 2] < self.height).mean()),
             self.on_ground, "", "on the ground"),
            ("distance of the garment's middle from the bar's, sideways",
             float(abs(middle[0] - target[0])), self.sideways, " m", "off the middle"),
            ("distance of the garment's highest part from the bar",
             float(np.linalg.norm((top - target)[1:])), self.over, " m", "not over the bar"),
        ]  # fmt: skip
        if self.below is not None:
            drop = float(target[2] - middle[2])
            limits.append(
                (
                    "distance of the garment's middle below the bar",
                    drop,
                    self.below,
                    " m",
                    "too low",
                )
            )
        return _require_at_most(*limits)


@dataclass(frozen=True, kw_only=True)
class RestsOn(AtPlace):
    """The garment lies on the level top of an object: its middle is near the place, and little of it is lower."""

    within: float
    """How far the middle of what is seen of the garment from above may be from the place, horizontally [m]."""
    lower: float = 0.4
    """Largest share of the garment that may be lower than the place: what is wider than the object hangs over its edges."""
    margin: float = 0.01
    """By how much it may be lower without being counted [m]."""

    def __post_init__(self) -> None:
        _check_numbers(self, "lower")

    def __call__(self, view: SceneView) -> Verdict:
        """Measure how far off the garment's middle is, and how much of it is lower than the place."""
        target = self.get_target(view)
        top = view.top if len(view.top) else np.full((1, 3), 1e3)
        points = view.surface if len(view.surface) else np.full((1, 3), -1e3)
        off = np.linalg.norm((top.mean(axis=0) - target)[:2])
        lower = (points[:, 2] < target[2] - self.margin).mean()
        return _require_at_most(
            ("horizontal distance of the garment's middle from its place", float(off),
             self.within, " m", "not in its place"),
            ("share of the garment that is lower than its place", float(lower),
             self.lower, "", "fallen off"),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class SitsOn(AtPlace):
    """The garment is worn on a place that goes into it: its middle is near and no higher, and it is upright."""

    within: float
    """How far the garment's middle may be from the place [m]."""
    leaning: float
    """How far the garment may lean [rad]."""

    def __call__(self, view: SceneView) -> Verdict:
        """Measure how far off the garment's middle is, and how high."""
        middle = view.surface.mean(axis=0) if len(view.surface) else np.full(3, 1e3)
        off = middle - self.get_target(view)
        return _require_at_most(
            ("distance of the garment's middle from its place", float(np.linalg.norm(off)),
             self.within, " m", "not in its place"),
            ("height of the garment's middle over its place", float(off[2]),
             0.0, " m", "not put on"),
            ("how far the garment leans", view.tilt, self.leaning, " rad", "leaning"),
        )  # fmt: skip


def _require_at_most(*limits: tuple[str, float, float, str, str]) -> Verdict:
    """Judge by names, values, what these may be at most, units, and what more is called."""
    return Verdict(
        criteria=tuple(
            Criterion(
                name=name,
                value=value,
                comparison="<=",
                threshold=most,
                unit=unit,
                failure=failure,
            )
            for name, value, most, unit, failure in limits
        )
    )


def _check_points(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (N, 2 or 3); got {points.shape}")
    return points
