"""Success rules: pure functions of what a camera sees and of points found beforehand."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


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


def compute_box_share(points: np.ndarray, box: tuple[float, float, float, float]) -> float:
    """Compute the share of points inside a horizontal box.

    The pixels of a camera that looks straight down each stand for the same area of cloth, so for
    their points this is the share of the garment's visible area.

    Args:
        points: [m], shape (N, 2) or (N, 3), world frame.
        box: x low, y low, x high, y high [m].

    Returns:
        Share in [0, 1].

    Raises:
        ValueError: If there are no points: nothing was seen, nothing can be judged.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] not in (2, 3) or len(points) == 0:
        raise ValueError(f"points must have shape (N, 2 or 3) with N > 0; got {points.shape}")
    x0, y0, x1, y1 = box
    inside = (
        (points[:, 0] >= x0) & (points[:, 0] <= x1) & (points[:, 1] >= y0) & (points[:, 1] <= y1)
    )
    return float(inside.mean())


def judge_fold_tops(points: np.ndarray, marks: Mapping[str, np.ndarray]) -> Verdict:
    """Judge a folded top: at least 85 % of its visible area inside the box of four points.

    The box goes from the left to the right sleeve joint with a margin of 0.05 m, and from the
    centre to the collar with a margin of 0.1 m, as the garment lay before it was folded.
    Threshold from the paper, margins from the original code.

    Args:
        points: What the camera above sees of the garment [m], shape (N, 3), world frame.
        marks: "left_sleeve_joint", "right_sleeve_joint", "centre" and "collar" on the initial
            garment [m], shape (3,), world frame.
    """
    left, right = marks["left_sleeve_joint"], marks["right_sleeve_joint"]
    box = (
        float(left[0]) - 0.05,
        float(marks["centre"][1]) - 0.1,
        float(right[0]) + 0.05,
        float(marks["collar"][1]) + 0.1,
    )
    value = compute_box_share(points, box)
    return Verdict(
        success=value >= 0.85,
        value=value,
        threshold=0.85,
        quantity="share of the garment's visible area inside the box of the four key points",
        box=box,
    )
