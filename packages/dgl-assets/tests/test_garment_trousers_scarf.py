"""Trousers and scarves: measures, places, and what is refused."""

from dataclasses import fields, replace

import numpy as np
import pytest

from dgl_assets import (
    ScarfParameters,
    TrousersParameters,
    make_scarf,
    make_trousers,
    sample_scarf,
    sample_trousers,
)
from dgl_assets.garments.scarves.garment import SCARF_RANGES, ScarfPattern
from dgl_assets.garments.trousers.parameters import TROUSERS_RANGES
from dgl_assets.garments.trousers.pattern import U_INSEAM, V_CROTCH, LegPattern

ALL = [(TrousersParameters(), TROUSERS_RANGES), (ScarfParameters(), SCARF_RANGES)]


@pytest.mark.parametrize(("valid", "ranges"), ALL, ids=lambda p: type(p).__name__)
def test_every_number_has_a_range_and_a_description(valid, ranges):
    numbers = {f.name for f in fields(valid) if not isinstance(getattr(valid, f.name), str)}
    assert numbers == set(ranges)
    for name, (low, high) in ranges.items():
        assert f"{name}: " in type(valid).__doc__
        for value in (low - 0.01, high + 0.01, float("inf")):
            with pytest.raises(ValueError, match=rf"{name} must be .* got"):
                replace(valid, **{name: value})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"waist_half_width": 0.25}, "waist_half_width must be at most"),
        ({"thigh_width": 0.18}, "thigh_width must be 0.85"),
        ({"waist_front_drop": 0.05, "rise": 0.15}, "waist_front_drop must be at most"),
        ({"pocket_bulge": 0.02, "inseam_length": 0.12}, "pocket_bulge needs"),
    ],
)
def test_contradicting_measures_of_trousers_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(TrousersParameters(), **changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"leg_angle": 0.0, "knee_width": 0.3}, "the legs lie on each other"),
        ({"inseam_length": 0.03, "hem_width": 0.2, "leg_angle": 0.3}, "legs|hem|seams"),
    ],
)
def test_trousers_that_cannot_be_cut_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        make_trousers(replace(TrousersParameters(), **changes))


@pytest.mark.parametrize("layer", [1, -1])
@pytest.mark.parametrize("seed", range(4))
def test_maps_of_legs_invert_each_other(seed, layer):
    rng = np.random.default_rng(seed)
    parameters = sample_trousers(seed)
    leg = LegPattern(parameters, angle=parameters.leg_angle)
    v = rng.uniform(0, 1, 300)
    low = U_INSEAM * np.clip(1 - v / V_CROTCH, 0, 1)
    canonical = np.stack([low + rng.uniform(0, 1, 300) * (1 - low), v], axis=1)
    points = leg.get_map(layer).to_pattern(canonical)
    assert np.allclose(leg.get_map(layer).to_canonical(points), canonical, atol=1e-6)


def test_trousers_measure_what_was_asked_for():
    p = TrousersParameters(leg_angle=0.1, waist_front_drop=0.02)
    trousers = make_trousers(p)
    at = {name: trousers.vertices[k] for name, k in trousers.landmarks.items()}
    waist = at["right_waist_corner"] - at["left_waist_corner"]
    assert waist[0] == pytest.approx(2 * p.waist_half_width, rel=1e-4)
    assert at["left_waist_corner"][1] - at["crotch"][1] == pytest.approx(p.rise, rel=1e-4)
    assert at["left_waist_corner"][1] - at["waist_centre"][1] == pytest.approx(0.02, abs=1e-5)
    hem = at["right_hem_outer_corner"] - at["right_hem_inner_corner"]
    assert np.linalg.norm(hem) == pytest.approx(p.hem_width, rel=0.01)
    assert at["crotch"][2] == 0
    assert trousers.canonical[trousers.landmarks["crotch"], 2] == 0  # both layers meet


def test_trousers_are_long_and_short_and_of_many_legs():
    drawn = [sample_trousers(seed) for seed in range(60)]
    lengths = [t.inseam_length for t in drawn]
    assert min(lengths) < 0.15 < 0.6 < max(lengths)
    flare = [t.hem_width / t.knee_width for t in drawn if t.inseam_length > 0.4]
    assert min(flare) < 0.7
    assert max(flare) > 1.4
    assert all(t.rise + t.inseam_length <= 1.0 for t in drawn)
    assert min(t.rise for t in (sample_trousers(s, sizes="all") for s in range(60))) < 0.15


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"end": "pointed"}, "end_depth must be 0 for straight"),
        ({"end_depth": 0.1}, "end_depth must be 0 for straight"),
        ({"end": "rounded", "end_depth": 0.19}, "too sharp"),
        ({"end": "fringed"}, "end must be one of"),
    ],
)
def test_contradicting_measures_of_a_scarf_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(ScarfParameters(), **changes)


def test_a_scarf_is_one_layer_of_the_size_that_was_asked_for():
    scarf = make_scarf(ScarfParameters(length=1.4, width=0.3, end="pointed", end_depth=0.12))
    assert scarf.extent[0] == pytest.approx(1.4, rel=1e-4)
    assert scarf.extent[1] == pytest.approx(0.3, rel=1e-3)
    assert set(scarf.canonical[:, 2]) == {1}
    assert scarf.panels == ("front",)
    tips = scarf.get_landmark_positions(("left_tip", "right_tip"))
    assert np.allclose(tips[:, 0], [-0.7, 0.7], atol=1e-4)


@pytest.mark.parametrize("seed", range(4))
def test_maps_of_scarves_invert_each_other(seed):
    rng = np.random.default_rng(seed)
    pattern = ScarfPattern(sample_scarf(seed))
    canonical = np.stack([rng.uniform(-0.96, 0.96, 200), rng.uniform(0, 1, 200)], axis=1)
    points = pattern.map.to_pattern(canonical)
    assert np.allclose(pattern.map.to_canonical(points), canonical, atol=1e-6)


def test_random_scarves_have_the_stated_sizes_and_several_ends():
    drawn = [sample_scarf(seed) for seed in range(60)]
    assert all(1.2 <= s.length <= 1.5 and 0.2 <= s.width <= 0.4 for s in drawn)
    assert {s.end for s in drawn} == {"straight", "pointed", "rounded", "slanted"}
