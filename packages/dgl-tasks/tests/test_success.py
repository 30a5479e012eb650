"""Success rules on hand-made scenes, on both sides of each threshold; verdicts."""

from dataclasses import dataclass, field

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dgl_tasks import get_task, task_ids
from dgl_tasks.success import (
    CoversFlatArea,
    Criterion,
    HangsOver,
    RestsOn,
    SitsOn,
    Verdict,
    WindsRound,
    compute_box_share,
    compute_covered_area,
    compute_winding,
)
from dgl_tasks.views import TrueView

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
# boxes by hand, from the margins of each task's rule
BOXES = {
    "FoldTops-v1": (-0.25, 0.6, 0.35, 1.1),
    "FoldDress-v1": (-0.25, 0.6, 0.35, 1.1),
    "FoldTrousers-v1": (-0.3, 0.6, 0.35, 1.1),
}
THRESHOLDS = {"FoldTops-v1": 0.85, "FoldDress-v1": 0.80, "FoldTrousers-v1": 0.85}
INSIDE, OUTSIDE = (0.0, 0.8, 0.01), (0.0, 0.5, 0.01)
each_fold = pytest.mark.parametrize("task_id", BOXES)


@dataclass
class Scene:
    """A scene view from points made by hand."""

    top: np.ndarray
    landmarks: dict = field(default_factory=lambda: MARKS)
    flat_area: float = 1.0
    frames: dict = field(default_factory=dict)
    tilt: float = 0.0
    midline: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))

    @property
    def surface(self):
        return self.top


def mix(inside, outside):
    return Scene(np.array([INSIDE] * inside + [OUTSIDE] * outside))


def make_patch(width, depth, *, step=0.004):
    """Points a pixel apart over a rectangle whose corner is where cells begin."""
    x, y = np.meshgrid(np.arange(step / 2, width, step), np.arange(step / 2, depth, step))
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)


@each_fold
@pytest.mark.parametrize(("excess", "success"), [(0, True), (-1, False), (1, True)])
def test_exactly_the_threshold_is_enough(task_id, excess, success):
    rule, threshold = get_task(task_id).success, THRESHOLDS[task_id]
    inside = round(1000 * threshold) + excess
    verdict = rule(mix(inside, 1000 - inside))
    (share,) = verdict.criteria
    assert verdict.value == share.value == inside / 1000
    assert share.threshold == threshold
    assert verdict.success is share.is_met is success
    assert verdict.reason == (None if success else "below the threshold")


@each_fold
def test_the_box_has_the_margins_of_the_rule(task_id):
    verdict = get_task(task_id).success(mix(1, 0))
    np.testing.assert_allclose(verdict.box, BOXES[task_id], atol=1e-12)


@each_fold
@pytest.mark.parametrize(
    ("side", "axis", "outwards"), [(0, 0, -1), (1, 1, -1), (2, 0, 1), (3, 1, 1)]
)
def test_each_side_of_the_box_separates_within_a_millimetre(task_id, side, axis, outwards):
    rule, edge = get_task(task_id).success, BOXES[task_id][side]
    point = np.array([INSIDE])
    point[0, axis] = edge - outwards * 0.001
    assert rule(Scene(point)).value == 1.0
    point[0, axis] = edge + outwards * 0.001
    assert rule(Scene(point)).value == 0.0


def test_height_does_not_matter_and_the_border_belongs_to_the_box():
    corners = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (-1.0, 5.0)]
    assert compute_box_share(np.array(corners), (0.0, 0.0, 1.0, 2.0)) == 1.0
    assert compute_box_share(np.array(corners)[:, :2], (0.0, 0.0, 1.0, 2.0)) == 1.0


@pytest.mark.parametrize(
    ("width", "success"), [(0.79, False), (0.80, False), (0.81, True), (1.19, True), (1.21, False)]
)
def test_a_flung_garment_covers_within_a_fifth_of_its_flat_area(width, success):
    verdict = CoversFlatArea()(Scene(make_patch(width, 1.0)))
    (flatness,) = verdict.criteria
    assert flatness.value == pytest.approx(1 - abs(1 - width), abs=1e-6)
    assert flatness.threshold == pytest.approx(0.8)
    assert verdict.success is success
    # the flat area is that of this garment
    assert CoversFlatArea()(Scene(make_patch(width, 1.0), flat_area=width)).value > 0.999


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


@pytest.mark.parametrize("task_id", [t for t in task_ids() if t.startswith(("Fold", "Fling"))])
def test_of_what_is_out_of_sight_nothing_is_done(task_id):
    verdict = get_task(task_id).success(Scene(np.empty((0, 3)), flat_area=0.5))
    assert verdict.value == 0.0
    assert not verdict.success


@each_fold
def test_a_missing_mark_is_not_ignored(task_id):
    rule = get_task(task_id).success
    assert len(set(rule.landmarks)) == len(rule.landmarks)
    for name in rule.landmarks:
        rest = {k: v for k, v in MARKS.items() if k != name}
        with pytest.raises(KeyError, match=name):
            rule(Scene(mix(1, 0).top, landmarks=rest))


# Of a bar at x = 0.1 and a head at (0, 1, 1.2)
PLACES = {"bar": {"target": np.array([0.1, 1.0, 0.8])}, "head": {"top": np.array([0.0, 1.0, 1.2])}}


def hang(down, x=0.1, top=(1.0, 0.82)):
    """Of 2048 points, so many lie on the ground, and ten at the top, whose y and z are given."""
    points = np.tile([x, 1.0, 0.5], (2048, 1))
    points[-10:, 1:] = top
    points[:down, 2] = 0.009
    return Scene(points, frames=PLACES)


@pytest.mark.parametrize(
    ("down", "x", "reason"),
    [
        (15, 0.1, None),
        (16, 0.1, "on the ground"),
        (0, 0.149, None),
        (0, 0.051, None),
        (0, 0.151, "off the middle"),
        (0, 0.049, "off the middle"),
        (2048, 0.3, "on the ground"),
    ],
)
def test_what_hangs_over_a_bar_is_off_the_ground_and_in_the_middle(down, x, reason):
    rule = HangsOver(frame="bar.target", sideways=0.05)
    assert rule.frames == ("bar.target",)
    verdict = rule(hang(down, x))
    assert verdict.reason == reason
    assert [c.value for c in verdict.criteria[:2]] == pytest.approx([down / 2048, abs(x - 0.1)])


@pytest.mark.parametrize(
    ("top", "reason"),
    [
        ((1.0, 0.879), None),
        ((1.0, 0.881), "not over its place"),
        ((1.079, 0.8), None),
        ((0.919, 0.8), "not over its place"),
        ((3.0, 0.02), "not over its place"),  # it lies on something low, far away
    ],
)
def test_the_top_of_what_hangs_over_a_bar_is_at_the_bar(top, reason):
    assert HangsOver(frame="bar.target", sideways=0.05)(hang(0, top=top)).reason == reason


@pytest.mark.parametrize(("z", "reason"), [(0.301, None), (0.299, "too low")])
def test_the_middle_of_what_hangs_may_not_be_too_low(z, reason):
    rule = HangsOver(frame="bar.target", sideways=0.05, below=0.5)
    points = np.tile([0.1, 1.0, z], (2048, 1))
    points[:2] = [[0.1, 1.0, 0.8], [0.1, 1.0, 2 * z - 0.8]]
    assert rule(Scene(points, frames=PLACES)).reason == reason
    assert HangsOver(frame="bar.target", sideways=0.05)(Scene(points, frames=PLACES)).success


def test_the_placement_error_is_the_horizontal_distance_of_the_middle():
    target = PLACES["bar"]["target"]
    points = target + np.array([[0.0, 0.0, -0.9], [0.06, 0.08, -0.1]])
    for rule in (
        HangsOver(frame="bar.target", sideways=0.05),
        RestsOn(frame="bar.target", within=0.1),
        SitsOn(frame="bar.target", within=0.1, leaning=0.5),
    ):
        assert rule.measure_placement(points, PLACES) == pytest.approx(0.05)
    assert CoversFlatArea().measure_placement(points, PLACES) is None


@pytest.mark.parametrize(
    ("x", "lower", "reason"),
    [
        (0.19, 0, None),
        (0.21, 0, "not in its place"),
        (0.01, 0, None),
        (0.1, 40, None),
        (0.1, 41, "fallen off"),
        (0.1, 100, "fallen off"),
    ],
)
def test_what_rests_on_a_top_is_near_its_middle_and_hardly_hangs_over(x, lower, reason):
    """Of 100 points, so many are lower by more than a centimetre."""
    rule = RestsOn(frame="bar.target", within=0.1)
    assert rule.frames == ("bar.target",)
    points = np.tile([x, 1.0, 0.791], (100, 1))
    points[:lower, 2] = 0.789
    assert rule(Scene(points, frames=PLACES)).reason == reason


@pytest.mark.parametrize(
    ("middle", "reason"),
    [
        ((0.0, 1.0, 1.2), None),
        ((0.0, 1.0, 1.101), None),
        ((0.0, 1.0, 1.201), "not put on"),
        ((0.0, 1.0, 1.099), "not in its place"),
        ((0.08, 1.0, 1.15), None),
        ((0.09, 1.0, 1.15), "not in its place"),
        ((0.0, 0.8, 1.3), "not in its place"),
    ],
)
def test_what_is_worn_is_near_its_place_and_no_higher(middle, reason):
    rule = SitsOn(frame="head.top", within=0.1, leaning=0.6)
    assert rule.frames == ("head.top",)
    points = np.array(middle) + np.array([[0.1, 0, 0], [-0.1, 0, 0], [0, 0, 0.05], [0, 0, -0.05]])
    assert rule(Scene(points, frames=PLACES)).reason == reason


NECK = np.array([0.2, 0.5, 1.0])


def wind(turns, *, radius=0.08, height=0.0, ends=-0.3, low=0.0):
    """A scarf that winds round the neck, its ends hanging down outside of what counts."""
    angles = np.linspace(0, 2 * np.pi * turns, 200)
    loop = np.stack([np.cos(angles), np.sin(angles), np.zeros(200)], axis=1) * radius
    loop[:, 2] = height
    down = np.linspace(-0.201, ends, 20)[:, None]
    first, last = (loop[k] * [1, 1, 0] + down * [0, 0, 1] for k in (0, -1))
    line = np.concatenate([first[::-1], loop, last]) + NECK
    surface = line.copy()
    surface[: round(low * len(line)), 2] = 0.19
    return Scene(surface, frames={"person": {"neck": NECK}}, midline=line)


@pytest.mark.parametrize(
    ("scene", "reason"),
    [
        (wind(1.21), None),
        (wind(-1.21), None),
        (wind(1.19), "not round its place"),
        (wind(1.3, radius=0.199), None),
        (wind(1.3, radius=0.201), "not round its place"),
        (wind(1.3, height=0.099), None),
        (wind(1.3, height=0.101), "not round its place"),
        (wind(1.3, height=-0.199), None),
        (wind(1.3, height=-0.6, ends=-0.7), "not round its place"),  # round the feet
        (wind(1.3, ends=0.01), "an end is up"),
        (wind(1.3, low=0.005), None),
        (wind(1.3, low=0.02), "hangs too low"),
    ],
)
def test_what_is_wound_round_a_neck_goes_round_it_often_enough(scene, reason):
    assert WindsRound(frame="person.neck", turns=1.2)(scene).reason == reason


def test_turns_are_signed_and_leave_out_what_does_not_count():
    angles = np.linspace(0, 2 * np.pi * 1.5, 100)
    line = np.stack([np.cos(angles), np.sin(angles), angles], axis=1)
    assert compute_winding(line) == pytest.approx(1.5)
    assert compute_winding(line[::-1]) == pytest.approx(-1.5)
    assert compute_winding(line, counted=angles <= np.pi) == pytest.approx(0.5, abs=0.02)
    assert compute_winding(np.empty((0, 3))) == 0.0


def test_the_midline_follows_a_bent_strip():
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 121), np.linspace(-0.1, 0.1, 21), indexing="ij")
    flat = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    angle = flat[:, 0] / 0.3
    bent = np.stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), flat[:, 1]], axis=1)
    view = TrueView(
        particles=bent, faces=np.zeros((0, 3), int), upright=flat, landmarks={}, flat_area=1.0,
        frames={},
    )  # fmt: skip
    assert len(view.midline) == 40
    np.testing.assert_allclose(np.linalg.norm(view.midline, axis=1), 0.3, atol=1e-3)
    np.testing.assert_allclose(view.midline[[0, -1]], bent[[10, -11]] * [1, 1, 0], atol=0.015)
    assert compute_winding(view.midline) == pytest.approx(4 / (2 * np.pi), abs=0.02)


@pytest.mark.parametrize(
    "rule",
    [
        HangsOver(frame="bar.target", sideways=0.05, below=0.5),
        RestsOn(frame="bar.target", within=0.1),
        SitsOn(frame="head.top", within=0.1, leaning=0.6),
    ],
)
def test_of_what_is_not_there_nothing_hangs_or_sits(rule):
    verdict = rule(Scene(np.empty((0, 3)), frames=PLACES))
    assert not verdict.success
    assert np.isfinite([c.value for c in verdict.criteria]).all()


def test_the_truth_is_seen_from_straight_above():
    """The upper of two sheets hides the lower one, whose vertices belong to the surface."""
    lower, upper = (
        np.array([[x0, 0, z], [x0 + 0.4, 0, z], [x0, 0.4, z], [x0 + 0.4, 0.4, z]])
        for x0, z in ((0.0, 0.01), (0.2, 0.02))
    )
    quad = np.array([[0, 1, 2], [1, 3, 2]])
    view = TrueView(
        particles=np.concatenate([lower, upper]),
        faces=np.concatenate([quad, quad + 4]),
        upright=np.concatenate([lower, upper]),
        landmarks={},
        flat_area=0.16,
        frames={},
    )
    assert len(view.surface) == 8
    is_under = (view.top[:, 0] > 0.22) & (view.top[:, 0] < 0.38)
    np.testing.assert_allclose(view.top[is_under, 2], 0.02, atol=1e-6)
    assert compute_covered_area(view.top) == pytest.approx(0.24, rel=0.06)
    assert CoversFlatArea()(view).value == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize(("tilt", "reason"), [(0.59, None), (0.61, "leaning"), (np.pi, "leaning")])
def test_what_is_worn_is_upright(tilt, reason):
    rule = SitsOn(frame="head.top", within=0.1, leaning=0.6)
    points = np.array([[0.0, 1.0, 1.15]])
    assert rule(Scene(points, frames=PLACES, tilt=tilt)).reason == reason


def test_the_tilt_is_that_of_the_garment_as_a_whole():
    """Turned about the vertical it is 0, and bending a part a little hardly changes it."""
    rng = np.random.default_rng(0)
    upright = rng.normal(size=(200, 3)) * [0.1, 0.12, 0.05]
    for lean in (0.0, 0.4, 2.5):
        turn = Rotation.from_rotvec([lean, 0, 0]) * Rotation.from_rotvec([0, 0, 1.1])
        moved = turn.apply(upright) + [0.3, -0.2, 1.0] + rng.normal(size=(200, 3)) * 1e-3
        view = TrueView(
            particles=moved,
            faces=np.zeros((0, 3), int),
            upright=upright,
            landmarks={},
            flat_area=1.0,
            frames={},
        )
        assert view.tilt == pytest.approx(lean, abs=0.02)


# Verdicts --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("comparison", "met"),
    [
        ("<", (True, False, False)),
        ("<=", (True, True, False)),
        (">", (False, False, True)),
        (">=", (False, True, True)),
    ],
)
def test_a_criterion_compares_its_value_with_its_threshold(comparison, met):
    criteria = [
        Criterion(name="height", value=value, comparison=comparison, threshold=0.5)
        for value in (0.4, 0.5, 0.6)
    ]
    assert tuple(c.is_met for c in criteria) == met


def judge(share, height, speed=0.0):
    """A verdict of three criteria: more is wanted of the first, less of the others."""
    criteria = (
        Criterion(name="share", value=share, comparison=">=", threshold=0.8),
        Criterion(
            name="height",
            value=height,
            comparison="<=",
            threshold=0.25,
            unit=" m",
            failure="too high",
        ),
        Criterion(
            name="speed",
            value=speed,
            comparison="<",
            threshold=0.05,
            unit=" m/s",
            failure="still moving",
        ),
    )
    return Verdict(criteria=criteria)


@pytest.mark.parametrize(
    ("measured", "reason"),
    [
        ((0.8, 0.25), None),
        ((0.7, 0.3, 1.0), "below the threshold"),
        ((0.9, 0.3, 1.0), "too high"),
        ((0.9, 0.2, 1.0), "still moving"),
    ],
)
def test_the_reason_is_the_first_criterion_that_is_not_met(measured, reason):
    verdict = judge(*measured)
    assert verdict.reason == reason
    assert verdict.success is (reason is None)
    assert verdict.value == measured[0]


def test_shortfalls_name_all_that_is_not_met_and_nothing_else():
    assert judge(0.9, 0.2).describe_shortfalls() == ""
    assert judge(0.9, 0.3).describe_shortfalls() == "height: 0.300 m, needed <= 0.25 m"
    assert judge(0.7512, 0.2, 0.07).describe_shortfalls() == (
        "share: 0.751, needed >= 0.8; speed: 0.070 m/s, needed < 0.05 m/s"
    )


def test_a_verdict_of_nothing_is_refused():
    with pytest.raises(ValueError, match="at least one criterion; got none"):
        Verdict(criteria=())
