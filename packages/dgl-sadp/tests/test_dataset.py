import fcntl
import pickle
import shutil

import h5py
import numpy as np
import pytest
from torch.utils.data import DataLoader

import dgl_sadp._episode_file
import dgl_sadp.dataset
from dgl_sadp import (
    DamagedEpisodeError,
    EpisodeAccessError,
    EpisodeDataset,
    UnsuitableEpisodeError,
)
from dgl_sadp._episode_file import FRAME_KEYS
from dgl_sadp.ranges import measure_episodes

POINTS = 5  # In the clouds of `make_episode`.


def actions_of(window) -> list[float]:
    return (window["action"][:, 0] - 0.5).tolist()


def states_of(window) -> list[float]:
    return window["joint_state"][:, 0].tolist()


def test_windows_begin_two_before_the_stage_and_end_where_it_stays_at_its_last_frame(
    tmp_path, make_episode
):
    make_episode(tmp_path / "0.h5", frames=12)
    windows = list(EpisodeDataset(tmp_path))
    assert len(windows) == 2 + 12
    assert actions_of(windows[0]) == [0, 0, 0, 1, 2, 3, 4, 5]
    assert states_of(windows[0]) == [0, 0, 0]
    assert actions_of(windows[2]) == [0, 1, 2, 3, 4, 5, 6, 7]
    assert states_of(windows[2]) == [0, 1, 2]
    assert actions_of(windows[-5]) == [7, 8, 9, 10, 11, 11, 11, 11]
    assert states_of(windows[-5]) == [7, 8, 9]
    assert actions_of(windows[-1]) == [11] * 8
    assert states_of(windows[-1]) == [11, 11, 11]


def test_windows_are_those_of_a_padded_array(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=9)
    padded = np.pad(np.arange(9.0), (3, 5), mode="edge")
    dataset = EpisodeDataset(tmp_path, horizon=6, observation_steps=4, action_steps=2)
    expected = [padded[i : i + 6].tolist() for i in range(len(padded) - 5)]
    assert [actions_of(window) for window in dataset] == expected


def test_an_approach_is_left_out_unless_it_is_wanted(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=14, approach_frames=4)
    for keep_bytes in (0, 2**20):
        stage = EpisodeDataset(tmp_path, keep_bytes=keep_bytes)
        assert actions_of(stage[0]) == [4, 4, 4, 5, 6, 7, 8, 9]
        assert actions_of(stage[-5]) == [9, 10, 11, 12, 13, 13, 13, 13]
        whole = EpisodeDataset(tmp_path, keep_bytes=keep_bytes, with_approach=True)
        assert actions_of(whole[0]) == [0, 0, 0, 1, 2, 3, 4, 5]
        assert len(whole) == len(stage) + 4


def test_an_approach_that_was_not_recorded_is_named(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=14)
    with pytest.raises(ValueError, match=r"0\.h5: stage 1 must have its approach recorded"):
        EpisodeDataset(tmp_path, with_approach=True)


def test_an_approach_as_long_as_the_stage_is_refused(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=14, approach_frames=14)
    with pytest.raises(DamagedEpisodeError, match=r"approach_frames .* \[0, 14\); got 14"):
        EpisodeDataset(tmp_path)


def test_each_frame_is_decided_on_once_and_the_last_once_for_each_observation(
    tmp_path, make_episode
):
    make_episode(tmp_path / "0.h5", frames=20)
    last = [states_of(window)[-1] for window in EpisodeDataset(tmp_path)]
    assert last == [*range(20), 19, 19]


def test_shapes_and_types(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", has_object=True)
    window = EpisodeDataset(tmp_path, observation_keys=("joint_state", "ee_pose", "image"))[0]
    assert {key: (array.shape, str(array.dtype)) for key, array in window.items()} == {
        "stage": ((), "int64"),
        "joint_state": ((3, 60), "float32"),
        "start_joint_state": ((60,), "float32"),
        "ee_pose": ((3, 2, 7), "float32"),
        "image": ((3, 4, 6, 3), "uint8"),
        "action": ((8, 60), "float32"),
        "garment_point_cloud": ((5, 3), "float32"),
        "points_affordance_feature": ((5, 2), "float32"),
        "object_point_cloud": ((5, 3), "float32"),
    }


def test_windows_never_cross_from_one_episode_to_the_next(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5", frames=4, offset=0)
    make_episode(tmp_path / "b.h5", frames=9, offset=1000)
    dataset = EpisodeDataset(tmp_path)
    assert len(dataset) == (2 + 4) + (2 + 9)
    for window in dataset:
        assert len({value >= 1000 for value in actions_of(window)}) == 1
        assert window["garment_point_cloud"][0, 0] == 1 + 1000 * (actions_of(window)[0] >= 1000)


def test_stages_are_separate_and_told(tmp_path, make_episode):
    for name in "ab":
        make_episode(tmp_path / f"{name}.h5", stages=2)
    dataset = EpisodeDataset(tmp_path)
    assert (dataset.stages, dataset.counts.tolist()) == (2, [14] * 4)
    assert [int(window["stage"]) for window in dataset] == ([0] * 14 + [1] * 14) * 2
    for window in dataset:
        assert {value >= 100 for value in states_of(window)} == {window["stage"] == 1}
        assert window["garment_point_cloud"][0, 0] == 1 + window["stage"]
    part = dataset.select([1])
    assert [(p.path.name, p.stage) for p in part.parts] == [("b.h5", 1), ("b.h5", 2)]


def test_an_episode_may_be_shorter_than_a_window(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=2)
    windows = list(EpisodeDataset(tmp_path))
    assert [states_of(window) for window in windows] == [[0, 0, 0], [0, 0, 1], [0, 1, 1], [1, 1, 1]]
    assert actions_of(windows[1]) == [0, 0, 1, 1, 1, 1, 1, 1]


def test_failed_episodes_are_left_out_and_counted(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5")
    failed = make_episode(tmp_path / "b.h5", success=False)
    dataset = EpisodeDataset(tmp_path)
    assert dataset.failed == (failed,)
    assert [episode.path.name for episode in dataset.episodes] == ["a.h5"]
    (tmp_path / "a.h5").unlink()
    with pytest.raises(ValueError, match=r"none of the 1 episode"):
        EpisodeDataset(tmp_path)


def test_files_that_are_being_written_are_not_read(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5")
    (tmp_path / ".b.partial-17.h5").write_bytes(b"half")
    assert len(EpisodeDataset(tmp_path).episodes) == 1


def test_an_empty_folder_is_refused_and_its_subfolder_suggested(tmp_path, make_episode):
    with pytest.raises(FileNotFoundError, match=r"no episode files \(\*\.h5\)"):
        EpisodeDataset(tmp_path)
    (tmp_path / "folds").mkdir()
    make_episode(tmp_path / "folds" / "0.h5")
    with pytest.raises(FileNotFoundError, match=r"did you mean .*/folds\?"):
        EpisodeDataset(tmp_path)


def test_a_truncated_file_is_refused_by_name(tmp_path, make_episode):
    path = make_episode(tmp_path / "0.h5")
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(DamagedEpisodeError, match=r"0\.h5: cannot be read.*collect"):
        EpisodeDataset(tmp_path)


def test_a_file_that_is_no_hdf5_is_refused(tmp_path):
    (tmp_path / "0.h5").write_text("episode")
    with pytest.raises(DamagedEpisodeError, match=r"cannot be read"):
        EpisodeDataset(tmp_path)


def test_an_episode_that_another_process_holds_stops_the_reading(tmp_path, make_episode):
    path = make_episode(tmp_path / "0.h5")
    make_episode(tmp_path / "1.h5")
    with path.open("rb+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        with pytest.raises(
            EpisodeAccessError, match=r"0\.h5 .*another process has locked"
        ) as caught:
            EpisodeDataset(tmp_path, skip_corrupt=True)
    assert "remove" not in str(caught.value)
    assert len(EpisodeDataset(tmp_path).episodes) == 2


def test_an_episode_that_may_not_be_read_stops_the_reading(tmp_path, make_episode, monkeypatch):
    make_episode(tmp_path / "0.h5")

    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(h5py, "File", refuse)
    with pytest.raises(EpisodeAccessError, match=r"0\.h5 .*permission denied"):
        EpisodeDataset(tmp_path, skip_corrupt=True)


def test_a_copy_of_an_episode_is_left_out(tmp_path, make_episode):
    for name, offset in {"a": 0.0, "b": 1.0}.items():
        make_episode(tmp_path / f"{name}.h5", offset=offset)
    shutil.copy(tmp_path / "a.h5", tmp_path / "c.h5")
    found = measure_episodes(EpisodeDataset(tmp_path), ("action", "garment_point_cloud"))
    assert [episode.path.name for episode in found.dataset.episodes] == ["a.h5", "b.h5"]
    (refused,) = found.refused
    assert str(refused).endswith("c.h5: it is the same episode as a.h5")


def _delete(key):
    def change(file):
        del file[key]

    return change


def _replace(key, values):
    def change(file):
        del file[key]
        file[key] = values

    return change


def _attribute(name, value):
    def change(file):
        if value is None:
            del file.attrs[name]
        else:
            file.attrs[name] = value

    return change


def _stage_attribute(name, value):
    def change(file):
        file["stage_1"].attrs[name] = value

    return change


def _link(key, link):
    def change(file):
        del file[key]
        file[key] = link

    return change


def _declare(key, shape, dtype):
    """Declare an array and write nothing."""

    def change(file):
        if key in file["stage_1"]:
            del file["stage_1"][key]
        file["stage_1"].create_dataset(key, shape=shape, dtype=dtype, chunks=True)

    return change


def _declare_all(frames):
    def change(file):
        for key, (shape, dtype) in FRAME_KEYS.items():
            size = tuple(each or 16 for each in shape)
            _declare(key, (frames, *size), dtype)(file)

    return change


def _store_outside(file):
    del file["stage_1/action"]
    file["stage_1"].create_dataset(
        "action", shape=(12, 60), dtype="f4", external=[("/etc/passwd", 0, 12 * 60 * 4)]
    )


def _make_virtual(file):
    del file["stage_1/action"]
    layout = h5py.VirtualLayout(shape=(12, 60), dtype="f4")
    layout[:] = h5py.VirtualSource("other.h5", "action", shape=(12, 60))
    file["stage_1"].create_virtual_dataset("action", layout)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_attribute("format_version", 2), r"format version 2; this package reads 1"),
        (_attribute("format_version", None), r"no attribute format_version"),
        (_attribute("success", None), r"no attribute success"),
        (_attribute("format_version", 1.9), r"format_version must be a whole number; got 1\.9"),
        (_attribute("format_version", "1"), r"format_version must be a whole number; got '1'"),
        (_attribute("format_version", True), r"format_version must be a whole number; got True"),
        (_attribute("format_version", [1]), r"format_version must be one value; got an array"),
        (_attribute("success", "False"), r"success must be true or false; got 'False'"),
        (_attribute("success", float("nan")), r"success must be true or false; got nan"),
        (_attribute("success", 1), r"success must be true or false; got 1"),
        (_attribute("success", np.ones(3, bool)), r"success must be one value; got an array"),
        (_attribute("success", h5py.Empty("f4")), r"success must be one value; got an array"),
        (_attribute("robot", 5), r"robot must be a text of at most 200 characters; got 5"),
        (_attribute("robot", "a\nb"), r"recorded with robot 'a\\nb'; policies are of"),
        (_attribute("task", "x" * 1000), r"task must be a text of at most 200 characters; got"),
        (_stage_attribute("approach_frames", 1.5), r"must be a whole number; got 1\.5"),
        (_stage_attribute("approach_frames", "no"), r"must be a whole number; got 'no'"),
        (_replace("stage_1/action", h5py.Empty("f4")), r"float32 of shape .*; got float32 of \(\)"),
        (_replace("stage_1/action", np.bool_(True)), r"float32 of shape .*; got bool of \(\)"),
        (_link("stage_1/action", h5py.ExternalLink("/etc/passwd", "/x")), "link to another file"),
        (_link("stage_1/action", h5py.SoftLink("/stage_1/joint_state")), "itself; got a link"),
        (_link("stage_1/action", h5py.SoftLink("/stage_1/action")), "itself; got a link"),
        (_link("stage_1", h5py.ExternalLink("other.h5", "/stage_1")), "link to another file"),
        (_declare("image", (6000, 480, 640, 3), "u1"), "arrays of different lengths"),
        (_declare("image", (12, 2**20, 2**20, 3), "u1"), r"4194304 pixels a frame"),
        (_declare("image", (12, 480, 640, 3), "u1"), r"declares 11059200 bytes.*but holds 0"),
        (_declare("env_point_cloud", (12, 10**6, 6), "f4"), r"262144 environment points a frame"),
        (_declare("garment_point_cloud", (10**12, 3), "f4"), r"at most 262144 points"),
        (_declare("object_point_cloud", (10**5, 3), "f4"), r"declares .*but holds 0"),
        (_declare_all(10**12), r"1 \.\.\. 100000 frames; got 1000000000000"),
        (_declare_all(6000), r"declares .*but holds 0"),
        (_store_outside, "must be in the file itself; got data of other files"),
        (_make_virtual, "must be in the file itself; got data of other files"),
        (_delete("stage_1"), "it has no stages"),
        (_delete("stage_1/action"), r"no array /stage_1/action"),
        (_delete("stage_1/garment_point_cloud"), r"no array /stage_1/garment_point_cloud"),
        (
            _replace("stage_1/action", np.zeros((12, 59), np.float32)),
            r"float32 of shape \('any', 60\); got float32 of \(12, 59\)",
        ),
        (_replace("stage_1/action", np.zeros((12, 60))), r"float32 of shape.*got float64"),
        (_replace("stage_1/action", np.zeros((11, 60), np.float32)), r"different lengths"),
        (
            _replace("stage_1/points_affordance_feature", np.zeros((4, 2), np.float32)),
            r"5 garment points; 4 affordance rows",
        ),
    ],
)
def test_files_of_another_form_are_refused(tmp_path, make_episode, change, message):
    path = make_episode(tmp_path / "0.h5")
    with h5py.File(path, "a") as file:
        change(file)
    with pytest.raises(DamagedEpisodeError, match=message) as caught:
        EpisodeDataset(tmp_path)
    assert caught.value.path == path


def test_damage_inside_an_array_is_found_by_its_checksum_when_read(tmp_path, make_episode):
    path = make_episode(tmp_path / "0.h5")
    marker = np.full((12, 60), 1234.5, np.float32)
    with h5py.File(path, "a") as file:
        del file["stage_1/action"]
        file.create_dataset("stage_1/action", data=marker, chunks=(12, 60), fletcher32=True)
    content = bytearray(path.read_bytes())
    content[content.index(marker.tobytes()) + 100] ^= 0xFF
    path.write_bytes(content)
    dataset = EpisodeDataset(tmp_path)
    with pytest.raises(DamagedEpisodeError, match=r"0\.h5"):
        dataset[0]


def test_a_file_removed_after_the_scan_is_missing_rather_than_corrupt(tmp_path, make_episode):
    path = make_episode(tmp_path / "0.h5")
    dataset = EpisodeDataset(tmp_path)
    path.unlink()
    with pytest.raises(FileNotFoundError):
        dataset[0]


def test_static_arrays_are_read_once_and_given_as_copies(tmp_path, make_episode, monkeypatch):
    make_episode(tmp_path / "0.h5")
    dataset = EpisodeDataset(tmp_path)
    dataset[0]["garment_point_cloud"][:] = -1
    monkeypatch.setattr("dgl_sadp.dataset.read_static", None)  # A second read would fail.
    assert (dataset[1]["garment_point_cloud"] == 1).all()


def test_episodes_agree_in_what_their_environment_clouds_show(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5")
    make_episode(tmp_path / "b.h5", cloud="segmented")
    assert {e.cloud for e in EpisodeDataset(tmp_path).episodes} == {"segmented"}
    make_episode(tmp_path / "c.h5", cloud="scene")
    with pytest.raises(ValueError, match=r"one kind.*b\.h5 has 'segmented' but c\.h5 has 'scene'"):
        EpisodeDataset(tmp_path)


def test_episodes_agree_in_their_stages_of_which_none_is_missing(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5", stages=2)
    path = make_episode(tmp_path / "b.h5", stages=3)
    with pytest.raises(ValueError, match=r"number of their stages; a\.h5 has 2 but b\.h5 has 3"):
        EpisodeDataset(tmp_path)
    with h5py.File(path, "a") as file:
        del file["stage_2"]
    with pytest.raises(DamagedEpisodeError, match=r"b\.h5: no stage_2"):
        EpisodeDataset(tmp_path)


def test_episodes_of_several_tasks_are_refused(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5")
    with h5py.File(make_episode(tmp_path / "b.h5"), "a") as file:
        file.attrs["task"] = "FlingTops-v1"
    with pytest.raises(
        ValueError, match=r"one task; a\.h5 has 'FoldTops-v1' but b\.h5 has 'FlingTops-v1'"
    ):
        EpisodeDataset(tmp_path)


def test_episodes_agree_in_having_an_object(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5", has_object=True)
    make_episode(tmp_path / "b.h5", has_object=False)
    with pytest.raises(ValueError, match=r"must agree.*a\.h5 has.*object.*b\.h5"):
        EpisodeDataset(tmp_path)


def test_select_keeps_only_the_named_episodes(tmp_path, make_episode):
    for number in range(3):
        make_episode(tmp_path / f"{number}.h5", offset=100 * number)
    dataset = EpisodeDataset(tmp_path)
    part = dataset.select([2])
    assert {int(states_of(window)[0]) // 100 for window in part} == {2}
    assert len(part) * 3 == len(dataset)


@pytest.mark.parametrize("chosen", [[], [0, 0], [-1], [1]])
def test_select_refuses_what_is_not_there(tmp_path, make_episode, chosen):
    make_episode(tmp_path / "0.h5")
    with pytest.raises(ValueError, match="episodes must"):
        EpisodeDataset(tmp_path).select(chosen)


def test_indices_count_from_either_end(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    dataset = EpisodeDataset(tmp_path)
    np.testing.assert_array_equal(dataset[-1]["action"], dataset[len(dataset) - 1]["action"])
    for index in (len(dataset), -len(dataset) - 1):
        with pytest.raises(IndexError, match=str(index)):
            dataset[index]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"observation_steps": 0}, "observation_steps must be at least 1; got 0"),
        ({"action_steps": 0}, "action_steps must be at least 1; got 0"),
        ({"horizon": 5}, "horizon must be at least .* = 6; got 5"),
        ({"observation_keys": ("action",)}, "observation_keys must be of"),
        ({"observation_keys": ("depth",)}, r"got \['depth'\]"),
    ],
)
def test_arguments_out_of_range_are_refused(tmp_path, make_episode, arguments, message):
    make_episode(tmp_path / "0.h5")
    with pytest.raises(ValueError, match=message):
        EpisodeDataset(tmp_path, **arguments)


def test_the_smallest_horizon_is_enough(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5", frames=1)
    windows = list(EpisodeDataset(tmp_path, horizon=6))
    assert [actions_of(window) for window in windows] == [[0] * 6] * 3


def test_dataset_and_its_error_travel_between_processes(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    dataset = pickle.loads(pickle.dumps(EpisodeDataset(tmp_path)))
    assert len(dataset) == 14
    error = pickle.loads(pickle.dumps(DamagedEpisodeError(tmp_path, "torn")))
    assert error.reason == "torn"


def test_no_file_stays_open(tmp_path, make_episode, monkeypatch):
    make_episode(tmp_path / "0.h5")
    opened = []
    original = h5py.File

    def spy(*arguments):
        opened.append(original(*arguments))
        return opened[-1]

    monkeypatch.setattr(dgl_sadp._episode_file.h5py, "File", spy)
    EpisodeDataset(tmp_path)[0]
    assert opened
    assert not any(bool(file) for file in opened)


def test_pytorch_collates_windows_into_batches(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    batch = next(iter(DataLoader(EpisodeDataset(tmp_path), batch_size=4)))
    assert tuple(batch["action"].shape) == (4, 8, 60)
    assert tuple(batch["env_point_cloud"].shape) == (4, 3, 5, 6)


@pytest.mark.parametrize("kept", [0, 1, 2, 3])
def test_frames_that_are_kept_in_memory_are_the_same(tmp_path, make_episode, monkeypatch, kept):
    for number in range(3):
        make_episode(tmp_path / f"{number}.h5", frames=9, offset=100 * number)
    plain = list(EpisodeDataset(tmp_path))
    # A frame: 60 + 60 joints, 14 of poses and 5 points of 6 channels, in float32.
    size = 9 * (120 + 14 + POINTS * 6) * 4
    dataset = EpisodeDataset(tmp_path, keep_bytes=kept * size + size // 2)
    for window, wanted in zip(dataset, plain, strict=True):
        assert set(window) == set(wanted)
        for key, values in window.items():
            np.testing.assert_array_equal(values, wanted[key])
            values[...] = 0  # The window is the caller's: what is kept must not change.
    reads = []
    original = dgl_sadp.dataset.read_frames
    monkeypatch.setattr(
        dgl_sadp.dataset, "read_frames", lambda e, w: reads.append(e.path.name) or original(e, w)
    )
    for window, wanted in zip(dataset, plain, strict=True):
        np.testing.assert_array_equal(window["action"], wanted["action"])
    assert set(reads) == {f"{number}.h5" for number in range(kept, 3)}


def test_corrupt_files_may_be_left_out_by_name(tmp_path, make_episode, caplog):
    make_episode(tmp_path / "a.h5")
    (tmp_path / "b.h5").write_text("episode")
    dataset = EpisodeDataset(tmp_path, skip_corrupt=True)
    assert [episode.path.name for episode in dataset.episodes] == ["a.h5"]
    (error,) = dataset.refused
    assert error.path.name == "b.h5"
    assert "left out: " in caplog.text
    assert "b.h5: cannot be read" in caplog.text
    (tmp_path / "a.h5").unlink()
    with pytest.raises(ValueError, match=r"none of the 0 episode.*1 are refused: .*b\.h5"):
        EpisodeDataset(tmp_path, skip_corrupt=True)


def test_less_than_no_memory_is_refused(tmp_path, make_episode):
    make_episode(tmp_path / "0.h5")
    with pytest.raises(ValueError, match="keep_bytes must be at least 0; got -1"):
        EpisodeDataset(tmp_path, keep_bytes=-1)


def test_episodes_agree_in_their_stages(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5", stages=2)
    make_episode(tmp_path / "b.h5", stages=1)
    for skip_corrupt in (False, True):
        with pytest.raises(ValueError, match=r"their stages; a\.h5 has 2 but b\.h5 has 1"):
            EpisodeDataset(tmp_path, skip_corrupt=skip_corrupt)


def test_good_episodes_that_do_not_fit_are_not_advised_to_be_removed(tmp_path, make_episode):
    make_episode(tmp_path / "a.h5")
    for name, value in (("format_version", 2), ("robot", "arm+claw")):
        path = make_episode(tmp_path / "b.h5")
        with h5py.File(path, "a") as file:
            file.attrs[name] = value
        with pytest.raises(UnsuitableEpisodeError) as caught:
            EpisodeDataset(tmp_path)
        assert "remove" not in str(caught.value)
        assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_pipes_and_links_to_nothing_are_refused(tmp_path, make_episode):
    import os

    make_episode(tmp_path / "a.h5")
    os.mkfifo(tmp_path / "b.h5")
    (tmp_path / "c.h5").symlink_to(tmp_path / "c.h5")
    (tmp_path / "d.h5").symlink_to(tmp_path / "none")
    (tmp_path / "e.h5").mkdir()
    dataset = EpisodeDataset(tmp_path, skip_corrupt=True)
    assert [error.path.name for error in dataset.refused] == ["b.h5", "c.h5", "d.h5", "e.h5"]


def test_a_link_put_in_after_the_scan_is_refused(tmp_path, make_episode):
    path = make_episode(tmp_path / "0.h5")
    dataset = EpisodeDataset(tmp_path)
    with h5py.File(path, "a") as file:
        _link("stage_1", h5py.ExternalLink("other.h5", "/stage_1"))(file)
    with pytest.raises(DamagedEpisodeError, match="link to another file"):
        dataset[0]
