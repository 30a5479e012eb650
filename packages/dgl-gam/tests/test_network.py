import dataclasses
import json
import math

import pytest
import torch

from dgl_gam._yaw import YawNetwork, rotate_yaw
from dgl_gam.config import PRESETS, GamLevelConfig, NetworkConfig, YawConfig, get_network_config
from dgl_gam.network import GarmentNetwork, center_clouds


@pytest.fixture
def clouds():
    generator = torch.Generator().manual_seed(0)
    points = torch.rand(2, 300, 3, generator=generator) * torch.tensor([1.0, 0.6, 0.1])
    return center_clouds(points)[0]


@pytest.fixture(params=sorted(PRESETS))
def network(request):
    torch.manual_seed(0)
    return GarmentNetwork(PRESETS[request.param])


def test_sizes_of_the_presets():
    def count(name):
        network = GarmentNetwork(PRESETS[name])
        return sum(p.numel() for p in network.parameters()) - sum(
            p.numel() for p in network.yaw.parameters()
        )

    assert count("small") == pytest.approx(0.6e6, rel=0.1)
    assert count("paper") == pytest.approx(1.47e6, rel=0.01)
    assert PRESETS["paper"].features == 512


def test_permuted_clouds_have_permuted_features(network, clouds):
    order = torch.randperm(300, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        torch.testing.assert_close(
            network(clouds[:, order]), network(clouds)[:, order], atol=1e-4, rtol=1e-3
        )


def test_training_and_evaluation_give_the_same_features(network, clouds):
    with torch.no_grad():
        assert torch.equal(network.train()(clouds), network.eval()(clouds))
        assert torch.equal(network.train().yaw(clouds), network.eval().yaw(clouds))


def test_features_do_not_depend_on_the_rest_of_the_batch(network, clouds):
    with torch.no_grad():
        torch.testing.assert_close(network(clouds)[1:], network(clouds[1:]), atol=1e-4, rtol=1e-3)


def test_features_are_unit_vectors_that_differ(network, clouds):
    with torch.no_grad():
        features = network(clouds)
    torch.testing.assert_close(features.norm(dim=2), torch.ones(2, 300))
    assert features.std(dim=1).mean() > 1e-3


def test_queried_points_have_the_features_they_have_anyway(network, clouds):
    queries = torch.tensor([[7, 1, 299], [0, 5, 5]])
    with torch.no_grad():
        every = network(clouds)
        some = network(clouds, queries=queries)
    for row in range(2):
        torch.testing.assert_close(some[row], every[row, queries[row]], atol=1e-4, rtol=1e-3)


@pytest.mark.parametrize("size", [16, 31, 500])
def test_clouds_of_any_size(network, size):
    points = torch.rand(1, size, 3, generator=torch.Generator().manual_seed(2))
    with torch.no_grad():
        assert torch.isfinite(network(points)).all()


def test_each_of_several_categories_has_features_of_its_own(clouds):
    config = dataclasses.replace(PRESETS["small"], categories=("Tops", "Trousers"))
    network = GarmentNetwork(config)
    with torch.no_grad():
        first, second = (network(clouds, torch.full((2,), c)) for c in range(2))
    assert not torch.allclose(first, second, atol=1e-3)
    with pytest.raises(ValueError, match="category must be given"):
        network(clouds)


def test_turning_a_cloud_by_one_bin_shifts_the_scores_by_one(clouds):
    config = YawConfig()
    torch.manual_seed(0)
    network = YawNetwork(config)
    turned = rotate_yaw(clouds, torch.full((2,), 2 * math.pi / config.bins))
    with torch.no_grad():
        torch.testing.assert_close(
            network(turned), network(clouds).roll(1, dims=1), atol=1e-3, rtol=1e-3
        )


def test_peaks_are_where_the_scores_are_largest():
    network = YawNetwork(YawConfig(bins=60))
    logits = torch.zeros(1, 60)
    logits[0, 15], logits[0, 45] = 9.0, 8.0
    angles, masses = network.find_peaks(logits, 2)
    torch.testing.assert_close(
        angles[0], torch.tensor([math.pi / 2, 3 * math.pi / 2]), atol=1e-4, rtol=0
    )
    assert masses[0, 0] > masses[0, 1] > 0.2


def test_the_loss_of_the_yaw_is_least_at_the_true_angle():
    network = YawNetwork(YawConfig(bins=60))
    logits = torch.full((1, 60), -5.0)
    logits[0, 9:12] = torch.tensor([3.0, 5.0, 3.0])
    losses = [
        network.compute_loss(logits, torch.tensor([math.radians(a)]), torch.ones(1)).item()
        for a in range(0, 360, 6)
    ]
    assert losses.index(min(losses)) == 10


def test_normalised_clouds_do_not_depend_on_place_size_and_yaw(clouds):
    changed = rotate_yaw(clouds * 3 + torch.tensor([5.0, -2.0, 1.0]), torch.full((2,), 0.7))
    expected = rotate_yaw(clouds, torch.full((2,), 0.7))
    torch.testing.assert_close(center_clouds(changed)[0], expected, atol=1e-5, rtol=0)


def test_configurations_survive_json():
    for config in PRESETS.values():
        config = dataclasses.replace(config, categories=("A", "B"))
        assert NetworkConfig.from_json(config.to_json()) == config


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", r"NetworkConfig must be an object; got \[\]"),
        ("{}", "levels: field required"),
        ('{"levels": 3}', "levels should be a valid array; got 3"),
        ("[" * 100_000, "recursion limit exceeded"),
    ],
)
def test_damaged_configurations_are_refused(text, message):
    with pytest.raises(ValueError, match=message):
        NetworkConfig.from_json(text)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"attention_blocks": 10**9},
            r"attention_blocks should be less than or equal to 64; got 1000000000",
        ),
        ({"attention_heads": 0}, r"attention_heads should be greater than or equal to 1; got 0"),
        ({"features": -3}, r"features should be greater than or equal to 1; got -3"),
        ({"features": 8.0}, r"features should be a valid integer; got 8\.0"),
        ({"features": True}, "features should be a valid integer; got True"),
        ({"head_width": 10**9}, r"head_width should be less than or equal to 8192"),
        ({"categories": ["../../x"]}, r"a category must be letters.*got '\.\./\.\./x'"),
        ({"categories": ["A", "A"]}, "categories must differ"),
        ({"categories": "AB"}, "categories should be a valid array; got 'AB'"),
        ({"yaw": {"width": 6}}, "yaw: width must be a multiple of 4; got 6"),
        ({"yaw": {"bins": 10**9}}, r"yaw\.bins should be less than or equal to 4096"),
        ({"yaw": {"radius": float("nan")}}, "a number must be finite"),
        (
            {"yaw": {"radius": 10**400}},
            r"yaw\.radius should be a finite number; got a whole number of 1329 bits",
        ),
        ({"yaw": None}, "yaw should be an object; got None"),
        ({"levels": [], "up": []}, r"levels: tuple should have at least 1 item"),
        ({"colour": 1}, "colour: unexpected keyword argument"),
    ],
)
def test_fields_beyond_their_bounds_are_refused(change, message):
    values = json.loads(PRESETS["small"].to_json())
    with pytest.raises(ValueError, match=message):
        NetworkConfig.from_json(json.dumps({**values, **change}))


def test_levels_beyond_their_bounds_are_refused():
    level = {"centres": 8, "radius": 0.1, "neighbours": 4, "widths": [8]}
    for change, message in (
        ({"centres": -1}, r"centres should be greater than or equal to 0; got -1"),
        ({"radius": 0.0}, "radius and neighbours must be positive"),
        ({"widths": []}, r"widths: tuple should have at least 1 item"),
        ({"centres": 16384, "neighbours": 4096, "widths": [8192]}, "at most 67108864; got"),
        ({"centres": 0}, "centres of the first level must be at least 1; got 0"),
    ):
        values = json.loads(PRESETS["small"].to_json())
        values["levels"][0] = {**level, **change}
        with pytest.raises(ValueError, match=message):
            NetworkConfig.from_json(json.dumps(values))


def test_wrong_configurations_are_refused():
    level = GamLevelConfig(centres=8, radius=0.1, neighbours=4, widths=(8,))
    with pytest.raises(ValueError, match="centres must fall"):
        dataclasses.replace(
            PRESETS["small"],
            levels=(level, dataclasses.replace(level, centres=9)),
            up=((8,), (8,)),
        )
    with pytest.raises(ValueError, match="up must have one entry for each level"):
        dataclasses.replace(PRESETS["small"], up=((8,),))
    with pytest.raises(ValueError, match=r"one of \['paper', 'small'\]; .*did you mean 'paper'"):
        get_network_config("paper2")
