import numpy as np
import pytest
import torch

from dgl_gam import DataError
from dgl_gam.config import PRESETS, GamLevelConfig, NetworkConfig
from dgl_gam.data import GarmentFolder, read_garment
from dgl_gam.data.batches import BatchConfig, BatchMaker
from dgl_gam.skeleton import (
    SkeletonConfig,
    SkeletonMerger,
    Template,
    compute_composite_chamfer,
    find_key_points,
    fit_skeleton,
    measure_registration,
    register,
    write_registered,
)
from dgl_gam.skeleton.dataset import get_flat_cloud

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
)
CONFIG = SkeletonConfig(
    network="tiny", key_points=8, samples=6, steps=80, clouds=6, points=128, lr=3e-3
)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(PRESETS, "tiny", TINY)


@pytest.fixture(scope="module")
def fitted(shirts):
    """A network fitted to the shirts for training, and its losses."""
    PRESETS_WITH = {**PRESETS, "tiny": TINY}
    patch = pytest.MonkeyPatch()
    patch.setattr("dgl_gam.config.PRESETS", PRESETS_WITH)
    folder = GarmentFolder(shirts, split="train")
    losses = []
    clouds = [get_flat_cloud(folder.load(i)) for i in range(len(folder))]
    network = fit_skeleton(clouds, CONFIG, on_progress=lambda step, loss: losses.append(loss))
    patch.undo()
    return network, losses


def chamfer_by_loops(points, lines, strength):
    fidelity = length = coverage = 0.0
    for line, s in zip(lines, strength, strict=True):
        size = np.linalg.norm(line[-1] - line[0])
        to_cloud = [min(np.linalg.norm(p - q) for q in points) for p in line]
        fidelity += s * size * np.mean(to_cloud)
        length += size
    for q in points:
        reach = sorted(
            (min(np.linalg.norm(p - q) for p in line), s)
            for line, s in zip(lines, strength, strict=True)
        )
        left = 1.0
        for distance, s in reach:
            coverage += min(s, left) * distance / len(points)
            left -= min(s, left)
        coverage += left * reach[-1][0] / len(points)
    return fidelity / length + coverage


@pytest.mark.parametrize("level", [0.05, 0.4, 1.0])
def test_composite_chamfer_agrees_with_loops(rng, level):
    points, lines = rng.normal(size=(2, 15, 3)), rng.normal(size=(2, 6, 4, 3))
    strength = rng.uniform(0, level, (2, 6))
    found = compute_composite_chamfer(*map(torch.from_numpy, (points, lines, strength)))
    expected = np.mean(
        [chamfer_by_loops(p, l, s) for p, l, s in zip(points, lines, strength, strict=True)]
    )
    assert found.item() == pytest.approx(expected, rel=1e-6)


def test_lines_in_the_cloud_cost_less_than_lines_beside_it():
    cloud = torch.linspace(-1, 1, 60)[:, None] * torch.tensor([1.0, 0.0, 0.0])
    along = torch.linspace(-1, 1, 10)[:, None] * torch.tensor([[1.0, 0.0, 0.0]])
    beside = along + torch.tensor([0.0, 0.5, 0.0])
    lines, on = torch.stack([along, beside])[None], torch.tensor([[1.0, 0.0]])
    right = compute_composite_chamfer(cloud[None], lines, on)
    wrong = compute_composite_chamfer(cloud[None], lines, 1 - on)
    assert right < 0.1 < 0.4 < wrong


def test_key_points_are_means_of_the_cloud_and_keep_their_order(rng):
    torch.manual_seed(0)
    network = SkeletonMerger(TINY, key_points=5, samples=4)
    points = torch.from_numpy(rng.uniform(-1, 1, (2, 80, 3)).astype(np.float32))
    keys, lines, strength = network(points)
    assert keys.shape == (2, 5, 3)
    assert lines.shape == (2, 10, 4, 3)
    assert ((strength > 0) & (strength < 1)).all()
    assert (keys.amin(dim=1) >= points.amin(dim=1)).all()
    assert (keys.amax(dim=1) <= points.amax(dim=1)).all()
    torch.testing.assert_close(lines[:, 0, 0], keys[:, 0])  # no offset before training
    torch.testing.assert_close(lines[:, 0, -1], keys[:, 1])
    order = torch.from_numpy(rng.permutation(80))
    torch.testing.assert_close(network(points[:, order])[0], keys, atol=1e-4, rtol=1e-3)
    with pytest.raises(ValueError, match="at least 2; got 1 and 4"):
        SkeletonMerger(TINY, key_points=1, samples=4)


def test_learned_key_points_lie_at_the_same_places_of_unseen_garments(fitted, shirts):
    network, losses = fitted
    assert np.mean(losses[-10:]) < 0.7 * np.mean(losses[:5])
    unseen = GarmentFolder(shirts, split="test")
    places = []
    for index in range(len(unseen)):
        garment = unseen.load(index)
        keys = find_key_points(network, get_flat_cloud(garment))
        front = garment.states[0][: len(garment.canonical) // 2]
        nearest = np.linalg.norm(front[None] - keys[:, None], axis=2).argmin(axis=1)
        places.append(garment.canonical[nearest, :2])
    places = np.stack(places)  # (garments, K, 2); u from -2 to 2, v from 0 to 1
    between = np.abs(places - places.mean(axis=0)).mean(axis=(0, 1))
    assert between[0] < 0.35
    assert between[1] < 0.2
    # They are spread over the garment.
    assert np.ptp(places.mean(axis=0)[:, 0]) > 1.0


def test_registered_shirts_correspond(fitted, shirts, tmp_path):
    network, _ = fitted
    truth = GarmentFolder(shirts, split="test")
    paths = write_registered(network, truth, tmp_path)
    registered = GarmentFolder(tmp_path)
    assert len(paths) == len(registered) == 3
    result = measure_registration(truth, registered, pairs=10, seed=0)
    assert result.pck10 > 0.8
    assert result.pck05 <= result.pck10
    data = read_garment(paths[0])
    half = len(data.canonical) // 2
    assert (data.canonical[:half, 2] == 1).all()
    assert (data.canonical[half:, 2] == -1).all()
    assert data.header.generator_versions["canonical"] == "skeleton"
    batch = BatchMaker(registered, BatchConfig(groups=1, group_size=2), seed=0).make(0)
    assert batch.is_used.float().mean() > 0.5  # they can be trained on
    with pytest.raises(DataError, match="the same garments"):
        measure_registration(GarmentFolder(shirts), registered, pairs=1, seed=0)


def test_registration_recovers_an_affine_map(rng):
    cloud = rng.uniform(-1, 1, (400, 2)) * [1.0, 0.6]
    keys = cloud[:8]
    warp = np.array([[1.2, 0.1], [-0.2, 0.8]])
    template = Template(cloud=cloud @ warp + 3, keys=keys @ warp + 3)
    found = register(template, keys, cloud[50:90])
    np.testing.assert_allclose(found, cloud[50:90] @ warp + 3, atol=1e-6)
    with pytest.raises(ValueError, match=r"keys must have shape \(8, 2\); got \(7, 2\)"):
        register(template, keys[:7], cloud)


def test_a_plate_without_stiffness_meets_the_key_points(rng):
    keys, moved = rng.uniform(-1, 1, (2, 7, 2))
    template = Template(cloud=moved, keys=moved)
    np.testing.assert_allclose(register(template, keys, keys, stiffness=0.0), moved, atol=1e-6)
    assert np.abs(register(template, keys, keys, stiffness=1.0) - moved).max() > 0.05


def test_wrong_settings_are_refused():
    with pytest.raises(ValueError, match="steps must be at least 1"):
        SkeletonConfig(steps=0)
    with pytest.raises(ValueError, match="clouds must not be empty"):
        fit_skeleton([], SkeletonConfig())
