"""Success rules on hand-made points, on both sides of each threshold."""

import numpy as np
import pytest

from dgl_tasks.success import compute_box_share, judge_fold_tops

MARKS = {
    "left_sleeve_joint": np.array([-0.2, 0.9, 0.0]),
    "right_sleeve_joint": np.array([0.3, 0.9, 0.0]),
    "centre": np.array([0.05, 0.7, 0.0]),
    "collar": np.array([0.05, 1.0, 0.0]),
}
BOX = (-0.25, 0.6, 0.35, 1.1)
INSIDE, OUTSIDE = (0.0, 0.8, 0.01), (0.0, 0.5, 0.01)


def mix(inside, outside):
    return np.array([INSIDE] * inside + [OUTSIDE] * outside)


@pytest.mark.parametrize(
    ("inside", "outside", "success"), [(17, 3, True), (849, 151, False), (851, 149, True)]
)
def test_exactly_85_percent_is_enough(inside, outside, success):
    verdict = judge_fold_tops(mix(inside, outside), MARKS)
    assert verdict.value == inside / (inside + outside)
    assert verdict.success is success
    assert verdict.threshold == 0.85


def test_the_box_has_the_margins_of_the_rule():
    verdict = judge_fold_tops(mix(1, 0), MARKS)
    np.testing.assert_allclose(verdict.box, BOX, atol=1e-12)


@pytest.mark.parametrize(
    ("edge", "axis", "outwards"), [(BOX[0], 0, -1), (BOX[1], 1, -1), (BOX[2], 0, 1), (BOX[3], 1, 1)]
)
def test_each_side_of_the_box_separates_within_a_millimetre(edge, axis, outwards):
    point = np.array([INSIDE])
    point[0, axis] = edge - outwards * 0.001
    assert judge_fold_tops(point, MARKS).value == 1.0
    point[0, axis] = edge + outwards * 0.001
    assert judge_fold_tops(point, MARKS).value == 0.0


def test_height_does_not_matter_and_the_border_belongs_to_the_box():
    corners = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (-1.0, 5.0)]
    assert compute_box_share(np.array(corners), (0.0, 0.0, 1.0, 2.0)) == 1.0
    assert compute_box_share(np.array(corners)[:, :2], (0.0, 0.0, 1.0, 2.0)) == 1.0


@pytest.mark.parametrize("shape", [(0, 3), (5, 4), (3,)])
def test_what_cannot_be_judged_is_refused(shape):
    with pytest.raises(ValueError, match=r"must have shape \(N, 2 or 3\) with N > 0; got"):
        compute_box_share(np.zeros(shape), (0, 0, 1, 1))
    with pytest.raises(ValueError, match="N > 0"):
        judge_fold_tops(np.zeros((0, 3)), MARKS)


def test_a_missing_mark_is_not_ignored():
    with pytest.raises(KeyError, match="collar"):
        judge_fold_tops(mix(1, 0), {k: v for k, v in MARKS.items() if k != "collar"})
