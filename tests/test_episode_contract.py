"""Episodes written by `dgl_collect` are read by `dgl_sadp`; neither imports the other."""

import dataclasses
import importlib
from pathlib import Path

import h5py
import numpy as np
import pytest

import dgl_sadp
from dgl_collect import read_episode, write_episode
from dgl_sadp.synthetic import write_synthetic_episodes

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"
FRAMES = 10


@pytest.fixture
def fakes(monkeypatch):
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    return importlib.import_module("dgl_collect_fakes")


@pytest.fixture
def episodes(tmp_path, fakes):
    """Two successful episodes and a failed one, on disk."""
    written = []
    for seed in range(3):
        cloud = np.full((2048, 3), seed, np.float32)
        stages = tuple(
            fakes.make_stage(10 * seed + k, frames=FRAMES, name=name, object_point_cloud=cloud)
            for k, name in enumerate(("grasp", "hang"))
        )
        episode = fakes.make_episode(
            seed, stages=stages, success=seed != 1, affordance_matcher="gam", cloud="scene"
        )
        write_episode(tmp_path / f"{seed}.h5", episode)
        written.append(episode)
    return written


def test_the_reader_finds_every_window_of_the_successful_episodes(tmp_path, episodes):
    dataset = dgl_sadp.EpisodeDataset(tmp_path, horizon=8, observation_steps=3, action_steps=4)
    assert [episode.path.name for episode in dataset.episodes] == ["0.h5", "2.h5"]
    assert [path.name for path in dataset.failed] == ["1.h5"]
    assert {episode.cloud for episode in dataset.episodes} == {"scene"}
    windows_each = FRAMES + 2
    assert dataset.counts.tolist() == [windows_each] * 4
    stage = episodes[2].stages[1]
    window = dataset[3 * windows_each + 2]  # two windows begin before a stage: this is at frame 0
    for key in ("joint_state", "ee_pose", "env_point_cloud"):
        np.testing.assert_array_equal(window[key], getattr(stage, key)[:3], strict=True)
    np.testing.assert_array_equal(window["action"], stage.action[:8], strict=True)
    for key in ("garment_point_cloud", "points_affordance_feature", "object_point_cloud"):
        np.testing.assert_array_equal(window[key], getattr(stage, key), strict=True)


def test_pictures_arrive_too(tmp_path, episodes):
    dataset = dgl_sadp.EpisodeDataset(tmp_path, observation_keys=("image",))
    np.testing.assert_array_equal(dataset[0]["image"][0], episodes[0].stages[0].image[0])


def test_the_reader_refuses_what_the_writer_does_not_write(tmp_path, episodes):
    with h5py.File(tmp_path / "0.h5", "r+") as file:
        file.attrs["format_version"] = 2
    with pytest.raises(dgl_sadp.DamagedEpisodeError, match="format version 2"):
        dgl_sadp.EpisodeDataset(tmp_path)


def test_the_documented_keys_are_the_written_ones(tmp_path, episodes):
    """`docs/episode_format.md` names every data set and attribute, and no other."""
    page = (Path(__file__).parents[1] / "docs/episode_format.md").read_text(encoding="utf-8")
    with h5py.File(tmp_path / "0.h5") as file:
        keys, attributes, of_stage = set(file["stage_1"]), set(file.attrs), file["stage_1"].attrs
        assert all(f"`stage_<k>/{key}`" in page for key in keys)
        assert page.count("| `stage_<k>/") == len(keys)
        assert all(f"| `{name}` |" in page for name in [*attributes, *of_stage])
    assert {field.name for field in dataclasses.fields(episodes[0])} - {
        "stages",
        "extra",
        "commands",
    } < (attributes)
    assert "`commands`" in page


def test_made_up_episodes_are_of_the_format(tmp_path):
    (path,) = write_synthetic_episodes(tmp_path, 1, frames=6, image_size=(480, 640))
    episode = read_episode(path)
    assert (episode.task, episode.success) == ("Synthetic-v1", True)
    assert episode.stages[0].joint_state.shape == (6, 60)
