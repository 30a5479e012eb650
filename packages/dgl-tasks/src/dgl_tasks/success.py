"""Success rules: pure functions of what a camera sees and of how the garment lay before."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

AREA_CELL = 0.01
"""Side of the cells in which covered area is counted [m]: two pixels of the cameras above."""


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """The outcome of a rule, with the quantity behind it."""

    success: bool
    value: float
    """The measured quantity."""
    threshold: float
    """What `value` is compared with."""
    quantity: str
    """What `value` is, in words."""
    box: tuple[float, float, float, float] | None = None
    """The box (x low, y low, x high, y high) [m] that the rule looked at, for pictures."""


@dataclass(frozen=True, kw_only=True)
class Before:
    """What is known of the garment from before the robots touched it."""

    points: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Places that the rule names [m], shape (3,), world frame, on the garment as it lay then."""
    flat_area: float
    """Area that the garment covers when it lies flat [m^2], counted as `compute_covered_area` does."""


class SuccessRule(Protocol):
    """Judges what a camera above sees of the garment."""

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the places in `Before.points` that the rule needs."""
        ...

    def __call__(self, points: np.ndarray, before: Before) -> Verdict:
        """Judge what is seen of the garment [m], shape (N, 3), world frame; N is 0 when it is out of sight."""
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


def compute_box_share(points: np.ndarray, box: tuple[float, float, float, float]) -> float:
    """Compute the share of points inside a horizontal box.

    The pixels of a camera that looks straight down each stand for the same area of cloth, so for
    their points this is the share of the garment's visible area.

    Args:
        points: [m], shape (N, 2) or (N, 3), world frame.
        box: x low, y low, x high, y high [m].

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


@dataclass(frozen=True, kw_only=True)
class FoldRule:
    """Enough of the garment's visible area lies inside a box of key points of the unfolded garment."""

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

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the key points."""
        return tuple(dict.fromkeys((*self.left, *self.right, self.near, self.far)))

    def __call__(self, points: np.ndarray, before: Before) -> Verdict:
        """Measure the share of the visible points inside the box; see `SuccessRule`."""
        left, right = (
            float(np.mean([before.points[name][0] for name in side]))
            for side in (self.left, self.right)
        )
        near, far = (float(before.points[name][1]) for name in (self.near, self.far))
        box = (
            left - self.margins[0],
            near - self.margins[1],
            right + self.margins[2],
            far + self.margins[3],
        )
        value = compute_box_share(points, box)
        return Verdict(
            success=value >= self.threshold,
            value=value,
            threshold=self.threshold,
            quantity="share of the garment's visible area inside the box of the key points",
            box=box,
        )


@dataclass(frozen=True, kw_only=True)
class FlingRule:
    """The garment covers nearly the area that it covers when it lies flat (paper)."""

    tolerance: float = 0.2
    """How far the ratio of the areas may be from 1; the paper's bound, which it must stay below."""

    @property
    def points(self) -> tuple[str, ...]:
        """No key points are needed."""
        return ()

    def __call__(self, points: np.ndarray, before: Before) -> Verdict:
        """Compare the covered area with the flat one; see `SuccessRule`."""
        ratio = compute_covered_area(points) / before.flat_area
        value = 1.0 - abs(1.0 - ratio)
        return Verdict(
            success=value > 1.0 - self.tolerance,
            value=value,
            threshold=1.0 - self.tolerance,
            quantity="1 - |1 - covered area / area of the flat garment|",
        )


def _check_points(points: np.ndarray) -> np.ndarray:
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ValueError(f"points must have shape (N, 2 or 3); got {points.shape}")
    return points
