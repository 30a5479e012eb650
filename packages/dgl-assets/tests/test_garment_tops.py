"""Upper garments: their parts, and measures that are refused."""

import inspect
import re
from dataclasses import fields, replace

import numpy as np
import pytest

from dgl_assets import (
    Armhole,
    Body,
    DressParameters,
    FrontOpenParameters,
    Neck,
    Opening,
    ScarfParameters,
    Sleeve,
    SleevelessParameters,
    TopParameters,
    TrousersParameters,
    make_garment,
    sample_measures,
)
from dgl_assets.errors import MeshingError
from dgl_assets.garments import assembly
from dgl_assets.garments.meshing import compute_edges
from dgl_assets.garments.sewing import sew_panels
from dgl_assets.garments.uppers.half import HalfPattern
from dgl_assets.garments.uppers.sleeve import V_ARMPIT
from dgl_assets.importing.topology import find_loops
from dgl_assets.ranges import get_ranges

COLLARS = {
    "plain": Neck(),
    "stand": Neck(finish="stand", height=0.06),
    "fold": Neck(finish="fold", height=0.028, spread=0.03, leaf_width=0.05),
    "hood": Neck(finish="hood", height=0.27, spread=0.045),
}


@pytest.fixture(scope="module")
def drawn() -> list[TopParameters]:
    """Tops within reach."""
    return [sample_measures("Tops_LongSleeve", seed) for seed in range(30)]


@pytest.fixture(scope="module")
def drawn_of_all_sizes() -> list[TopParameters]:
    return [sample_measures("Tops_LongSleeve", seed, sizes="all") for seed in range(30)]


def test_every_number_has_a_range_and_a_description(find_unrefused):
    parts = (
        Body(),
        Neck(),
        Sleeve(),
        Armhole(),
        Opening(),
        TrousersParameters(),
        ScarfParameters(),
    )
    for part in parts:
        ranges = get_ranges(type(part))
        numbers = {f.name for f in fields(part) if not isinstance(getattr(part, f.name), str)}
        assert numbers == set(ranges)
        source = inspect.getsource(type(part))
        for name, (low, high) in ranges.items():
            assert low < high
            assert re.search(rf"\n    {name}: .*\n    \"\"\"", source), name
        rows = [
            (lambda p=part, n=name, v=value: replace(p, **{n: v}), rf"{name} must be .* got")
            for name, (low, high) in ranges.items()
            for value in (low - 0.01, high + 0.01, float("nan"), float("inf"), True, "1")
        ]
        assert find_unrefused(rows) == []


def test_contradicting_measures_of_body_and_neck_are_refused(find_unrefused):
    fold = {"finish": "fold", "height": 0.03}
    table = [
        (
            Body(),
            {"shoulder_half_width": 0.239},
            {"shoulder_half_width": 0.241},
            "chest_half_width",
        ),
        (Body(), {"waist_depth": 0.236}, {"waist_depth": 0.234}, "armhole_depth"),
        (Body(), {"length": 0.296}, {"length": 0.294}, "armhole_depth"),
        (Body(), {"hip_half_width": 0.18}, {"hip_half_width": 0.17}, "waist_half_width"),
        (Neck(), {"finish": "stand", "height": 0.015}, {"height": 0.014}, "height must be in"),
        (Neck(), {"height": 0.0}, {"height": 0.05}, "for finish 'plain'"),
        (Neck(), {**fold, "leaf_width": 0.025}, {"leaf_width": 0.024}, "leaf_width must be"),
        (
            Neck(),
            {**fold, "leaf_width": 0.05, "spread": 0.036},
            {"spread": 0.037},
            "spread of a folded collar",
        ),
        (Neck(), {"back_depth": 0.10}, {"back_depth": 0.11}, "front_depth"),
        (Neck(), {"finish": "plain"}, {"finish": "ruff"}, "finish must be one of"),
    ]
    valid = [replace(part, **accepted) for part, accepted, _, _ in table]
    rows = [
        (lambda p=part, c=change: replace(p, **c), message)
        for part, (_, _, change, message) in zip(valid, table, strict=True)
    ]
    assert find_unrefused(rows) == []


def test_garments_that_cannot_be_cut_are_refused(find_unrefused):
    wide = Body(waist_depth=0.3, waist_half_width=0.4, hem_half_width=0.6)
    tops = [
        ({"sleeve": Sleeve(upper_width=0.25)}, "upper_width of the sleeve must be in"),
        ({"sleeve": Sleeve(angle=0.25)}, "at least as steeply as the shoulder"),
        ({"sleeve": Sleeve(length=0.1)}, "underarm seam must be at least"),
        ({"sleeve": Sleeve(cuff_width=0.3)}, "width of a sleeve may change"),
        ({"neck": Neck(half_width=0.168)}, "at least 0.024 m below"),
        ({"neck": Neck(front_depth=0.21)}, "front_depth must be at most"),
        ({"neck": Neck(finish="lapel", height=0.03, leaf_width=0.07)}, "open front"),
        ({"body": wide}, "a sleeve lies on the body"),
        ({"body": Body(length=0.30, hem_curve=0.06)}, "side seam must be at least"),
    ]
    hooded = FrontOpenParameters(neck=COLLARS["hood"], opening=Opening(top_gap=-0.01))
    gaping = FrontOpenParameters(opening=Opening(top_gap=0.06))
    scooped = SleevelessParameters(
        body=Body(shoulder_half_width=0.12), armhole=Armhole(back_scoop=0.08)
    )
    rows = [(lambda m=measures: make_garment(TopParameters(**m)), text) for measures, text in tops]
    rows += [
        (lambda: make_garment(hooded), "below a hood must not overlap"),
        (lambda: make_garment(gaping), "top_gap must be at most"),
        (lambda: make_garment(scooped), "armhole reaches the neck"),
        (lambda: DressParameters(body=Body(length=0.48)), "length of a dress must be"),
    ]
    assert find_unrefused(rows) == []


def test_every_collar_is_sewn_to_closed_and_to_open_fronts():
    plain = make_garment(TopParameters(), spacing=0.02)
    for finish, neck in COLLARS.items():
        top = make_garment(TopParameters(neck=neck), spacing=0.02)
        coat = make_garment(FrontOpenParameters(neck=neck), spacing=0.02)
        assert len(find_loops(top.faces)) == 4
        assert len(find_loops(coat.faces)) == 3
        above = top.vertices[top.landmarks["left_neck_side"], 1]
        if finish == "plain":
            assert np.array_equal(top.vertices, plain.vertices)
        else:  # something stands above the neck
            assert top.vertices[:, 1].max() > above + 0.02
            assert top.area > plain.area


def test_a_folded_leaf_lies_on_the_front():
    top = make_garment(TopParameters(neck=COLLARS["fold"]))
    leaf = [k for k, name in enumerate(top.panels) if name.endswith("_flap")]
    assert len(leaf) == 2
    ids = np.unique(top.faces[np.isin(top.face_panels, leaf)])
    body = np.unique(top.faces[top.face_panels == top.panels.index("front_body")])
    inner = np.setdiff1d(ids, body)
    # Its free edge lies above the front below it, by most of the gap.
    assert top.vertices[inner, 2].max() > 0.012
    assert np.all(top.canonical[inner, 1] > top.canonical[np.intersect1d(ids, body), 1].min())


def test_lapels_lie_on_both_fronts():
    neck = Neck(
        finish="lapel",
        height=0.03,
        spread=0.03,
        leaf_width=0.07,
        front_depth=0.3,
        roundness=1.05,
        leaf_angle=0.6,
    )
    coat = make_garment(FrontOpenParameters(neck=neck))
    assert {"front_left_collar_flap", "front_right_collar_flap"} <= set(coat.panels)


def test_overlapping_fronts_lie_right_over_left():
    coat = make_garment(FrontOpenParameters(opening=Opening(top_gap=-0.03, hem_gap=-0.03)))
    in_lap = np.abs(coat.vertices[:, 0]) < 0.02
    height = {}
    for hand in ("left", "right"):
        index = coat.panels.index(f"front_{hand}_body")
        ids = np.unique(coat.faces[coat.face_panels == index])
        height[hand] = coat.vertices[ids[in_lap[ids]], 2]
    assert height["right"].min() > height["left"].max() + 0.005
    left, right = coat.get_landmark_positions(("left_opening_hem", "right_opening_hem"))
    assert left[0] == pytest.approx(0.03, abs=0.005)
    assert right[0] == pytest.approx(-0.03, abs=0.005)


def test_a_raglan_seam_does_not_move_places():
    set_in = make_garment(TopParameters())
    raglan = make_garment(TopParameters(sleeve=Sleeve(seam="raglan")))
    area = {}
    for name, top in (("set_in", set_in), ("raglan", raglan)):
        is_sleeve = top.face_panels == top.panels.index("front_left_sleeve")
        area[name] = is_sleeve.sum()
    assert area["raglan"] > 1.1 * area["set_in"]
    names = ("left_shoulder", "right_upper_chest", "left_sleeve_joint", "centre")
    moved = raglan.get_landmark_positions(names) - set_in.get_landmark_positions(names)
    assert np.linalg.norm(moved, axis=1).max() < 0.012  # the rounder shoulder


@pytest.mark.parametrize("layer", [1, -1])
@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(
    "category", ["Tops_LongSleeve", "Tops_NoSleeve", "Tops_FrontOpen", "Dress_LongSleeve"]
)
def test_maps_invert_each_other(category, seed, layer):
    cuts = sample_measures(category, seed).cuts
    rng = np.random.default_rng(0)
    half = HalfPattern(cuts, sign=1)
    low = 0.06 if cuts.opening is not None and layer > 0 else 0.0
    body = np.stack([rng.uniform(low, 0.84, 300), rng.uniform(0, 0.68, 300)], axis=1)
    points = half.body_to_pattern(body, layer=layer)
    assert np.allclose(half.body_to_canonical(points, layer=layer), body, atol=1e-6)
    if half.sleeve is not None:
        sleeve = np.stack([rng.uniform(1, 2, 300), rng.uniform(V_ARMPIT, 1, 300)], axis=1)
        points = half.sleeve.to_pattern(sleeve)
        assert np.allclose(half.sleeve.to_canonical(points), sleeve, atol=1e-6)


def test_map_is_continuous_across_the_armhole():
    half = HalfPattern(sample_measures("Tops_LongSleeve", 3).cuts, sign=1)
    v = np.linspace(V_ARMPIT, 1, 50)
    inside = half.to_pattern(np.stack([np.full(50, 1 - 1e-9), v], axis=1), layer=1)
    outside = half.to_pattern(np.stack([np.full(50, 1 + 1e-9), v], axis=1), layer=1)
    assert np.allclose(inside, outside, atol=1e-4)


def test_landmarks_are_at_their_tailoring_places(families):
    for top in families["Tops_LongSleeve"]:
        p = dict(zip(top.landmarks, top.vertices[list(top.landmarks.values())], strict=True))
        for hand, sign in (("left", -1), ("right", 1)):
            cuff, armpit, neck = (
                sign * p[f"{hand}_{n}"][0] for n in ("cuff", "armpit", "neck_side")
            )
            assert cuff > armpit > neck > 0
            upper, lower = p[f"{hand}_cuff_upper"], p[f"{hand}_cuff_lower"]
            width = np.linalg.norm(upper - lower)
            assert width == pytest.approx(top.parameters["sleeve_cuff_width"], rel=0.02)
            assert 0.008 < np.linalg.norm(p[f"{hand}_cuff"] - (upper + lower) / 2) < 0.05
        chest = p["right_armpit"][0] - p["left_armpit"][0]
        assert chest == pytest.approx(2 * top.parameters["body_chest_half_width"], rel=1e-3)
        assert top.canonical[top.landmarks["collar"], 2] == -1


def test_the_front_neckline_is_deeper_than_the_back():
    top = make_garment(TopParameters())
    loops = find_loops(top.faces)
    neck = next(loop for loop in loops if np.abs(top.canonical[loop, 0]).max() < 0.5)
    y, side = top.vertices[neck, 1], top.canonical[neck, 2]
    assert y[side < 0].min() - y[side > 0].min() == pytest.approx(0.085 - 0.018, abs=0.004)


def test_dresses_are_long_or_short_with_long_or_short_sleeves():
    dresses = [sample_measures("Dress_LongSleeve", seed, sizes="all") for seed in range(40)]
    kinds = {(d.body.length > 0.9, d.sleeve.length > 0.35) for d in dresses}
    assert len(kinds) == 4


def test_necks_sleeves_and_collars_vary(drawn, drawn_of_all_sizes):
    assert {t.neck.finish for t in drawn} == {"plain", "stand", "fold"}  # the robots' have no hood
    assert "hood" in {t.neck.finish for t in drawn_of_all_sizes}
    assert {t.sleeve.seam for t in drawn} == {"set_in", "raglan"}
    coats = [sample_measures("Tops_FrontOpen", seed) for seed in range(12)]
    assert "lapel" in {c.neck.finish for c in coats}
    assert min(c.opening.top_gap for c in coats) < 0 < max(c.opening.top_gap for c in coats)
    widths = [t.body.chest_half_width / t.body.length for t in drawn]
    tapers = [t.sleeve.cuff_width / t.sleeve.upper_width for t in drawn]
    assert max(widths) / min(widths) > 2
    assert max(tapers) / min(tapers) > 2


@pytest.mark.parametrize("category", ["Tops_LongSleeve", "Baseball_Cap", "Bowl_Hat"])
def test_random_measures_follow_the_generator(category):
    rng = np.random.default_rng(7)
    first = sample_measures(category, rng)
    assert sample_measures(category, 7) == first
    assert sample_measures(category, 8) != first
    assert sample_measures(category, rng) != first


def test_tops_in_reach_span_what_both_robots_reach_and_others_need_not(drawn, drawn_of_all_sizes):
    spans = [top.span for top in drawn]
    assert 1.0 <= min(spans) < 1.04
    assert 1.11 < max(spans) <= 1.15
    free = [top.span for top in drawn_of_all_sizes]
    assert min(free) < 0.85  # a child's
    assert max(free) > 1.2


def test_a_given_spacing_is_followed():
    spacing = 0.02
    top = make_garment(TopParameters(neck=COLLARS["stand"]), spacing=spacing)
    edges, _ = compute_edges(top.faces)
    ends = top.rest_vertices[edges]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert np.median(lengths) == pytest.approx(spacing, rel=0.08)


def test_a_garment_that_cannot_be_filled_is_filled_at_a_spacing_near_by(monkeypatch):
    asked = []

    def sew(curves, panels, *, spacing):
        asked.append(spacing)
        if len(asked) < 3:
            raise MeshingError(f"no. {len(asked)}")
        return sew_panels(curves, panels, spacing=spacing)

    monkeypatch.setattr(assembly, "sew_panels", sew)
    top = make_garment(TopParameters(), spacing=0.02)
    assert asked == pytest.approx([0.02, 0.0196, 0.0204])
    assert len(find_loops(top.faces)) == 4  # hem, neck and two cuffs

    def refuse(curves, panels, *, spacing):
        raise MeshingError(f"at {spacing}")

    monkeypatch.setattr(assembly, "sew_panels", refuse)
    with pytest.raises(MeshingError, match=r"^at 0\.02$"):
        make_garment(TopParameters(), spacing=0.02)


def test_options_out_of_range_are_refused(find_unrefused):
    rows = [
        (lambda n=n, v=v: make_garment(TopParameters(), **{n: v}), rf"{n} must be in .* got {v}")
        for n, v in (("spacing", 0.003), ("spacing", 0.03))
    ]
    assert find_unrefused(rows) == []
