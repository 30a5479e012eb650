"""Success rules: pure functions of a scene that give named criteria with measured values."""

import operator
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

import numpy as np
from annotated_types import Ge, Interval

from dgl_files.fields import adopt_fields

AREA_CELL = 0.01
"""Side of the cells in which covered area is counted [m]."""

TOP = 0.02
"""Depth of a garment's highest part, below its highest point [m]."""

_COMPARE = {"<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge}

Box = tuple[float, float, float, float]
"""A horizontal box: x low, y low, x high, y high [m]."""
Limit = Annotated[float, Ge(0.0)]
Share = Annotated[float, Interval(ge=0.0, le=1.0)]


@dataclass(frozen=True, kw_only=True)
class Criterion:
    """One condition of a success rule, with the measured value."""

    name: str
    """Measured quantity, such as `share inside the box`."""
    value: float
    """The measured value."""
    comparison: Literal["<", "<=", ">", ">="]
    """Required relation of the value to the threshold."""
    threshold: float
    unit: str = ""
    """Unit of value and threshold."""
    failure: str = "below the threshold"
    """Reason of a failure by this criterion, in words that can be counted."""

    @property
    def is_met(self) -> bool:
        """The value satisfies the condition."""
        return bool(_COMPARE[self.comparison](self.value, self.threshold))


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a rule."""

    criteria: tuple[Criterion, ...]
    """All of them have to be met; the first is the one that the task is about."""
    box: Box | None = None
    """The box of the rule, for pictures."""

    def __post_init__(self) -> None:
        if not self.criteria:
            raise ValueError("criteria must have at least one criterion; got none")

    @property
    def success(self) -> bool:
        """All criteria are met."""
        return self.reason is None

    @property
    def reason(self) -> str | None:
        """Failure of the first criterion that is not met; None for a success."""
        return next((c.failure for c in self.criteria if not c.is_met), None)

    @property
    def value(self) -> float:
        """Measured value of the first criterion."""
        return self.criteria[0].value

    def describe_shortfalls(self) -> str:
        """Put the criteria that are not met into words."""
        return "; ".join(
            f"{c.name}: {c.value:.3f}{c.unit}, needed {c.comparison} {c.threshold:g}{c.unit}"
            for c in self.criteria
            if not c.is_met
        )


class SceneView(Protocol):
    """The scene as a rule judges it: true or believed."""

    @property
    def top(self) -> np.ndarray:
        """Surface visible from straight above [m], shape (N, 3): each point stands for equal area.

        N is 0 when the garment is out of sight.
        """
        ...

    @property
    def surface(self) -> np.ndarray:
        """Points all over the garment [m], shape (N, 3)."""
        ...

    @property
    def tilt(self) -> float:
        """Lean of the whole garment from upright [rad]; NaN where it is not known."""
        ...

    @property
    def midline(self) -> np.ndarray:
        """Line along the middle of a long garment from one end to the other [m], shape (B, 3).

        B is 0 where it is not known.
        """
        ...

    @property
    def landmarks(self) -> Mapping[str, np.ndarray]:
        """Landmarks of the garment by name, before it was touched [m], shape (3,)."""
        ...

    @property
    def places(self) -> Mapping[str, np.ndarray]:
        """The rule's `marks` of the garment by name, now [m], shape (3,); none where unknown."""
        ...

    def enclose(self, points: np.ndarray) -> np.ndarray:
        """Tell which points [m], shape (N, 3), the garment encloses; none where it is unknown."""
        ...

    @property
    def flat_area(self) -> float:
        """Area of the garment lying flat [m^2], counted as `compute_covered_area` does."""
        ...

    @property
    def frames(self) -> Mapping[str, Mapping[str, np.ndarray]]:
        """Frames of the objects in the scene, by object and name [m], shape (3,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class SuccessRule(ABC):
    """Judges a scene."""

    def __post_init__(self) -> None:
        adopt_fields(self)

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Names in `SceneView.landmarks` that the rule needs."""
        return ()

    @property
    def marks(self) -> tuple[str, ...]:
        """Names in `SceneView.places` that the rule needs."""
        return ()

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the objects' frames that the rule needs, such as "hanger.target"."""
        return ()

    @abstractmethod
    def __call__(self, view: SceneView) -> Verdict:
        """Judge the scene."""

    def measure_placement(
        self, points: np.ndarray, frames: Mapping[str, Mapping[str, np.ndarray]]
    ) -> float | None:
        """Measure how far the garment is from its place; it does not decide success.

        Args:
            points: Points all over the garment [m], shape (N, 3), N >= 1, world frame.
            frames: As in `SceneView`.

        Returns:
            Horizontal distance from the garment's middle to its place [m]; None for rules without
            a place.

        Limitations:
            The height has no part in it: a garment on the ground below its place is near.
        """
        del points, frames
        return None


def get_frame(frames: Mapping[str, Mapping[str, np.ndarray]], name: str) -> np.ndarray:
    """Look up a frame of an object, such as "stand.top" [m], shape (3,).

    Raises:
        ValueError: If there is no such object, or it has no such frame.
    """
    owner, _, place = name.partition(".")
    if owner not in frames:
        raise ValueError(f"{name!r}: there is no object {owner!r}; there are {sorted(frames)}")
    if place not in frames[owner]:
        raise ValueError(
            f"{name!r}: {owner} has no frame {place!r}; it has {sorted(frames[owner])}"
        )
    return frames[owner][place]


def compute_covered_area(points: np.ndarray, *, cell: float = AREA_CELL) -> float:
    """Compute the horizontal area that points cover.

    Args:
        points: At most half of `cell` apart where there is cloth [m], shape (N, 2) or (N, 3).
        cell: Side of the cells that are counted [m].

    Returns:
        Area of the cells with a point in them [m^2], too large by about half a cell along the
        outline; 0 without points.

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
        Share in [0, 1]; 0 without points.

    Raises:
        ValueError: If the shape is another one.
    """
    points = _check_points(points)
    if len(points) == 0:
        return 0.0
    low, high = np.reshape(box, (2, 2))
    inside = (points[:, :2] >= low) & (points[:, :2] <= high)
    return float(inside.all(axis=1).mean())


@dataclass(frozen=True, kw_only=True)
class ShareInBox(SuccessRule):
    """Enough of the visible area lies inside a box of the garment's landmarks at the start."""

    left: tuple[str, ...]
    """Landmarks whose mean x is the left side of the box."""
    right: tuple[str, ...]
    """Landmarks whose mean x is the right side."""
    near: str
    """Landmark whose y is the side next to the robots."""
    far: str
    """Landmark whose y is the far side."""
    margins: tuple[float, float, float, float]
    """Widening of the box at its left, near, right and far side [m]."""
    threshold: Share
    """Least share of the visible area."""

    @property
    def landmarks(self) -> tuple[str, ...]:
        """Names of the landmarks."""
        return tuple(dict.fromkeys((*self.left, *self.right, self.near, self.far)))

    def __call__(self, view: SceneView) -> Verdict:
        """Measure the share of the visible points inside the box."""
        left, right = (
            float(np.mean([view.landmarks[name][0] for name in side]))
            for side in (self.left, self.right)
        )
        near, far = (float(view.landmarks[name][1]) for name in (self.near, self.far))
        a, b, c, d = self.margins
        box = (left - a, near - b, right + c, far + d)
        share = Criterion(
            name="share of the garment's visible area inside the box of the landmarks",
            value=compute_box_share(view.top, box),
            comparison=">=",
            threshold=self.threshold,
        )
        return Verdict(criteria=(share,), box=box)


@dataclass(frozen=True, kw_only=True)
class CoversFlatArea(SuccessRule):
    """The garment covers nearly the area that it covers when it lies flat (paper)."""

    tolerance: Share = 0.2
    """Bound of the deviation of the areas' ratio from 1, exclusive (paper)."""

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
class AtFrame(SuccessRule):
    """Base of the rules about a frame of an object."""

    frame: str
    """The object's frame, such as "hanger.target"."""

    @property
    def frames(self) -> tuple[str, ...]:
        """The one frame."""
        return (self.frame,)

    def measure_placement(
        self, points: np.ndarray, frames: Mapping[str, Mapping[str, np.ndarray]]
    ) -> float:
        """Measure the horizontal distance from the garment's middle to the frame [m]."""
        points = _check_points(points)
        return float(np.linalg.norm((points.mean(axis=0) - get_frame(frames, self.frame))[:2]))


@dataclass(frozen=True, kw_only=True)
class HangsOver(AtFrame):
    """The garment hangs over a bar or hook by its middle, and hardly any of it is on the ground."""

    sideways: Limit
    """Largest distance of the garment's middle from the frame in x [m]."""
    below: Limit | None = None
    """Largest distance of the garment's middle below the frame [m]; any when None."""
    height: Limit = 0.01
    """Height below which the garment counts as lying on the ground [m] (original code)."""
    on_ground: Share = 15 / 2048
    """Largest share of the garment that may lie there (original code)."""
    over: Limit = 0.08
    """Largest distance of the garment's highest part from the frame in y and z [m]."""

    def __call__(self, view: SceneView) -> Verdict:
        """Measure the share on the ground, and the positions of the garment's middle and top."""
        points = view.surface if len(view.surface) else np.full((1, 3), -1e3)
        target = get_frame(view.frames, self.frame)
        middle = points.mean(axis=0)
        top = points[points[:, 2] > points[:, 2].max() - TOP].mean(axis=0)
        limits = [
            ("share of the garment on the ground", float((points[:, 2] < self.height).mean()),
             self.on_ground, "", "on the ground"),
            ("distance of the garment's middle from its place, sideways",
             float(abs(middle[0] - target[0])), self.sideways, " m", "off the middle"),
            ("distance of the garment's highest part from its place",
             float(np.linalg.norm((top - target)[1:])), self.over, " m", "not over its place"),
        ]  # fmt: skip
        if self.below is not None:
            name = "distance of the garment's middle below its place"
            limits.append((name, float(target[2] - middle[2]), self.below, " m", "too low"))
        return _require_at_most(*limits)


@dataclass(frozen=True, kw_only=True)
class RestsOn(AtFrame):
    """The garment lies on the top of an object: its middle is near the frame, little is lower."""

    within: Limit
    """Largest horizontal distance from the frame to the middle of the visible garment [m]."""
    lower: Share = 0.4
    """Largest share of the garment that may be lower than the frame: over the object's edges."""
    margin: Limit = 0.01
    """Depth below the frame that does not count as lower [m]."""

    def __call__(self, view: SceneView) -> Verdict:
        """Measure the distance of the garment's middle, and the share that is lower."""
        target = get_frame(view.frames, self.frame)
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
class SitsOn(AtFrame):
    """The garment is worn: its middle is near the frame and no higher, and it is upright."""

    within: Limit
    """Largest distance of the garment's middle from the frame [m]."""
    leaning: Limit
    """Largest lean of the garment [rad]."""

    def __call__(self, view: SceneView) -> Verdict:
        """Measure distance and height of the garment's middle, and its lean."""
        middle = view.surface.mean(axis=0) if len(view.surface) else np.full(3, 1e3)
        off = middle - get_frame(view.frames, self.frame)
        return _require_at_most(
            ("distance of the garment's middle from its place", float(np.linalg.norm(off)),
             self.within, " m", "not in its place"),
            ("height of the garment's middle over its place", float(off[2]),
             0.0, " m", "not put on"),
            ("how far the garment leans", view.tilt, self.leaning, " rad", "leaning"),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class WindsRound(AtFrame):
    """A long garment goes round an upright part of an object, such as a neck, and hangs from it."""

    turns: Limit
    """Least turns of its midline about the vertical through the frame."""
    above: Limit = 0.1
    """Height over the frame up to which the midline counts [m]."""
    below: Limit = 0.2
    """Depth under the frame down to which it counts [m]."""
    within: Limit = 0.2
    """Horizontal distance from the frame up to which it counts [m]."""
    low: Limit = 0.2
    """Height below which hardly anything may be [m] (paper)."""
    share_low: Share = 0.01
    """Largest share of the garment that may be there (paper: 20 of 2048 points)."""

    def __call__(self, view: SceneView) -> Verdict:
        """Measure turns, the height of the ends, and the share that is low."""
        place = get_frame(view.frames, self.frame)
        line = view.midline if len(view.midline) else np.full((2, 3), 1e3)
        off = line - place
        near = np.linalg.norm(off[:, :2], axis=1) <= self.within
        near &= (off[:, 2] <= self.above) & (off[:, 2] >= -self.below)
        points = view.surface if len(view.surface) else np.full((1, 3), -1e3)
        turns = Criterion(
            name="turns of the garment's midline round its place",
            value=abs(compute_winding(off, counted=near)),
            comparison=">=",
            threshold=self.turns,
            failure="not round its place",
        )
        rest = _require_at_most(
            ("height of the higher end over its place", float(off[[0, -1], 2].max()), 0.0, " m",
             "an end is up"),
            ("share of the garment that is low", float((points[:, 2] < self.low).mean()),
             self.share_low, "", "hangs too low"),
        )  # fmt: skip
        return Verdict(criteria=(turns, *rest.criteria))


def compute_winding(line: np.ndarray, *, counted: np.ndarray | None = None) -> float:
    """Compute how often a line goes round the vertical axis, counter-clockwise from above.

    Args:
        line: Points from one end to the other [m], shape (B, 3).
        counted: Points that count, shape (B,), bool; steps between two of them are added up. All
            when None.

    Returns:
        Signed number of turns.
    """
    angles = np.arctan2(line[:, 1], line[:, 0])
    steps = (np.diff(angles) + np.pi) % (2 * np.pi) - np.pi
    if counted is not None:
        steps = steps[counted[:-1] & counted[1:]]
    return float(steps.sum() / (2 * np.pi))


def _require_at_most(*limits: tuple[str, float, float, str, str]) -> Verdict:
    """Judge by names, values, upper limits, units, and failures."""
    return Verdict(
        criteria=tuple(
            Criterion(
                name=name, value=value, comparison="<=", threshold=most, unit=unit, failure=failure
            )
            for name, value, most, unit, failure in limits
        )
    )


def _check_points(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (N, 2 or 3); got {points.shape}")
    return points
