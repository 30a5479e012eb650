"""Trousers and scarves: measures, landmarks, and measures that are refused."""

from dataclasses import replace

import numpy as np
import pytest

from dgl_assets import (
    ScarfParameters,
    TrousersParameters,
    make_garment,
    sample_measures,
)
from dgl_assets.garments.scarves.garment import ScarfPattern
from dgl_assets.garments.trousers.pattern import U_INSEAM, V_CROTCH, LegPattern


def test_contradicting_measures_are_refused(find_unrefused):
    trousers, scarf = TrousersParameters(), ScarfParameters()
    table = [
        (trousers, {"waist_half_width": 0.25}, "waist_half_width must be at most"),
        (trousers, {"thigh_width": 0.18}, "thigh_width must be 0.85"),
        (trousers, {"waist_front_drop": 0.05, "rise": 0.15}, "waist_front_drop must be at most"),
        (trousers, {"pocket_bulge": 0.02, "inseam_length": 0.12}, "pocket_bulge needs"),
        (scarf, {"end": "pointed"}, "end_depth must be 0 for straight"),
        (scarf, {"end_depth": 0.1}, "end_depth must be 0 for straight"),
        (scarf, {"end": "rounded", "end_depth": 0.19}, "too sharp"),
        (scarf, {"end": "fringed"}, "end must be one of"),
    ]
    rows = [(lambda p=p, c=c: replace(p, **c), message) for p, c, message in table]
    cannot_be_cut = [
        ({"leg_angle": 0.0, "knee_width": 0.3}, "the legs lie on each other"),
        ({"inseam_length": 0.03, "hem_width": 0.2, "leg_angle": 0.3}, "legs|hem|seams"),
    ]
    rows += [(lambda c=c: make_garment(replace(trousers, **c)), m) for c, m in cannot_be_cut]
    assert find_unrefused(rows) == []


@pytest.mark.parametrize("layer", [1, -1])
@pytest.mark.parametrize("seed", range(2))
def test_maps_of_legs_invert_each_other(seed, layer):
    rng = np.random.default_rng(seed)
    parameters = sample_measures("Trousers", seed)
    leg = LegPattern(parameters, angle=parameters.leg_angle)
    v = rng.uniform(0, 1, 300)
    low = U_INSEAM * np.clip(1 - v / V_CROTCH, 0, 1)
    canonical = np.stack([low + rng.uniform(0, 1, 300) * (1 - low), v], axis=1)
    points = leg.get_map(layer).to_pattern(canonical)
    assert np.allclose(leg.get_map(layer).to_canonical(points), canonical, atol=1e-6)


def test_trousers_measure_what_was_asked_for():
    p = TrousersParameters(leg_angle=0.1, waist_front_drop=0.02)
    trousers = make_garment(p)
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
    drawn = [sample_measures("Trousers", seed) for seed in range(40)]
    lengths = [t.inseam_length for t in drawn]
    assert min(lengths) < 0.15 < 0.6 < max(lengths)
    flare = [t.hem_width / t.knee_width for t in drawn if t.inseam_length > 0.4]
    assert min(flare) < 0.7
    assert max(flare) > 1.4
    assert all(t.rise + t.inseam_length <= 1.0 for t in drawn)
    every = [sample_measures("Trousers", seed, sizes="all") for seed in range(30)]
    assert min(t.rise for t in every) < 0.15


def test_a_scarf_is_one_layer_of_the_size_that_was_asked_for():
    scarf = make_garment(ScarfParameters(length=1.4, width=0.3, end="pointed", end_depth=0.12))
    assert scarf.extent[0] == pytest.approx(1.4, rel=1e-4)
    assert scarf.extent[1] == pytest.approx(0.3, rel=1e-3)
    assert set(scarf.canonical[:, 2]) == {1}
    assert scarf.panels == ("front",)
    tips = scarf.get_landmark_positions(("left_tip", "right_tip"))
    assert np.allclose(tips[:, 0], [-0.7, 0.7], atol=1e-4)


@pytest.mark.parametrize("seed", range(2))
def test_maps_of_scarves_invert_each_other(seed):
    rng = np.random.default_rng(seed)
    pattern = ScarfPattern(sample_measures("Scarf", seed))
    canonical = np.stack([rng.uniform(-0.96, 0.96, 200), rng.uniform(0, 1, 200)], axis=1)
    points = pattern.map.to_pattern(canonical)
    assert np.allclose(pattern.map.to_canonical(points), canonical, atol=1e-6)


def test_random_scarves_have_the_stated_sizes_and_several_ends():
    drawn = [sample_measures("Scarf", seed) for seed in range(60)]
    assert all(1.2 <= s.length <= 1.5 and 0.2 <= s.width <= 0.4 for s in drawn)
    assert {s.end for s in drawn} == {"straight", "pointed", "rounded", "slanted"}
