"""Measures: what is accepted, what is refused, and how random ones are drawn."""

from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from dgl_assets import TopParameters, make_top, sample_top
from dgl_assets.garments.tops.parameters import PARAMETER_RANGES
from dgl_assets.garments.tops.pattern import TopPattern


def test_every_measure_has_a_range_and_a_description():
    names = {field.name for field in fields(TopParameters)}
    assert names == set(PARAMETER_RANGES)
    assert TopParameters.__doc__ is not None
    for name, (low, high) in PARAMETER_RANGES.items():
        assert low < high
        assert f"{name}: " in TopParameters.__doc__


@pytest.mark.parametrize("name", sorted(PARAMETER_RANGES))
def test_values_outside_the_range_are_refused_by_name(name):
    low, high = PARAMETER_RANGES[name]
    for value in (low - 0.01, high + 0.01, float("nan")):
        with pytest.raises(ValueError, match=rf"{name} must be .* got"):
            replace(TopParameters(), **{name: value})


@pytest.mark.parametrize(
    ("accepted", "refused", "message"),
    [
        (
            {"neck_half_width": 0.105, "shoulder_half_width": 0.141},
            {"shoulder_half_width": 0.139},
            ".*",
        ),
        ({"shoulder_half_width": 0.237}, {"shoulder_half_width": 0.239}, "chest_half_width"),
        ({"neck_back_depth": 0.03}, {"neck_front_depth": 0.035}, "neck_back_depth"),
        ({"armhole_depth": 0.16, "neck_front_depth": 0.12}, {"neck_front_depth": 0.14}, "armhole"),
        ({"neck_roundness": 3.3}, {"neck_roundness": 3.5}, "slope of the neckline"),
        ({"collar_height": 0.015}, {"collar_height": 0.014}, "collar_height must be 0 or"),
        ({"sleeve_angle": 0.42, "shoulder_slope": 0.41}, {"shoulder_slope": 0.43}, "steeply"),
    ],
)
def test_contradicting_measures_are_refused_and_their_neighbours_accepted(
    accepted, refused, message
):
    valid = replace(TopParameters(), **accepted)
    with pytest.raises(ValueError, match=message):
        replace(valid, **refused)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"upper_sleeve_width": 0.2}, r"upper_sleeve_width must be in \[.*\].* got 0.2"),
        (
            {
                "sleeve_angle": 1.0,
                "hem_flare": 0.09,
                "upper_sleeve_width": 0.075,
                "cuff_width": 0.16,
            },
            "sleeve lies on the body",
        ),
        ({"sleeve_length": 0.34, "armhole_depth": 0.3}, "underarm seam must be at least 0.15 m"),
    ],
)
def test_patterns_that_cannot_be_cut_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        make_top(replace(TopParameters(), **changes))


def test_random_measures_follow_the_generator():
    assert sample_top(7) == sample_top(np.random.default_rng(7))
    assert sample_top(7) != sample_top(8)
    rng = np.random.default_rng(7)
    assert sample_top(rng) != sample_top(rng)


def test_random_measures_are_valid_and_within_reach():
    rng = np.random.default_rng(0)
    spans = []
    for _ in range(200):
        parameters = sample_top(rng)
        TopPattern(parameters)
        spans.append(parameters.span)
        assert all(isinstance(value, float) for value in asdict(parameters).values())
    assert 1.0 <= min(spans) < 1.03
    assert 1.12 < max(spans) <= 1.15
