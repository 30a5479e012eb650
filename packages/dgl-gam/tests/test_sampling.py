import numpy as np
import pytest
import torch

from dgl_gam import _sampling


@pytest.fixture
def clouds():
    return torch.rand(2, 60, 3, generator=torch.Generator().manual_seed(0))


def choose_by_hand(cloud: np.ndarray, count: int) -> list[int]:
    chosen = [int(np.linalg.norm(cloud - cloud.mean(axis=0), axis=1).argmax())]
    while len(chosen) < count:
        nearest = [min(np.linalg.norm(p - cloud[c]) for c in chosen) for p in cloud]
        chosen.append(int(np.argmax(nearest)))
    return chosen


def test_farthest_points_agree_with_a_search_by_hand(clouds):
    indices, squared = _sampling.sample_farthest(clouds, 20)
    for cloud, chosen, table in zip(clouds.numpy(), indices.tolist(), squared, strict=True):
        assert chosen == choose_by_hand(cloud, 20)
        by_hand = ((cloud[chosen][:, None] - cloud[None]) ** 2).sum(axis=2)
        np.testing.assert_allclose(table.numpy(), by_hand, atol=1e-6)


def test_the_way_of_accelerators_chooses_the_same(clouds):
    expected = _sampling.sample_farthest(clouds, 20)
    found = _sampling._sample_farthest_batch(clouds, 20)
    assert torch.equal(expected[0], found[0])
    torch.testing.assert_close(expected[1], found[1])


def test_the_first_points_of_a_choice_are_a_choice_of_fewer(clouds):
    assert torch.equal(
        _sampling.sample_farthest(clouds, 30)[0][:, :7], _sampling.sample_farthest(clouds, 7)[0]
    )


def test_all_points_can_be_chosen_and_no_more(clouds):
    indices = _sampling.sample_farthest(clouds, 60)[0]
    assert torch.equal(indices.sort(dim=1).values, torch.arange(60).expand(2, 60))
    with pytest.raises(ValueError, match=r"count must be in \[1, 60\]; got 61"):
        _sampling.sample_farthest(clouds, 61)


@pytest.mark.parametrize(("count", "radius"), [(5, 0.25), (40, 0.3), (100, 9.0)])
def test_balls_hold_the_nearest_points_within_the_radius(clouds, count, radius):
    chosen, squared = _sampling.sample_farthest(clouds, 10)
    found = _sampling.find_ball(squared, count, radius)
    assert found.shape == (2, 10, min(count, 60))
    for cloud, centres, rows in zip(clouds.numpy(), chosen.tolist(), found.tolist(), strict=True):
        for centre, row in zip(centres, rows, strict=True):
            distance = np.linalg.norm(cloud - cloud[centre], axis=1)
            order = [int(i) for i in np.argsort(distance) if distance[i] <= radius]
            assert set(row) == set(order[:count])
            assert row[len(order) :] == [centre] * max(0, len(row) - len(order))


def test_three_nearest_centres_and_their_weights(clouds):
    centres = clouds[:, :9]
    indices, weights = _sampling.find_three_nearest(clouds, centres)
    for b in range(2):
        distance = torch.cdist(clouds[b].double(), centres[b].double())
        assert torch.equal(indices[b], distance.topk(3, largest=False).indices)
    torch.testing.assert_close(weights.sum(dim=2), torch.ones(2, 60))
    # A centre's own weight is nearly one.
    assert (weights[:, :9, 0] > 0.99).all()
    assert torch.equal(indices[0, :9, 0], torch.arange(9))


def test_fewer_centres_than_three_do(clouds):
    indices, weights = _sampling.find_three_nearest(clouds, clouds[:, :2])
    assert indices.shape == weights.shape == (2, 60, 2)


def test_rows_are_taken_by_index(clouds):
    indices = torch.tensor([[[3, 4], [5, 6]], [[0, 1], [59, 2]]])
    taken = _sampling.gather_points(clouds, indices)
    assert taken.shape == (2, 2, 2, 3)
    torch.testing.assert_close(taken[1, 1, 0], clouds[1, 59])


def test_interpolated_values_agree_with_sums_by_hand(clouds):
    values = torch.rand(2, 9, 5, generator=torch.Generator().manual_seed(1), requires_grad=True)
    indices, weights = _sampling.find_three_nearest(clouds, clouds[:, :9])
    found = _sampling.interpolate(values, indices, weights)
    by_hand = torch.stack(
        [
            torch.stack([w @ v[i] for i, w in zip(rows, shares, strict=True)])
            for v, rows, shares in zip(values, indices, weights, strict=True)
        ]
    )
    torch.testing.assert_close(found, by_hand)
    (gradient,) = torch.autograd.grad(found.square().sum(), values)
    (expected,) = torch.autograd.grad(by_hand.square().sum(), values)
    torch.testing.assert_close(gradient, expected)


@pytest.mark.parametrize(("width", "count"), [(2048, 16), (1024, 16), (2000, 16), (600, 3), (7, 7)])
def test_the_smallest_of_many_values_are_those_of_a_sorted_list(width, count):
    values = torch.rand(2, 5, width, generator=torch.Generator().manual_seed(width))
    smallest, indices = _sampling._find_smallest(values, count)
    assert torch.equal(smallest, values.sort(dim=2).values[..., :count])
    assert torch.equal(values.gather(2, indices), smallest)
    assert all(len(set(row)) == count for row in indices.flatten(0, 1).tolist())
    # Equal values crowd into few columns of a comb: each is found once all the same.
    values[:, :, :: max(1, width // 8)] = 0.0
    smallest, indices = _sampling._find_smallest(values, count)
    assert torch.equal(smallest, values.sort(dim=2).values[..., :count])
    assert all(len(set(row)) == count for row in indices.flatten(0, 1).tolist())
