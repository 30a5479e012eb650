"""Success rules on hand-made points, on both sides of each threshold."""

import numpy as np
import pytest

from dgl_tasks import get_task, task_ids
from dgl_tasks.success import Before, FlingRule, compute_box_share, compute_covered_area

MARKS = {
    "left_sleeve_joint": np.array([-0.2, 0.9, 0.0]),
    "right_sleeve_joint": np.array([0.3, 0.9, 0.0]),
    "centre": np.array([0.05, 0.7, 0.0]),
    "collar": np.array([0.05, 1.0, 0.0]),
    "left_shoulder": np.array([-0.2, 1.0, 0.0]),
    "right_shoulder": np.array([0.3, 1.0, 0.0]),
    "left_side": np.array([-0.2, 0.7, 0.0]),
    "right_waist": np.array([-0.2, 1.0, 0.0]),
    "right_hem_outer": np.array([0.8, 0.95, 0.0]),
}
BEFORE = Before(points=MARKS, flat_area=1.0)
# boxes by hand, from the margins of each task's rule
BOXES = {
    "FoldTops-v1": (-0.25, 0.6, 0.35, 1.1),
    "FoldDress-v1": (-0.25, 0.6, 0.35, 1.1),
    "FoldTrousers-v1": (-0.3, 0.6, 0.35, 1.1),
}
THRESHOLDS = {"FoldTops-v1": 0.85, "FoldDress-v1": 0.80, "FoldTrousers-v1": 0.85}
INSIDE, OUTSIDE = (0.0, 0.8, 0.01), (0.0, 0.5, 0.01)
each_fold = pytest.mark.parametrize("task_id", BOXES)


def mix(inside, outside):
    return np.array([INSIDE] * inside + [OUTSIDE] * outside)


def make_patch(width, depth, *, step=0.004):
    """Points a pixel apart over a rectangle whose corner is where cells begin."""
    x, y = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, depth, step))
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)


@each_fold
@pytest.mark.parametrize(("excess", "success"), [(0, True), (-1, False), (1, True)])
def test_exactly_the_threshold_is_enough(task_id, excess, success):
    rule, threshold = get_task(task_id).success, THRESHOLDS[task_id]
    inside = round(1000 * threshold) + excess
    verdict = rule(mix(inside, 1000 - inside), BEFORE)
    assert verdict.value == inside / 1000
    assert verdict.success is success
    assert verdict.threshold == threshold


@each_fold
def test_the_box_has_the_margins_of_the_rule(task_id):
    verdict = get_task(task_id).success(mix(1, 0), BEFORE)
    np.testing.assert_allclose(verdict.box, BOXES[task_id], atol=1e-12)


@each_fold
@pytest.mark.parametrize(
    ("side", "axis", "outwards"), [(0, 0, -1), (1, 1, -1), (2, 0, 1), (3, 1, 1)]
)
def test_each_side_of_the_box_separates_within_a_millimetre(task_id, side, axis, outwards):
    rule, edge = get_task(task_id).success, BOXES[task_id][side]
    point = np.array([INSIDE])
    point[0, axis] = edge - outwards * 0.001
    assert rule(point, BEFORE).value == 1.0
    point[0, axis] = edge + outwards * 0.001
    assert rule(point, BEFORE).value == 0.0


def test_height_does_not_matter_and_the_border_belongs_to_the_box():
    corners = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (-1.0, 5.0)]
    assert compute_box_share(np.array(corners), (0.0, 0.0, 1.0, 2.0)) == 1.0
    assert compute_box_share(np.array(corners)[:, :2], (0.0, 0.0, 1.0, 2.0)) == 1.0


@pytest.mark.parametrize(
    ("width", "success"), [(0.79, False), (0.80, False), (0.81, True), (1.19, True), (1.21, False)]
)
def test_a_flung_garment_covers_within_a_fifth_of_its_flat_area(width, success):
    verdict = FlingRule()(make_patch(width, 1.0), BEFORE)
    assert verdict.value == pytest.approx(1 - abs(1 - width), abs=1e-6)
    assert verdict.threshold == pytest.approx(0.8)
    assert verdict.success is success


def test_covered_area_counts_no_layer_twice_and_no_height():
    patch = make_patch(0.4, 0.3)
    assert compute_covered_area(patch) == pytest.approx(0.12, abs=1e-9)
    stacked = np.concatenate([patch, patch + np.array([0, 0, 0.2])])
    assert compute_covered_area(stacked) == pytest.approx(0.12, abs=1e-9)
    folded = np.concatenate([make_patch(0.2, 0.3), make_patch(0.2, 0.3)])
    assert compute_covered_area(folded) == pytest.approx(0.06, abs=1e-9)


@pytest.mark.parametrize("shape", [(0, 4), (5, 4), (3,)])
def test_what_cannot_be_judged_is_refused(shape):
    for judge in (compute_covered_area, lambda p: compute_box_share(p, (0, 0, 1, 1))):
        with pytest.raises(ValueError, match=r"must have shape \(N, 2 or 3\); got"):
            judge(np.zeros(shape))


@pytest.mark.parametrize("task_id", task_ids())
def test_of_what_is_out_of_sight_nothing_is_done(task_id):
    verdict = get_task(task_id).success(np.empty((0, 3)), Before(points=MARKS, flat_area=0.5))
    assert verdict.value == 0.0
    assert not verdict.success


@each_fold
def test_a_missing_mark_is_not_ignored(task_id):
    rule = get_task(task_id).success
    for name in rule.points:
        rest = {k: v for k, v in MARKS.items() if k != name}
        with pytest.raises(KeyError, match=name):
            rule(mix(1, 0), Before(points=rest, flat_area=1.0))
