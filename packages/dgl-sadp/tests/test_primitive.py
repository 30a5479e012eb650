"""Primitives follow affine maps of anchors exactly, keep speeds, and tell their errors."""

import itertools

import numpy as np
import pytest

from dgl_sadp.errors import CheckpointError, PrimitiveError
from dgl_sadp.primitive import Recording, fit_primitive
from dgl_sadp.primitive_file import (
    TaskPrimitives,
    find_primitives,
    load_primitives,
    save_primitives,
)


def turn(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def record(rng, *, angle=0.0, noise=0.0, speed=0.05, poses=2, **changes):
    """Lift the cuff halfway to the joint by half their distance, and lay it down at the chest."""
    anchors = {"cuff": np.array([0.5, 0.1, 0.0]), "joint": np.array([0.25, 0.2, 0.0]),
               "chest": np.array([-0.1, 0.15, 0.0])}  # fmt: skip
    middle = np.array([*rng.uniform(-0.1, 0.1, 2), 0])
    anchors = {n: turn(angle) @ (p + rng.normal(0, 0.03, 3) * [1, 1, 0]) + middle
               for n, p in anchors.items()}  # fmt: skip
    anchors |= changes.pop("anchors", {})
    start = anchors["cuff"]
    reach = np.linalg.norm((anchors["cuff"] - anchors["joint"])[:2])
    corners = [start, (start + anchors["joint"]) / 2 + [0, 0, reach / 2], anchors["chest"]]
    rows, closing = [start] * 5, [0, 0.25, 0.5, 0.75, 1]
    for a, b in itertools.pairwise(corners):
        count = int(np.ceil(np.linalg.norm(b - a) / speed))
        rows += [a + (b - a) * k / count for k in range(1, count + 1)]
        closing += [1] * count
    rows, closing = rows + [rows[-1]] * 4, [*closing, 0.75, 0.5, 0.25, 0]
    way = (
        np.array(rows)
        + np.array([rng.normal(0, noise, 3) if noise else np.zeros(3)])
        * (np.linspace(0, 1, len(rows))[:, None])
    )
    hands = np.stack([1 - np.array(closing), closing], axis=1)
    return Recording(anchors=anchors, points={"left": way}, hands={"left": hands[:, :poses]},
                     turns={"left": np.zeros((len(rows), 3))})  # fmt: skip


def plan(primitive, recording, **options):
    start = {side: way[0] for side, way in recording.points.items()}
    return primitive.plan(start, recording.anchors, **options)


def test_an_affine_way_is_learnt_for_other_garments():
    rng = np.random.default_rng(0)
    primitive = fit_primitive([record(rng) for _ in range(8)])
    for _ in range(10):
        other = record(rng)
        way = plan(primitive, other).hands["left"]
        assert way.points[-1] == pytest.approx(other.points["left"][-1], abs=2e-3)
        assert way.points[:, 2].max() == pytest.approx(other.points["left"][:, 2].max(), abs=0.015)
        assert way.poses[-1] == pytest.approx([1, 0], abs=1e-6)
        assert way.poses.max(axis=0) == pytest.approx([1, 1], abs=0.02)
    assert primitive.error < 2e-3


def test_the_way_turns_with_its_anchors():
    rng = np.random.default_rng(1)
    primitive = fit_primitive([record(rng, angle=rng.uniform(-0.5, 0.5)) for _ in range(8)])
    other = record(rng, angle=1.0)
    end = plan(primitive, other).hands["left"].points[-1]
    assert end == pytest.approx(other.points["left"][-1], abs=5e-3)


def cross(rng):
    """Go as far as one thing in x, and as far as another in y."""
    anchors = {n: np.array([*rng.uniform(-0.4, 0.4, 2), 0.0]) for n in "abcd"}
    share = np.linspace(0, 1, 15)[:, None]
    way = share * np.array([anchors["a"][0], anchors["b"][1], 0.1])
    still = {"left": np.zeros((15, 3))}
    return Recording(anchors=anchors, points={"left": way}, hands=still, turns=still)


def test_x_and_y_have_weights_of_their_own_where_recordings_show_it(tmp_path):
    rng = np.random.default_rng(5)
    recordings = [cross(rng) for _ in range(8)]
    primitive = fit_primitive(recordings)
    weights = primitive.hands["left"].level[..., -1]  # (2, 6): four anchors, the world, a constant
    assert weights[:, :4] == pytest.approx(np.array([[1, 0, 0, 0], [0, 1, 0, 0]]), abs=0.02)
    assert primitive.error < 1e-3
    path = tmp_path / "p.safetensors"
    save_primitives(path, TaskPrimitives(task="T-v1", stages={"go": primitive}))
    read = load_primitives(path).stages["go"]
    other = cross(rng)
    for each in (primitive, read):
        end = plan(each, other).hands["left"].points[-1]
        assert end == pytest.approx(other.points["left"][-1], abs=2e-3)


def carry(rng):
    """Take a tray by both ends from a table onto a shelf, past things that stand about."""
    anchors = {n: np.array([*rng.uniform(-0.4, 0.4, 2), 0.0]) for n in "abcdefgh"}
    table, shelf = rng.uniform(0.5, 0.6), rng.uniform(1.0, 1.2)
    anchors |= {"table": np.array([*rng.uniform(-0.1, 0.1, 2), table]),
                "shelf": np.array([*rng.uniform(-0.1, 0.1, 2), shelf])}  # fmt: skip
    half = np.array([rng.uniform(0.1, 0.2), 0.0, 0.0])
    share = np.linspace(0, 1, 21)[:, None]
    middle = anchors["table"] + share * (anchors["shelf"] - anchors["table"])
    still = {side: np.zeros((21, 3)) for side in ("left", "right")}
    return Recording(anchors=anchors, points={"left": middle - half, "right": middle + half},
                     hands=still, turns=still)  # fmt: skip


def test_hands_at_one_height_stay_at_one_height_that_few_recordings_tell():
    rng = np.random.default_rng(8)
    primitive = fit_primitive([carry(rng) for _ in range(8)])
    for _ in range(5):
        other = carry(rng)
        left, right = (plan(primitive, other).hands[side].points for side in ("left", "right"))
        assert left[:, 2] == pytest.approx(right[:, 2], abs=1e-3)
        assert left[-1, 2] == pytest.approx(other.anchors["shelf"][2], abs=5e-3)


def test_longer_ways_take_longer_and_pauses_do_not():
    rng = np.random.default_rng(2)
    primitive = fit_primitive([record(rng) for _ in range(8)])
    near = record(rng, anchors={"chest": np.array([0.1, 0.1, 0.0])})
    far = record(rng, anchors={"chest": np.array([-0.4, 0.1, 0.0])})
    for other in (near, far):
        count = len(plan(primitive, other).hands["left"].points)
        assert abs(count - (len(other.points["left"]) - 1)) <= 3


def test_the_blind_way_is_the_mean_displacement():
    rng = np.random.default_rng(3)
    recordings = [record(rng) for _ in range(5)]
    primitive = fit_primitive(recordings)
    mean = np.mean([r.points["left"][-1] - r.points["left"][0] for r in recordings], axis=0)
    other = record(rng)
    way = plan(primitive, other, is_blind=True).hands["left"]
    assert way.points[-1] - other.points["left"][0] == pytest.approx(mean, abs=1e-9)
    assert plan(primitive, other, is_blind=True).spread == 0


def test_errors_and_spread_tell_the_noise_of_recordings():
    rng = np.random.default_rng(4)
    primitive = fit_primitive([record(rng, noise=0.02) for _ in range(12)])
    truth = np.sqrt(3) * 0.02
    assert 0.5 * truth < primitive.error < 2 * truth
    inside = record(rng)
    far = record(rng, anchors={"chest": np.array([-2.0, 1.5, 0.0])})
    assert plan(primitive, far).spread > 1.5 * plan(primitive, inside).spread > 0


def test_unfit_recordings_are_refused():
    rng = np.random.default_rng(5)
    good = [record(rng) for _ in range(3)]
    moved = record(rng)
    way = np.tile(moved.points["left"][:1], (len(moved.turns["left"]), 1))
    still = Recording(anchors=moved.anchors, turns=moved.turns, hands=moved.hands,
                      points={"left": way})  # fmt: skip
    for recordings, message in (
        (good[:2], "needs 3 recordings or more; got 2"),
        ([*good, still], "a hand must move in every recording; got 0.000 m"),
        ([*good, record(rng, poses=1)], "must be of the same hands"),
    ):
        with pytest.raises(PrimitiveError, match=message):
            fit_primitive(recordings)
    way = {"left": np.zeros((4, 3))}
    for fields, message in (
        ({"points": {}}, "the way of a hand; got none"),
        ({"turns": {"right": way["left"]}}, r"turns must be of \['left'\]; got \['right'\]"),
        ({"points": {"left": np.zeros((4, 2))}}, r"must have shape \(T, 3\); got \(4, 2\)"),
        ({"points": {"left": np.full((4, 3), np.nan)}}, "points of left must be finite"),
        ({"turns": {"left": np.zeros((3, 3))}}, r"2 frames or more, alike; got {3, 4}"),
        ({"anchors": {"a": np.zeros(2)}}, "anchor a must be 3 finite numbers"),
    ):
        with pytest.raises(PrimitiveError, match=message):
            Recording(**{"anchors": {}, "points": way, "turns": way, "hands": way} | fields)
    primitive = fit_primitive(good)
    with pytest.raises(PrimitiveError, match=r"starts must be of .'left'.; got .'right'."):
        primitive.plan({"right": np.zeros(3)}, good[0].anchors)
    with pytest.raises(PrimitiveError, match="anchors must have chest; got"):
        primitive.plan({"left": np.zeros(3)}, {n: good[0].anchors[n] for n in ("cuff", "joint")})


def test_a_file_gives_back_the_same_ways(tmp_path):
    rng = np.random.default_rng(6)
    primitive = fit_primitive([record(rng) for _ in range(5)])
    saved = TaskPrimitives(task="A-v1", stages={"fold": primitive}, card={"episodes": ["0.h5"]})
    save_primitives(tmp_path / "a.safetensors", saved)
    found = load_primitives(tmp_path / "a.safetensors")
    assert (found.task, found.card) == ("A-v1", {"episodes": ["0.h5"]})
    other = record(rng)
    wanted, got = plan(primitive, other), plan(found.stages["fold"], other)
    assert got.spread == pytest.approx(wanted.spread, abs=1e-5)
    for name in ("points", "turns", "poses"):
        for side in ("left",):
            assert getattr(got.hands[side], name) == pytest.approx(
                getattr(wanted.hands[side], name), abs=1e-5
            )


def test_damaged_and_missing_files_are_refused(tmp_path):
    rng = np.random.default_rng(7)
    path = tmp_path / "a.safetensors"
    stages = {"fold": fit_primitive([record(rng) for _ in range(4)])}
    save_primitives(path, TaskPrimitives(task="A-v1", stages=stages))
    whole = path.read_bytes()
    for content in (b"", whole[:-4], whole.replace(b'chest', b'breas', 1), whole[:-1] + b"\x7f",
                    whole.replace(b'dgl_sadp.primitives', b'dgl_sadp.primitivez', 1)):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(CheckpointError, match=r"a\.safetensors"):
            load_primitives(path)
    with pytest.raises(CheckpointError, match=r"no primitives of Juggle-v1.*dgl train primitive"):
        find_primitives("Juggle-v1")
