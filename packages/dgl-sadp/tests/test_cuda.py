"""CUDA computes the same as the CPU, but for rounding."""

import pytest
import torch

from dgl_sadp import DiffusionPolicy, TrainConfig, get_policy_config, load_policy, train_policy
from dgl_sadp._pointnet import sample_farthest
from dgl_sadp.synthetic import write_synthetic_episodes

pytestmark = [
    pytest.mark.gpu,
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
]


@pytest.fixture(autouse=True)
def exact_convolutions():
    """CUDA's convolutions round to TF32 by default; matrix products do not."""
    before = torch.backends.cudnn.allow_tf32
    torch.backends.cudnn.allow_tf32 = False
    yield
    torch.backends.cudnn.allow_tf32 = before


def move(batch, device):
    return {key: values.to(device) for key, values in batch.items()}


@pytest.fixture
def pair(method):
    """The same policy on both devices."""
    return [
        DiffusionPolicy.make(get_policy_config(method), seed=0).to(device).eval()
        for device in ("cpu", "cuda")
    ]


def test_actions_are_those_of_the_cpu(pair, random_batch, seeded):
    found = []
    for policy in pair:
        batch, generator = move(random_batch(policy.config), policy.device), seeded()
        actions = policy.predict(batch, policy.encode_stage(batch, generator), generator)
        assert actions.device.type == policy.device.type
        found.append(actions.cpu())
    torch.testing.assert_close(*found, atol=1e-4, rtol=0.0)


@pytest.mark.parametrize(("size", "count"), [(64, 9), (100, 100), (2048, 512), (5000, 700)])
def test_farthest_points_are_those_of_the_cpu(size, count):
    clouds = torch.rand(7, size, 3, generator=torch.Generator().manual_seed(0))
    found = sample_farthest(clouds.cuda(), count)
    # Which of two points that are equally far comes first may differ, and all after it.
    is_equal = (found.cpu() == sample_farthest(clouds, count)).all(dim=1)
    assert is_equal.sum() >= 6
    assert all(len(set(cloud)) == count for cloud in found.tolist())


def test_loss_and_gradients_are_those_of_the_cpu(pair, random_batch, seeded):
    losses, gradients = [], []
    for policy in pair:
        loss = policy(move(random_batch(policy.config), policy.device), seeded())
        loss.backward()
        losses.append(loss.item())
        found = [parameter.grad for parameter in policy.parameters()]
        gradients.append(torch.cat([each.flatten().cpu() for each in found if each is not None]))
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)
    on_cpu, on_cuda = gradients
    assert (on_cuda - on_cpu).norm() < 1e-3 * on_cpu.norm()


@pytest.mark.parametrize("precision", ["no", "bf16"])
def test_training_learns_resumes_and_leaves_a_policy_for_the_cpu(
    precision, tmp_path, tiny_config, random_batch, seeded
):
    episodes = tmp_path / "episodes"
    write_synthetic_episodes(episodes, 5, frames=8, points=32)
    policy = tiny_config("sadp")

    def train(out, epochs=3, **options):
        config = TrainConfig(
            epochs=epochs,
            batch=8,
            learning_rate=1e-3,
            muon_learning_rate=0.02,
            validation_share=0.3,
            precision=precision,
        )
        return train_policy(episodes, tmp_path / out, policy, config, device="cuda", **options)

    short, whole = train("short", epochs=1), train("whole", epochs=20)
    assert whole.validation.loss < 0.7 * short.validation.loss
    train("parts", epochs=20, stop_after=4)
    resumed = train("parts", epochs=20, is_resumed=True)
    # Sums of gradients have no fixed order on CUDA, so the two are near each other and no more.
    assert resumed.validation.loss == pytest.approx(whole.validation.loss, rel=0.1)
    loaded = load_policy(resumed.policy)
    assert loaded.device.type == "cpu"
    batch, generator = random_batch(policy), seeded()
    actions = loaded.predict(batch, loaded.encode_stage(batch, generator), generator)
    assert torch.isfinite(actions).all()
