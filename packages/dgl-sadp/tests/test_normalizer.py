import h5py
import numpy as np
import pytest
import torch

from dgl_sadp import DamagedEpisodeError, EpisodeDataset
from dgl_sadp.normalizer import Normalizer, Range, RangeScaler
from dgl_sadp.ranges import join_ranges, measure_episodes


def make_scaler(low, high, **options):
    scaler = RangeScaler(len(low))
    scaler.fit(Range(np.array(low, float), np.array(high, float)), **options)
    return scaler


def test_ranges_map_to_minus_one_and_one_and_back():
    scaler = make_scaler([-3.0, 0.5], [1.0, 0.75])
    values = torch.tensor([[-3.0, 0.5], [1.0, 0.75], [-1.0, 0.625]])
    torch.testing.assert_close(
        scaler.normalize(values), torch.tensor([[-1.0, -1.0], [1.0, 1.0], [0.0, 0.0]])
    )
    anything = torch.linspace(-9, 9, 40).reshape(20, 2)
    torch.testing.assert_close(scaler.unnormalize(scaler.normalize(anything)), anything)


def test_constant_channels_become_zero_and_the_constant_again():
    scaler = make_scaler([0.7, 0.0], [0.7 + 1e-5, 1.0])
    values = torch.tensor([[0.7, 0.5], [0.9, 1.0]])
    assert scaler.normalize(values)[:, 0].tolist() == [0.0, 0.0]
    back = scaler.unnormalize(torch.tensor([[0.0, 0.0], [5.0, 0.0]]))[:, 0]
    torch.testing.assert_close(back, torch.tensor([0.7, 0.7]), atol=2e-5, rtol=0)


def test_isotropic_scaling_keeps_shapes():
    scaler = make_scaler([0.0, 0.0, 0.0], [2.0, 1.0, 0.1], is_isotropic=True)
    corners = scaler.normalize(torch.tensor([[0.0, 0.0, 0.0], [2.0, 1.0, 0.1]]))
    torch.testing.assert_close(corners[1] - corners[0], torch.tensor([2.0, 1.0, 0.1]))
    assert corners.abs().max() == 1.0


@pytest.mark.parametrize(
    ("low", "high", "message"),
    [
        ([0.0], [float("nan")], "finite"),
        ([1.0], [0.0], "low must not exceed high"),
        ([0.0], [1.0, 2.0], r"got \(1,\), \(2,\)"),
    ],
)
def test_wrong_ranges_are_refused(low, high, message):
    with pytest.raises(ValueError, match=message):
        Range(np.array(low), np.array(high))


def test_missing_and_short_ranges_are_refused(tiny_config):
    normalizer = Normalizer(tiny_config("sadp"))
    with pytest.raises(ValueError, match=r"missing \['action', 'env_point_cloud'"):
        normalizer.fit({})
    short = Range(np.zeros(3), np.ones(3))
    with pytest.raises(ValueError, match="must have 60 channels; got 3"):
        normalizer.fit(dict.fromkeys(normalizer, short))


def test_ranges_of_a_dataset_are_those_of_all_its_values(tmp_path, make_episode):
    for number in range(3):
        make_episode(tmp_path / f"{number}.h5", frames=40 + number, offset=10.0 * number)
    dataset = EpisodeDataset(tmp_path)
    measured = measure_episodes(dataset, ["action", "env_point_cloud", "garment_point_cloud"])
    found = join_ranges(measured.ranges)
    assert (found["action"].low.tolist(), found["action"].high.tolist()) == (
        [0.5] * 60,
        [61.5] * 60,
    )
    assert found["env_point_cloud"].high.tolist() == [61.0] * 6
    assert found["garment_point_cloud"].low.tolist() == [1.0] * 3
    assert found["garment_point_cloud"].high.tolist() == [21.0] * 3


def test_relative_actions_are_measured_from_where_the_stage_began(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=40, offset=7.0, approach_frames=3)
    for with_approach, first in ((False, 10.0), (True, 7.0)):
        dataset = EpisodeDataset(tmp_path, with_approach=with_approach)
        assert (dataset[0]["start_joint_state"] == first).all()
        measured = measure_episodes(dataset, ["action"], relative_joints=[2, 31])
        found = measured.ranges[0]["action"]
        for joint in (2, 31):  # States count frames from 7, actions are half a frame ahead.
            assert (found.low[joint], found.high[joint]) == (0.5, 46.5 - first)
        assert (found.low[3], found.high[3]) == (first + 0.5, 46.5)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", ["action", "garment_point_cloud"])
def test_values_that_are_not_finite_are_refused_by_name_and_the_rest_goes_on(
    tmp_path, make_episode, key, value
):
    for number in range(3):
        make_episode(tmp_path / f"{number}.h5", offset=number)
    with h5py.File(tmp_path / "1.h5", "a") as file:
        file[f"stage_1/{key}"][3, 1] = value
    measured = measure_episodes(EpisodeDataset(tmp_path), ["action", "garment_point_cloud"])
    assert [episode.path.name for episode in measured.dataset.episodes] == ["0.h5", "2.h5"]
    assert len(measured.ranges) == 2
    (error,) = measured.refused
    assert isinstance(error, DamagedEpisodeError)
    assert error.path.name == "1.h5"
    assert f"stage_1/{key} has values that are not finite" in str(error)


def test_a_dataset_without_a_whole_episode_is_refused(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    with h5py.File(tmp_path / "0.h5", "a") as file:
        file["stage_1/action"][0] = np.nan
    with pytest.raises(ValueError, match=r"none of the 1 episode\(s\) is whole.*0\.h5"):
        measure_episodes(EpisodeDataset(tmp_path), ["action"])


def test_a_cloud_that_was_not_recorded_is_named(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    with pytest.raises(ValueError, match=r"0\.h5 has no object_point_cloud"):
        measure_episodes(EpisodeDataset(tmp_path), ["object_point_cloud"])
