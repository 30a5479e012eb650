import dataclasses

import numpy as np
import pytest
import torch

from dgl_gam import DataError
from dgl_gam._yaw import rotate_yaw
from dgl_gam.augment import drop_points, warp_clouds
from dgl_gam.data import GarmentFolder, read_garment, write_garment
from dgl_gam.data.batches import BatchConfig, BatchMaker, choose_negatives, fit_yaw
from dgl_gam.data.correspondence import compute_places, find_vertices, mirror_places
from dgl_gam.network import center_clouds

SMALL = BatchConfig(groups=2, group_size=3, positives=6, negatives=30)


@pytest.fixture(scope="module")
def folder(shirts):
    return GarmentFolder(shirts, split="train")


def test_places_of_one_garment_are_found_on_another(folder):
    source, target = folder.load(0), folder.load(1)
    vertices = np.arange(0, len(source.canonical), 7)
    found = find_vertices(source, vertices, target)
    np.testing.assert_allclose(target.canonical[found], source.canonical[vertices], atol=1e-5)


def test_within_a_garment_the_vertex_is_the_correspondence(folder, tmp_path, shirt_fields):
    fields = shirt_fields(1)
    fields["canonical"] = np.full_like(fields["canonical"], np.nan)
    write_garment(tmp_path / "a.safetensors", **fields)
    garment = read_garment(tmp_path / "a.safetensors")
    np.testing.assert_array_equal(find_vertices(garment, np.array([4, 2]), garment), [4, 2])
    with pytest.raises(ValueError, match="no canonical coordinates"):
        find_vertices(folder.load(0), np.array([4]), garment)


def test_a_place_that_the_other_lacks_is_told(folder):
    source, target = folder.load(0), folder.load(1)
    body = np.abs(target.canonical[:, 0]) <= 1  # a target without sleeves
    bare = dataclasses.replace(target, canonical=target.canonical * body[:, None])
    cuff = source.landmarks[:1]
    assert find_vertices(source, cuff, bare)[0] == -1


def test_places_keep_left_from_right_and_front_from_back(folder):
    garment = folder.load(0)
    places = compute_places(garment)
    names = garment.header.landmark_names
    left, right = (places[garment.landmarks[names.index(n)]] for n in ("left_cuff", "right_cuff"))
    assert np.linalg.norm(left - right) > 0.5
    np.testing.assert_allclose(mirror_places(left[None])[0], right, atol=0.02)
    half = len(places) // 2  # the back layer is the second half
    assert np.linalg.norm(places[:half] - places[half:], axis=1).min() > 0.15


def test_negatives_are_other_places_and_hold_the_mirrored_one(rng):
    distance = rng.uniform(0, 1, (5, 400))
    mirrored = distance.argmax(axis=1)
    mirrored[4] = distance[4].argmin()  # on the axis of symmetry: its own mirror
    config = BatchConfig(negatives=100, near_share=0.5)
    chosen, is_valid = choose_negatives(distance, mirrored, config, rng)
    taken = np.take_along_axis(distance, chosen, axis=1)
    assert is_valid.all()
    assert taken.min() > config.margin
    assert (chosen[:4] == mirrored[:4, None]).any(axis=1).all()
    assert mirrored[4] not in chosen[4]
    # Half are near, although only a fifth of the points are.
    assert (taken < config.near).mean() > 0.35


def test_too_few_points_leave_negatives_that_do_not_count(rng):
    distance = np.full((2, 50), 0.5)
    distance[:, :45] = 0.01
    chosen, is_valid = choose_negatives(distance, np.array([0, 0]), BatchConfig(), rng)
    assert chosen.shape == is_valid.shape == (2, 150)
    for row in range(2):
        assert set(chosen[row][is_valid[row]]) == {45, 46, 47, 48, 49}


def test_batches_depend_on_seed_and_step_alone(folder):
    first = BatchMaker(folder, SMALL, seed=3).make(5)
    again = BatchMaker(folder, SMALL, seed=3)
    again.make(1)
    for name, value in vars(again.make(5)).items():
        assert torch.equal(value, getattr(first, name)), name
    assert not torch.equal(again.make(6).points[:, :500], first.points[:, :500])


def make_plain_batch(shirts, config):
    """Make a batch of unchanged views, and the canonical coordinates of each cloud."""
    config = dataclasses.replace(config, missing=0.0, bend=0.0, stretch=0.0, noise=0.0, yaw=0.0)
    folder = GarmentFolder(shirts)
    batch = BatchMaker(folder, config, seed=0).make(0)
    views = [(g, w) for g in map(folder.load, range(len(folder))) for w in range(6)]
    normal = torch.cat(
        [center_clouds(torch.from_numpy(g.view_points[w][None]))[0] for g, w in views]
    )
    radii = normal.norm(dim=2)  # a turn does not change them
    owners = [int((radii - c.norm(dim=1)).abs().sum(dim=1).argmin()) for c in batch.points]
    return batch, [views[o][0].canonical[views[o][0].view_vertices[views[o][1]]] for o in owners]


def test_positives_of_a_batch_are_the_same_place(shirts):
    batch, canonical = make_plain_batch(shirts, SMALL)
    wrong = []
    for pair, (a, b) in enumerate(batch.clouds.tolist()):
        used = batch.is_used[pair]
        from_a = canonical[a][batch.source[pair][used]]
        to_b = canonical[b][batch.positive[pair][used]]
        wrong += np.abs(from_a - to_b).max(axis=1).tolist()
        far = canonical[b][batch.negative[pair][used]]  # (n, negatives, 3)
        assert batch.is_negative[pair].float().mean() > 0.9
        assert np.linalg.norm(far - from_a[:, None], axis=2).min() > 0.03
    assert batch.is_used.float().mean() > 0.8
    assert max(wrong) < 0.2


def test_a_batch_tells_left_from_right(shirts):
    """If there is room for one negative only, it is the place with left and right swapped."""
    batch, canonical = make_plain_batch(shirts, dataclasses.replace(SMALL, negatives=1))
    apart = []
    for pair, (a, b) in enumerate(batch.clouds.tolist()):
        used = batch.is_used[pair] & batch.is_negative[pair, :, 0]
        from_a = canonical[a][batch.source[pair][used]]
        swapped = canonical[b][batch.negative[pair, :, 0][used]]
        off_axis = np.abs(from_a[:, 0]) > 0.3
        apart += np.linalg.norm(swapped - from_a * [-1, 1, 1], axis=1)[off_axis].tolist()
    assert len(apart) > 10
    assert np.median(apart) < 0.1


def test_the_yaw_of_a_batch_turns_its_clouds_back(folder):
    batch = BatchMaker(folder, dataclasses.replace(SMALL, flat_share=1.0), seed=0).make(0)
    back = rotate_yaw(batch.turned, -batch.yaw)
    own = rotate_yaw(batch.points, fit_yaw(back, batch.points)[0].neg())
    torch.testing.assert_close(back, own, atol=1e-3, rtol=0)
    assert batch.yaw_weight.min() > 0.9


def test_deformed_views_are_as_many_however_many_garments_are_flat_only(tmp_path, shirt_fields):
    for seed in (0, 1, 2, 4, 5, 6):
        fields = shirt_fields(seed)
        if seed > 1:  # flat only
            flat = fields["view_state"] == 0
            fields["states"], fields["state_names"] = fields["states"][:1], ["flat"]
            for name in ("view_points", "view_vertices", "view_state", "view_directions"):
                fields[name] = fields[name][flat]
        write_garment(tmp_path / f"{seed}.safetensors", **fields)
    config = dataclasses.replace(SMALL, flat_share=0.5, traced_share=0.0)
    maker = BatchMaker(GarmentFolder(tmp_path), config, seed=0)
    rng = np.random.default_rng(0)
    drawn = [row for _ in range(100) for row in maker._draw_group("Shirt", rng)]
    is_flat = [np.ptp(member.points[:, 2]) < 0.01 for member in drawn]
    # Half of them, and of the others two states of three: 1/3, not the 1/18 of drawing among all
    # garments.
    assert np.mean(is_flat) == pytest.approx(2 / 3, abs=0.1)
    assert len({member.garment.header.garment_id for member in drawn}) == 6


def test_what_hangs_keeps_the_frame_of_its_file(tmp_path, shirt_fields):
    """Upside down, a fit to the flat garment would turn it round."""
    for seed in (0, 1):
        fields = shirt_fields(seed)
        fields["state_names"] = ["flat", "hung_two", "dropped_1"]
        hung = fields["view_state"] == 1
        upside_down = np.array([[-1, 0, 0], [0, 0, 1], [0, -1, 0]])  # x, y, z of what lies
        points = fields["view_points"]
        points[hung] = (points[fields["view_state"] == 0] @ upside_down.T).astype(np.float32)
        fields["view_vertices"][hung] = fields["view_vertices"][fields["view_state"] == 0]
        for name in ("view_points", "view_vertices", "view_state", "view_directions"):
            fields[name] = fields[name][hung]  # nothing else to draw
        write_garment(tmp_path / f"{seed}.safetensors", **fields)
    maker = BatchMaker(GarmentFolder(tmp_path), dataclasses.replace(SMALL, missing=0.0), seed=0)
    batch = maker.make(0)
    back = rotate_yaw(batch.turned, -batch.yaw)
    # Thin along y, as in the file; bent and turned by up to 15 degrees as all are.
    assert (back[..., 1].abs().mean(dim=1) < 0.5 * back[..., 0].abs().mean(dim=1)).all()
    torch.testing.assert_close(batch.yaw_weight, torch.full((6,), 0.5))


def test_fitted_yaw_is_the_one_that_was_applied():
    points = torch.rand(4, 50, 3, generator=torch.Generator().manual_seed(0))
    yaw = torch.tensor([0.0, 1.0, -2.0, 3.0])
    found, strength = fit_yaw(points, rotate_yaw(points, yaw) * 2 + 5)
    torch.testing.assert_close(found, yaw, atol=1e-4, rtol=0)
    torch.testing.assert_close(strength, torch.ones(4))
    assert fit_yaw(points, torch.rand(4, 50, 3))[1].max() < 0.6


def test_warps_are_small_and_smooth():
    grid = torch.linspace(-1, 1, 40)
    points = torch.stack([*torch.meshgrid(grid, grid, indexing="ij"), torch.zeros(40, 40)], dim=2)
    points = points.reshape(1, -1, 3)
    warped = warp_clouds(points, torch.Generator().manual_seed(0), yaw=0.0, bend=0.05, stretch=0.1)
    moved = (warped - points).norm(dim=2)
    assert 0.01 < moved.max() < 0.35
    steps = (warped - points).reshape(40, 40, 3).diff(dim=0).norm(dim=2)
    assert steps.max() < 0.05


def test_missing_points_are_missing_in_one_piece():
    points = torch.rand(6, 300, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    kept = drop_points(points, torch.Generator().manual_seed(0), share=0.4)
    assert kept.shape == (6, 180)
    assert all(len(set(row)) == 180 for row in kept.tolist())
    with pytest.raises(ValueError, match=r"share must be in \[0, 1\)"):
        drop_points(points, torch.Generator(), share=1.0)


def test_one_garment_alone_is_too_few(tmp_path, shirt_fields):
    write_garment(tmp_path / "a.safetensors", **shirt_fields(1))
    with pytest.raises(DataError, match="at least 2 garments of Shirt"):
        BatchMaker(GarmentFolder(tmp_path), SMALL, seed=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"groups": 0}, "groups must be at least 1"),
        ({"group_size": 1}, "group_size must be at least 2"),
        ({"near_share": 1.5}, r"near_share must be in \[0, 1\]"),
        ({"missing": 0.95}, "missing must be in"),
        ({"margin": 0.001}, "must be positive and grow"),
    ],
)
def test_wrong_settings_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        BatchConfig(**change)


def test_kinds_of_states_are_drawn_by_their_weights(shirts):
    folder = GarmentFolder(shirts, split="train")

    def count(weights):
        config = BatchConfig(groups=1, group_size=2, flat_share=0.0, state_weights=weights)
        maker = BatchMaker(folder, config, seed=0)
        rng, garment = np.random.default_rng(0), folder.load(0)
        views = [maker._draw_view(garment, rng) for _ in range(300)]
        return np.mean([garment.view_state[view] == 0 for view in views])

    assert 0.2 < count(()) < 0.5  # a third of the views are flat
    assert count((("flat", 20.0),)) > 0.8
    assert count((("flat", 0.02),)) < 0.1
    with pytest.raises(ValueError, match="state_weights must be positive"):
        BatchConfig(state_weights=(("flat", 0.0),))


def test_a_batch_for_the_yaw_alone_has_the_same_clouds_and_no_pairs(shirts):
    folder = GarmentFolder(shirts, split="train")
    maker = BatchMaker(folder, BatchConfig(groups=2, group_size=2), seed=3)
    whole, alone = maker.make(4), maker.make(4, has_pairs=False)
    assert torch.equal(whole.turned, alone.turned)
    assert torch.equal(whole.yaw, alone.yaw)
    assert [len(x) for x in (alone.clouds, alone.source, alone.negative, alone.is_used)] == [0] * 4
    assert alone.negative.shape[1:] == whole.negative.shape[1:]


def test_mirrored_clouds_are_turned_the_other_way(shirts):
    folder = GarmentFolder(shirts, split="train")
    fields = {"groups": 1, "group_size": 4, "flat_share": 1.0, "missing": 0.0, "noise": 0.0}

    def turn_back(share):
        config = BatchConfig(**fields, mirrored_share=share)
        batch = BatchMaker(folder, config, seed=1).make(0, has_pairs=False)
        return rotate_yaw(batch.turned, -batch.yaw)

    plain, mirrored = turn_back(0.0), turn_back(1.0)
    flip = torch.tensor([-1.0, 1.0, 1.0])
    torch.testing.assert_close(mirrored, plain * flip, atol=1e-4, rtol=0)
    assert (plain - mirrored).abs().max() > 0.1
