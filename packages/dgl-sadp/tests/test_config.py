import dataclasses
import json

import pytest
import torch

from dgl_sadp import DiffusionPolicy, PolicyConfig, get_policy_config
from dgl_sadp.config import PointsConfig, UNetConfig


def count(module: torch.nn.Module) -> float:
    return sum(parameter.numel() for parameter in module.parameters()) / 1e6


@pytest.mark.parametrize(
    ("method", "frame", "unet", "whole"),
    # Lengths of conditions and millions of parameters as published, to the digits that are given.
    [
        ("sadp", 256, None, 268),
        ("sadp-g", 256, None, 268),
        ("dp3", 192, None, 263),
        # 12 more than published: how far the arms' joints, which no layer compresses, have come.
        ("dp", 572 + 12, 88, None),
    ],
)
def test_paper_presets_have_the_published_sizes(method, frame, unet, whole):
    config = get_policy_config(method, "paper")
    with torch.device("meta"):
        policy = DiffusionPolicy(config)
    assert policy.encoder.frame_features == frame
    assert policy.encoder.features == 3 * frame
    if whole is not None:
        assert count(policy) == pytest.approx(whole, abs=1)
    if unet is not None:
        assert count(policy.unet) == pytest.approx(unet, abs=1)


def test_presets_have_the_published_horizons_and_denoising(method):
    for size in ("small", "paper"):
        config = get_policy_config(method, size)
        assert (config.horizon, config.observation_steps, config.action_steps) == (8, 3, 4)
        assert list(range(8))[config.executed] == [2, 3, 4, 5]
        is_dp = method == "dp"
        assert config.diffusion.training_steps == 100
        assert config.diffusion.inference_steps == (100 if is_dp else 10)
        assert config.diffusion.prediction == ("epsilon" if is_dp else "sample")


def test_policies_differ_by_what_they_observe():
    keys = {
        name: (*(config := get_policy_config(name)).frame_keys, *config.stage_keys)
        for name in ("sadp", "sadp-g", "dp3", "dp")
    }
    garment = ("garment_point_cloud", "points_affordance_feature")
    assert keys == {
        "sadp": ("joint_state", "env_point_cloud", *garment, "object_point_cloud"),
        "sadp-g": ("joint_state", "env_point_cloud", *garment),
        "dp3": ("joint_state", "env_point_cloud"),
        "dp": ("joint_state", "image"),
    }


def test_a_configuration_survives_json(method):
    for size in ("small", "paper"):
        config = get_policy_config(method, size)
        assert PolicyConfig.from_json(config.to_json()) == config


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: v.update(colour=True), "colour"),
        (lambda v: v["unet"].update(dropout=0.1), "dropout"),
        (lambda v: v["garment"]["levels"][0].update(heads=2), "heads"),
        (lambda v: v.pop("unet"), "unet"),
        # Policies from before it was there meant other targets.
        (lambda v: v.pop("relative_joints"), "relative_joints"),
        (lambda v: v.update(horizon="8"), "horizon"),
        (lambda v: v.update(method="rdt"), "method"),
        (lambda v: v.update(state=5), "state should be a valid array; got 5"),
        (lambda v: v["unet"].update(widths=[16, 20]), "multiples of groups = 8"),
    ],
)
def test_unknown_missing_and_wrong_fields_are_refused(change, message):
    values = json.loads(get_policy_config("sadp").to_json())
    change(values)
    with pytest.raises(ValueError, match=message):
        PolicyConfig.from_json(json.dumps(values))


def test_what_is_no_object_is_refused():
    with pytest.raises(ValueError, match="must be an object; got"):
        PolicyConfig.from_json("[1]")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"horizon": 5}, r"at least observation_steps - 1 \+ action_steps = 6; got 5"),
        ({"horizon": 10}, r"horizon must be a multiple of 4"),
        ({"object": None}, r"sadp observes \['environment', 'garment', 'object'\]; got"),
        ({"joints": 0}, r"joints should be greater than or equal to 1; got 0"),
        ({"state": (0,)}, r"state\[0\] should be greater than or equal to 1; got 0"),
        ({"relative_joints": (0, 60)}, r"must ascend within 0 \.\.\. 59; got \(0, 60\)"),
        ({"relative_joints": (1, 0)}, r"must ascend within 0 \.\.\. 59; got \(1, 0\)"),
        ({"relative_joints": (1, 1)}, r"must ascend within 0 \.\.\. 59; got \(1, 1\)"),
        (
            {"object": PointsConfig(points=8, widths=(8,), features=8, use_color=True)},
            "object must not use_color",
        ),
    ],
)
def test_fields_out_of_range_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(get_policy_config("sadp"), **change)


def test_unknown_presets_are_refused_with_a_hint():
    with pytest.raises(ValueError, match="did you mean 'sadp-g'"):
        get_policy_config("sadp_g")
    with pytest.raises(ValueError, match=r"size must be one of .*; got 'big'"):
        get_policy_config("sadp", "big")


def test_other_horizons_than_the_published_are_possible():
    config = dataclasses.replace(
        get_policy_config("dp3"),
        unet=UNetConfig(widths=(16, 16), step_embedding=8),
        horizon=16,
        observation_steps=2,
        action_steps=8,
    )
    assert config.executed == slice(1, 9)
