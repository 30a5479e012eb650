"""Policies learn what they should, and cannot learn what they do not see."""

import math

import pytest
import torch

from dgl_sadp import DiffusionPolicy, EpisodeDataset, TrainConfig, load_policy, train_policy
from dgl_sadp.config import (
    DiffusionConfig,
    EncoderLevelConfig,
    GarmentConfig,
    PointsConfig,
    UNetConfig,
)
from dgl_sadp.synthetic import write_synthetic_episodes
from dgl_sadp.validation import compute_validation

pytestmark = pytest.mark.usefixtures("one_thread")

COUNT = 32


@pytest.mark.slow
def test_four_episodes_are_learned_to_less_than_a_degree(tmp_path, tiny_config):
    write_synthetic_episodes(tmp_path / "episodes", 4, frames=8, points=32)
    points = PointsConfig(points=32, widths=(16, 32), features=16)
    garment = GarmentConfig(
        points=32,
        levels=(
            EncoderLevelConfig(centres=8, radius=0.4, neighbours=8, widths=(32,)),
            EncoderLevelConfig(centres=0, radius=0.0, neighbours=0, widths=(64,)),
        ),
        features=32,
    )
    config = tiny_config(
        "sadp",
        unet=UNetConfig(widths=(32, 64), step_embedding=16),
        diffusion=DiffusionConfig(),
        environment=points,
        object=points,
        garment=garment,
    )
    training = TrainConfig(
        epochs=800,
        batch=24,
        learning_rate=3e-3,
        validation_share=0.0,
        save_every=800,
        ema_decay=0.97,
        augmentation=None,
    )
    result = train_policy(tmp_path / "episodes", tmp_path / "run", config, training)
    found = compute_validation(
        load_policy(result.policy),
        EpisodeDataset(tmp_path / "episodes"),
        epoch=800,
        windows=96,
        seed=0,
    )
    # Targets differ between the episodes by tens of degrees.
    assert math.degrees(found.error) < 1.0


def draw_windows(config, seed: int) -> tuple[dict[str, torch.Tensor], torch.Tensor]:
    """Make windows with targets +1 or -1 where the affordance marks right or left."""
    generator = torch.Generator().manual_seed(seed)

    def draw(*shape):
        return torch.rand((COUNT, *shape), generator=generator) * 2 - 1

    side = torch.randint(2, (COUNT,), generator=generator) * 2.0 - 1.0
    garment = draw(64, 3)
    marked = torch.sigmoid(8.0 * side[:, None] * garment[:, :, 0])
    window = {
        "joint_state": 0.1 * draw(config.observation_steps, config.joints),
        "start_joint_state": 0.1 * draw(config.joints),
        "env_point_cloud": draw(config.observation_steps, 32, 6),
        "garment_point_cloud": garment,
        "points_affordance_feature": marked.unsqueeze(2).repeat(1, 1, 2),
        "action": side[:, None, None].repeat(1, config.horizon, config.joints),
    }
    return window, side


def learn_sides(config) -> float:
    """Train on marked garments; return the share of correct sides on new ones."""
    policy = DiffusionPolicy.make(config, seed=0)
    optimizer = torch.optim.AdamW(policy.parameters(), lr=2e-3)
    for step in range(120):
        window, _ = draw_windows(config, step)
        loss = policy(window, torch.Generator().manual_seed(step))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    policy.eval()
    right = 0.0
    for seed in range(4):
        window, side = draw_windows(config, 10_000 + seed)
        generator = torch.Generator().manual_seed(seed)
        actions = policy.predict(window, policy.encode_stage(window, generator), generator)
        chosen = actions[:, config.executed].mean(dim=(1, 2)).sign()
        right += (chosen == side).double().mean().item() / 4
    return right


@pytest.mark.slow
def test_what_only_the_affordance_says_is_learned_by_sadp_g_alone(tiny_config):
    unet = UNetConfig(widths=(16, 32), step_embedding=8)
    assert learn_sides(tiny_config("sadp-g", unet=unet)) > 0.9
    assert 0.25 < learn_sides(tiny_config("dp3", unet=unet)) < 0.75
