import dataclasses

import numpy as np
import pytest
import torch

from dgl_gam import GarmentAffordanceModel
from dgl_gam.adapt import AdaptConfig, AnnotatedPair, adapt
from dgl_gam.checkpoint import Checkpoint
from dgl_gam.config import GamLevelConfig, NetworkConfig
from dgl_gam.network import GarmentNetwork

TINY = NetworkConfig(
    levels=(
        GamLevelConfig(centres=48, radius=0.3, neighbours=8, widths=(16, 32)),
        GamLevelConfig(centres=12, radius=0.6, neighbours=8, widths=(64,)),
    ),
    up=((48,), (32,)),
    attention_blocks=1,
    attention_heads=2,
    head_width=32,
    features=32,
    categories=("Shirt",),
)


@pytest.fixture
def model():
    torch.manual_seed(0)
    return GarmentAffordanceModel(Checkpoint(network=GarmentNetwork(TINY)))


@pytest.fixture
def pair(make_flat_shirt, rng):
    """A pair whose annotation contradicts what any network would say: left and right swapped."""
    make, see = make_flat_shirt
    shirt = make(rng)
    cloud = see(shirt["vertices"], shirt["faces"], rng, 150)[0].astype(np.float64)
    points = cloud[np.argsort(cloud[:, 0])[[0, 10, -10, -1]]]
    mirrored = points * [-1, 1, 1]
    nearest = np.linalg.norm(cloud[None] - mirrored[:, None], axis=2).argmin(axis=1)
    return AnnotatedPair(
        source_cloud=cloud, source_points=points, target_cloud=cloud, target_points=cloud[nearest]
    )


def test_a_few_annotated_pairs_are_learned_and_the_old_model_stays(model, pair):
    pair = dataclasses.replace(pair, target_points=pair.source_points)
    rng = np.random.default_rng(1)
    shown = dataclasses.replace(
        pair, target_cloud=pair.target_cloud + rng.normal(0, 0.01, pair.target_cloud.shape)
    )
    before = {name: t.clone() for name, t in model.checkpoint.network.state_dict().items()}
    losses = []
    adapted = adapt(
        model,
        [shown],
        AdaptConfig(steps=15, lr=5e-3, keep=0.1),
        on_progress=lambda step, loss: losses.append(loss),
    )
    assert np.mean(losses[-3:]) < 0.8 * losses[0]
    after = adapted.checkpoint.network.state_dict()
    for name, tensor in model.checkpoint.network.state_dict().items():
        assert torch.equal(tensor, before[name]), name
        if name.startswith("yaw."):
            assert torch.equal(tensor, after[name]), name
    assert any(not torch.equal(before[name], after[name]) for name in before)
    assert adapted.checkpoint.calibration.samples == 0


def test_staying_with_the_old_features_keeps_them(model, pair):
    results = []
    for keep in (0.0, 50.0):
        adapted = adapt(model, [pair], AdaptConfig(steps=6, lr=2e-3, keep=keep))
        old, new = (m.encode([pair.source_cloud])[0].features for m in (model, adapted))
        results.append((old * new).sum(dim=1).mean().item())
    assert results[1] > results[0]


def test_wrong_annotations_are_refused(model, pair):
    for changes, message in (
        ({"target_points": pair.target_points[:2]}, "as many points on both clouds"),
        (
            {"source_cloud": pair.source_cloud[:9]},
            r"pairs\[0\]\.source_cloud must have at least 16",
        ),
        ({"target_cloud": np.zeros((3000, 3))}, "at most 2048 points; got 3000"),
    ):
        with pytest.raises(ValueError, match=message):
            adapt(model, [dataclasses.replace(pair, **changes)])
    with pytest.raises(ValueError, match="pairs must not be empty"):
        adapt(model, [])
    with pytest.raises(ValueError, match="must be positive"):
        AdaptConfig(steps=0)
