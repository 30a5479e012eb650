import dataclasses

import numpy as np
import pytest
import torch
from torch import nn

from dgl_sadp import DiffusionPolicy
from dgl_sadp._clouds import Augmentation
from dgl_sadp._random import Draws
from dgl_sadp.normalizer import Range


def predict(policy, batch, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return policy.predict(batch, policy.encode_stage(batch, generator), generator)


@pytest.fixture
def policy(method, tiny_config):
    return DiffusionPolicy.make(tiny_config(method), seed=0)


def test_predictions_have_the_shape_of_a_chunk_and_depend_on_the_seed(policy, random_batch):
    batch = random_batch(policy.config, count=3)
    first, again, other = (predict(policy, batch, seed) for seed in (1, 1, 2))
    assert first.shape == (3, 8, 60)
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_sampling_and_loss_leave_the_global_generator_alone(policy, random_batch, seeded):
    before = torch.get_rng_state()
    predict(policy, random_batch(policy.config))
    policy(random_batch(policy.config), seeded(), Augmentation())
    DiffusionPolicy.make(policy.config, seed=5)
    assert torch.equal(torch.get_rng_state(), before)


def find_origin(batch) -> torch.Tensor:
    """Reference of targets: the start of the stage for arm joints, 0 for all others."""
    origin = torch.zeros_like(batch["action"])
    for arm in (slice(0, 6), slice(30, 36)):
        origin[..., arm] = batch["start_joint_state"][:, None, arm]
    return origin


def test_predictions_stay_in_the_range_of_the_actions(policy, random_batch):
    # Samples are clipped to [-1, 1], which the normaliser maps to what was commanded in the data.
    low, high = np.linspace(-2, -1, 60), np.linspace(0, 3, 60)
    policy.normalizer.of("action").fit(Range(low, high))
    batch = random_batch(policy.config)
    actions = (predict(policy, batch) - find_origin(batch)).double().numpy()
    if policy.config.diffusion.scheduler == "ddim":
        assert (actions >= low - 1e-5).all()
        assert (actions <= high + 1e-5).all()
    assert np.isfinite(actions).all()


def test_arms_that_never_moved_in_the_data_stay_where_the_stage_began(policy, random_batch):
    still = np.zeros(60)
    policy.normalizer.of("action").fit(Range(still, still))
    batch = random_batch(policy.config)
    assert torch.equal(predict(policy, batch), find_origin(batch))


def test_without_relative_joints_targets_are_learned_as_they_are(method, tiny_config, random_batch):
    policy = DiffusionPolicy.make(tiny_config(method, relative_joints=()), seed=0)
    policy.normalizer.of("action").fit(Range(np.full(60, 0.5), np.full(60, 0.5)))
    assert (predict(policy, random_batch(policy.config)) == 0.5).all()


def test_every_weight_learns(policy, random_batch, seeded):
    policy(random_batch(policy.config), seeded(), Augmentation()).backward()
    idle = [name for name, p in policy.named_parameters() if p.grad is None or not p.grad.any()]
    assert idle == []


def test_what_is_not_observed_does_not_matter(policy, random_batch):
    batch = random_batch(policy.config)
    observed = {"start_joint_state", *policy.config.frame_keys, *policy.config.stage_keys}
    assert torch.equal(
        predict(policy, batch), predict(policy, {key: batch[key] for key in observed})
    )
    for key in observed:
        changed = {**batch, key: batch[key].flip(-1)}
        assert not torch.equal(predict(policy, batch), predict(policy, changed)), key


def test_the_stage_is_encoded_once_for_all_observations(tiny_config, random_batch, monkeypatch):
    policy = DiffusionPolicy.make(tiny_config("sadp"), seed=0)
    seen = []
    monkeypatch.setattr(
        policy.encoder.garment, "forward", lambda p: seen.append(len(p)) or p.new_zeros(len(p), 8)
    )
    policy(random_batch(policy.config, count=5), torch.Generator().manual_seed(0))
    assert seen == [5]


def test_no_norm_remembers_batches(policy):
    # EMA copies parameters: statistics of batches would not reach its copy.
    assert not any(isinstance(m, nn.modules.batchnorm._NormBase) for m in policy.modules())
    assert not any(isinstance(m, nn.modules.dropout._DropoutNd) for m in policy.modules())
    learned = {name for name, _ in policy.named_parameters()}
    stored = set(policy.state_dict()) - learned
    assert all(name.startswith("normalizer.") for name in stored)


def test_without_decay_the_ema_copy_encodes_as_the_trained_model_does(policy, random_batch, seeded):
    from diffusers.training_utils import EMAModel

    ema = EMAModel(policy.parameters(), decay=0.0, use_ema_warmup=True, power=0.75)
    optimizer = torch.optim.AdamW(policy.parameters(), lr=1e-2)
    policy.train()
    for seed in range(3):
        optimizer.zero_grad()
        policy(random_batch(policy.config, seed=seed), seeded(seed)).backward()
        optimizer.step()
        ema.step(policy.parameters())
    copied = DiffusionPolicy.make(policy.config, seed=1).eval()
    ema.copy_to(copied.parameters())
    batch = random_batch(policy.config, seed=9)
    conditions = []
    for model in (policy, copied):
        draws = Draws(seeded(4))
        stage = model.encoder.encode_stage(batch, model.normalizer, draws)
        conditions.append(model.encoder.encode(batch, stage, model.normalizer, draws))
    # The average is formed as x - (x - y), which rounds; a norm that did not come along would be
    # off by far more.
    torch.testing.assert_close(*conditions, rtol=1e-3, atol=1e-3)


def test_the_loss_is_that_of_the_definition(tiny_config, random_batch):
    for prediction in ("sample", "epsilon"):
        config = tiny_config("dp3")
        config = dataclasses.replace(
            config, diffusion=dataclasses.replace(config.diffusion, prediction=prediction)
        )
        policy = DiffusionPolicy.make(config, seed=0)
        seen = {}
        handle = policy.unet.register_forward_pre_hook(
            lambda _, inputs, seen=seen: seen.update(inputs=inputs)
        )
        batch = random_batch(config, count=4)
        loss = policy(batch, torch.Generator().manual_seed(3))
        handle.remove()
        noisy, step, projected = seen["inputs"]
        # Squared cosine schedule, Nichol and Dhariwal, 2021, written out.
        levels = np.cos((np.arange(101) / 100 + 0.008) / 1.008 * np.pi / 2) ** 2
        betas = np.minimum(1 - levels[1:] / levels[:-1], 0.999)
        alpha = torch.from_numpy(np.cumprod(1 - betas)[step.numpy()]).float()[:, None, None]
        clean = batch["action"] - find_origin(batch)
        noise = (noisy - alpha.sqrt() * clean) / (1 - alpha).sqrt()
        assert 0.8 < noise.std() < 1.2
        target = clean if prediction == "sample" else noise
        wanted = (policy.unet(noisy, step, projected) - target).square().mean()
        torch.testing.assert_close(loss, wanted, rtol=1e-3, atol=1e-4)


def test_colour_is_seen_where_it_is_asked_for(tiny_config, random_batch):
    config = tiny_config("dp3")
    batch = random_batch(config)
    grey = {**batch, "env_point_cloud": batch["env_point_cloud"].clone()}
    grey["env_point_cloud"][..., 3:] = 0.0
    for use_color in (False, True):
        changed = dataclasses.replace(
            config, environment=dataclasses.replace(config.environment, use_color=use_color)
        )
        policy = DiffusionPolicy.make(changed, seed=0)
        assert torch.equal(predict(policy, batch), predict(policy, grey)) != use_color


def test_a_garment_is_encoded_once_for_the_windows_of_its_group(tiny_config, random_batch, seeded):
    config = tiny_config("sadp")
    policy = DiffusionPolicy.make(config, seed=0)
    batch = random_batch(config, count=6)
    grouped = {k: v[::3] if k in config.stage_keys else v for k, v in batch.items()}
    repeated = {
        k: v[::3].repeat_interleave(3, dim=0) if k in config.stage_keys else v
        for k, v in batch.items()
    }
    sizes = []
    policy.encoder.garment.register_forward_pre_hook(lambda _, args: sizes.append(len(args[0])))
    torch.testing.assert_close(policy(grouped, seeded()), policy(repeated, seeded()))
    assert sizes == [2, 6]


def test_a_policy_of_several_stages_learns_what_only_the_stage_says(
    tiny_config, random_batch, seeded
):
    config = tiny_config("dp3", stages=2)
    policy = DiffusionPolicy.make(config, seed=1)
    batch = random_batch(config, count=8)
    batch = {key: values[:1].expand_as(values) for key, values in batch.items()}
    batch["stage"] = torch.arange(8) % 2
    batch["start_joint_state"] = torch.zeros_like(batch["start_joint_state"])
    batch["action"] = (2.0 * batch["stage"] - 1.0).reshape(8, 1, 1).expand(8, config.horizon, 60)
    optimizer = torch.optim.AdamW(policy.parameters(), lr=5e-3)
    for step in range(150):
        optimizer.zero_grad()
        policy(batch, seeded(step)).backward()
        optimizer.step()
    policy.eval()
    actions = policy.predict(batch, policy.encode_stage(batch, seeded()), seeded())
    torch.testing.assert_close(actions, batch["action"], rtol=0.0, atol=0.5)
