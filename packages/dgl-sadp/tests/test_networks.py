"""Facts about the parts of the networks."""

import numpy as np
import pytest
import torch
from torch.nn import functional

from dgl_sadp._clouds import Augmentation, thin_cloud
from dgl_sadp._pointnet import GarmentNet, PointsNet, find_neighbours, sample_farthest
from dgl_sadp._random import Draws
from dgl_sadp._resnet import ImageNet18
from dgl_sadp._unet import ConditionalUNet, _TimeConv
from dgl_sadp.config import PointsConfig, UNetConfig


def draw(*shape, seed=0):
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def test_farthest_points_are_those_of_the_definition():
    clouds = draw(3, 40, 3)
    found = sample_farthest(clouds, 12).numpy()
    for cloud, indices in zip(clouds.double().numpy(), found, strict=True):
        first = np.square(cloud - cloud.mean(axis=0)).sum(axis=1).argmax()
        chosen = [int(first)]
        for _ in range(11):
            distance = np.linalg.norm(cloud[:, None] - cloud[chosen], axis=2).min(axis=1)
            chosen.append(int(distance.argmax()))
        assert indices.tolist() == chosen


def test_no_point_is_chosen_twice_although_points_coincide():
    cloud = torch.zeros(1, 9, 3)
    assert sorted(sample_farthest(cloud, 9)[0].tolist()) == list(range(9))
    with pytest.raises(ValueError, match=r"count must lie in 1 \.\.\. 9; got 10"):
        sample_farthest(cloud, 10)


def test_neighbours_are_the_nearest_within_the_radius():
    points, centres = draw(2, 50, 3), draw(2, 7, 3, seed=1)
    found = find_neighbours(centres, points, 5, radius=0.3)
    distances = torch.cdist(centres.double(), points.double())
    for b in range(2):
        for s in range(7):
            order = distances[b, s].argsort()
            wanted = [int(i) if distances[b, s, i] <= 0.3 else int(order[0]) for i in order[:5]]
            assert found[b, s].tolist() == wanted


@pytest.mark.parametrize("kind", ["points", "garment"])
def test_the_order_of_a_cloud_does_not_matter(kind, tiny_config):
    torch.manual_seed(0)
    if kind == "points":
        net, cloud = PointsNet(PointsConfig(points=30, widths=(8, 16), features=4)), draw(2, 30, 3)
    else:
        net, cloud = GarmentNet(tiny_config("sadp-g").garment), draw(2, 30, 5)
    turned = cloud[:, torch.randperm(30)]
    torch.testing.assert_close(net(cloud), net(turned), rtol=1e-4, atol=1e-5)
    assert not torch.allclose(net(cloud), net(cloud * 0.5), atol=1e-2)


def test_a_garment_that_is_moved_looks_different(tiny_config):
    # The position is an input: targets of joints depend on it.
    torch.manual_seed(0)
    net, cloud = GarmentNet(tiny_config("sadp-g").garment), draw(1, 30, 5)
    moved = cloud + torch.tensor([0.3, 0.0, 0.0, 0.0, 0.0])
    assert (net(cloud) - net(moved)).abs().max() > 1e-2


def test_each_affordance_channel_is_seen(tiny_config):
    torch.manual_seed(0)
    net, cloud = GarmentNet(tiny_config("sadp-g").garment), draw(1, 30, 5)
    for channel in (3, 4):
        changed = cloud.clone()
        changed[0, :15, channel] += 1.0
        assert (net(cloud) - net(changed)).abs().max() > 1e-2


def test_the_convolution_by_a_product_is_the_convolution():
    torch.manual_seed(0)
    for kernel in (1, 3, 5):
        layer, x = _TimeConv(6, 4, kernel), draw(3, 6, 8)
        matrix = layer.weight.view(4, 6, kernel)
        wanted = functional.conv1d(x, matrix, layer.bias, padding=kernel // 2)
        torch.testing.assert_close(layer(x), wanted, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("levels", [1, 2, 3])
def test_the_unet_sees_the_step_the_condition_and_every_frame(levels):
    torch.manual_seed(0)
    unet = ConditionalUNet(
        UNetConfig(widths=(16, 32, 32)[:levels], step_embedding=8), actions=5, condition=6
    )
    noisy, step, condition = draw(2, 8, 5), torch.tensor([3, 90]), draw(2, 6)
    out = unet(noisy, step, unet.project(condition))
    assert out.shape == (2, 8, 5)
    assert not torch.allclose(out, unet(noisy, step + 5, unet.project(condition)), atol=1e-4)
    assert not torch.allclose(out, unet(noisy, step, unet.project(condition + 1)), atol=1e-4)
    noisy.requires_grad_()
    unet(noisy, step, unet.project(condition)).sum().backward()
    assert noisy.grad is not None
    assert (noisy.grad.abs().amax(dim=2) > 0).all()
    # Every weight takes part, but for the two convolutions before the deepest level has been left.
    idle = {name for name, p in unet.named_parameters() if p.grad is None}
    assert idle == set()


def test_pictures_are_scaled_by_areas(tiny_config):
    torch.manual_seed(0)
    net = ImageNet18(tiny_config("dp").image)
    small = torch.randint(0, 256, (1, 32, 32, 3), dtype=torch.uint8)
    large = small.repeat_interleave(3, dim=1).repeat_interleave(2, dim=2)
    torch.testing.assert_close(net(small), net(large), rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize(("size", "count"), [(10, 4), (10, 10), (4, 10), (1, 3)])
def test_thinning_takes_points_of_the_cloud_evenly(size, count, seeded):
    cloud = torch.arange(size).reshape(1, size, 1).expand(2, size, 4).float()
    thinned = thin_cloud(cloud, count, Draws(seeded()))
    assert thinned.shape == (2, count, 4)
    times = torch.bincount(thinned[0, :, 0].long(), minlength=size)
    assert set(times.tolist()) <= {count // size, -(-count // size)}
    assert (thinned == thinned[..., :1]).all()


def test_thinning_is_decided_by_its_generator(seeded):
    cloud = draw(2, 3, 50, 6)
    first, again, other = (thin_cloud(cloud, 20, Draws(seeded(seed))) for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)


def test_augmentation_moves_points_a_little_and_leaves_other_channels(seeded):
    cloud = draw(64, 40, 5)
    plain = thin_cloud(cloud, 40, Draws(seeded()))
    varied = thin_cloud(cloud, 40, Draws(seeded()), Augmentation(jitter=0.01, dropout=0.0))
    torch.testing.assert_close((varied - plain)[..., :3].std().item(), 0.01, rtol=0.1, atol=0.0)
    assert torch.equal(varied[..., 3:], plain[..., 3:])


def test_dropout_leaves_out_up_to_its_share_of_the_points(seeded):
    cloud = draw(200, 100, 3)
    thinned = thin_cloud(cloud, 100, Draws(seeded()), Augmentation(jitter=0.0, dropout=0.5))
    distinct = torch.tensor([len(each.unique(dim=0)) for each in thinned])
    assert 50 <= distinct.min() < 60
    assert 90 < distinct.max() <= 100


@pytest.mark.parametrize("change", [{"jitter": -1.0}, {"dropout": 1.0}, {"jitter": float("nan")}])
def test_augmentation_out_of_range_is_refused(change):
    with pytest.raises(ValueError, match=next(iter(change))):
        Augmentation(**change)
