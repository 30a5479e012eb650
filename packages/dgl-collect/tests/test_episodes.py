import dataclasses
import errno
import re
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest

from dgl_collect import CorruptEpisodeError, read_episode, write_episode
from dgl_collect.errors import FileUnavailableError
from dgl_collect.previews import read_previews

ARRAYS = (
    "joint_state", "action", "ee_pose", "image", "env_point_cloud", "garment_point_cloud",
    "points_affordance_feature",
)  # fmt: skip


@pytest.fixture
def written(tmp_path, fakes):
    return write_episode(tmp_path / "episode.h5", fakes.make_episode(1))


def test_what_is_read_is_what_was_written(written, fakes):
    given, found = fakes.make_episode(1), read_episode(written)
    for field in dataclasses.fields(given):
        if field.name not in ("stages", "extra"):
            assert getattr(found, field.name) == getattr(given, field.name)
    assert found.stage_names == ("left_sleeve", "right_sleeve")
    for a, b in zip(given.stages, found.stages, strict=True):
        assert b.points == a.points
        assert b.object_point_cloud is None
        for key in ARRAYS:
            np.testing.assert_array_equal(getattr(b, key), getattr(a, key), strict=True)


def test_object_cloud_and_extras_survive(tmp_path, fakes):
    cloud = np.ones((2048, 3), np.float32)
    stage = fakes.make_stage(object_point_cloud=cloud)
    extra = {"particles": np.arange(12.0).reshape(4, 3), "empty": np.zeros((0, 3))}
    path = write_episode(tmp_path / "e.h5", fakes.make_episode(stages=(stage,), extra=extra))
    found = read_episode(path)
    np.testing.assert_array_equal(found.stages[0].object_point_cloud, cloud)
    assert sorted(found.extra) == ["empty", "particles"]
    np.testing.assert_array_equal(found.extra["particles"], extra["particles"], strict=True)


def test_the_robot_is_recorded_and_says_how_many_joints_there_are(tmp_path, fakes):
    joints = np.zeros((2, 44), np.float32)
    stage = fakes.make_stage(joint_state=joints, action=joints)
    episode = fakes.make_episode(stages=(stage,), robot="ur10e+allegro")
    found = read_episode(write_episode(tmp_path / "e.h5", episode))
    assert found.robot == "ur10e+allegro"
    assert found.stages[0].action.shape == (2, 44)
    with pytest.raises(ValueError, match=r"ur10e\+shadow must have shape \(T, 60\); got \(T, 44\)"):
        fakes.make_episode(stages=(stage,))
    with pytest.raises(ValueError, match="same number of joints"):
        fakes.make_episode(stages=(stage, fakes.make_stage()), robot="ur10e+allegro")
    with pytest.raises(ValueError, match=r"action must have shape \(2, 44\); got \(2, 60\)"):
        fakes.make_stage(joint_state=joints)


def test_a_file_that_names_no_robot_is_of_the_default_one(written):
    with h5py.File(written, "r+") as file:
        assert file.attrs["robot"] == "ur10e+shadow"
        del file.attrs["robot"]
    assert read_episode(written).robot == "ur10e+shadow"


def test_the_kind_of_cloud_is_recorded(tmp_path, fakes):
    path = write_episode(tmp_path / "e.h5", fakes.make_episode(cloud="scene"))
    assert read_episode(path).cloud == "scene"
    with h5py.File(path, "r+") as file:
        del file.attrs["cloud"]
    assert read_episode(path).cloud == "segmented"
    with pytest.raises(ValueError, match="cloud should be 'segmented' or 'scene'; got 'all'"):
        fakes.make_episode(cloud="all")


def test_the_matcher_is_recorded(tmp_path, fakes):
    path = write_episode(tmp_path / "e.h5", fakes.make_episode(matcher="gam"))
    assert read_episode(path).matcher == "gam"
    with h5py.File(path, "r+") as file:
        del file.attrs["matcher"]
    assert read_episode(path).matcher == "exact"


def test_approach_frames_survive_and_must_leave_some_to_the_stage(tmp_path, fakes):
    stage = fakes.make_stage(frames=3, approach_frames=2)
    path = write_episode(tmp_path / "a.h5", fakes.make_episode(stages=(stage,)))
    assert read_episode(path).stages[0].approach_frames == 2


def test_the_same_episode_gives_the_same_bytes(tmp_path, fakes):
    first = write_episode(tmp_path / "a.h5", fakes.make_episode(3)).read_bytes()
    time.sleep(1.1)  # HDF5 keeps times in whole seconds
    assert write_episode(tmp_path / "b.h5", fakes.make_episode(3)).read_bytes() == first
    assert write_episode(tmp_path / "c.h5", fakes.make_episode(4)).read_bytes() != first


def test_the_layout_is_readable_without_this_package(written):
    with h5py.File(written) as file:
        assert file.attrs["format_version"] == 1
        assert file["stage_2/image"].shape == (3, 480, 640, 3)
        assert file["stage_2/image"].chunks == (1, 480, 640, 3)
        assert file["stage_1/env_point_cloud"].compression == "gzip"
        assert file["stage_1/env_point_cloud"].dtype == np.float32


WRONG_STAGES = (
    ("action", np.zeros((2, 59), np.float32), r"action must have shape \(2, 60\); got \(2, 59\)"),
    ("action", np.zeros((3, 60), np.float32), r"action must have shape \(2, 60\); got \(3, 60\)"),
    ("action", np.zeros((2, 60)), "action must be float32; got float64"),
    ("action", [[0.0] * 60] * 2, "action should be an instance of ndarray"),
    ("image", np.zeros((2, 480, 640, 3), np.int64), "image must be uint8; got int64"),
    ("joint_state", np.full((2, 60), np.nan, np.float32), "must be finite; got 120 values"),
    (
        "joint_state",
        np.zeros((0, 60), np.float32),
        r"at least one frame and joint; got shape \(0, 60\)",
    ),
    ("joint_state", np.zeros(60, np.float32), "joint_state must have shape"),
    ("ee_pose", np.zeros((2, 2, 7), np.float32), "unit quaternions; got one of length 0"),
    ("points_affordance_feature", np.full((2048, 2), 1.01, np.float32), r"in \[0, 1\]; got"),
    ("points", {"cuff": {"uv": [1.0]}}, r"points.cuff: a point must hold xyz .* got uv=\[1.0\]"),
    ("points", {"cuff": {"xyz": "abc"}}, "points.cuff.xyz"),
    ("points", {"cuff": {"xyz": [0.0, 0.0, float("nan")]}}, "points.cuff.xyz.*finite"),
    ("points", {"cuff": {"at": [1.0]}}, "got at="),
    ("points", {"cuff": [1.0]}, "points.cuff should be"),
    ("name", "", "name: string should have at least 1 character"),
    ("cloud_step", -1, "cloud_step should be greater than or equal to 0; got -1"),
    ("first_step", True, "first_step should be a valid integer; got True"),
    ("approach_frames", 2, "approach_frames must be fewer than the 2 frames; got 2"),
)
WRONG_EPISODES = (
    ({"stages": ()}, "stages: .* at least 1 item"),
    ({"task": ""}, "task: string should have at least 1 character"),
    ({"matcher": ""}, "matcher: string should have at least 1 character"),
    ({"success": 1}, "success should be a valid boolean; got 1"),
    ({"success_value": float("nan")}, "success_value should be a finite number; got nan"),
    ({"randomisation": {"x": float("inf")}}, "randomisation must be JSON-ready"),
    ({"measurements": {"x": object()}}, "measurements must be JSON-ready"),
    ({"extra": {"x": np.array(["text"])}}, "must be numeric"),
    ({"extra": {"a/b": np.zeros(3)}}, "without '/'"),
    ({"extra": {"x": np.array([np.nan])}}, "extra 'x' must be finite; got 1 values"),
    (
        {"commands": np.zeros((4, 59), np.float32)},
        r"commands must have shape \(4, 60\); got \(4, 59\)",
    ),
)


def find_wrong(table, make):
    """Rows that are not refused with their message."""
    wrong = []
    for *change, message in table:
        try:
            make(*change)
            found = "taken"
        except (ValueError, CorruptEpisodeError) as err:
            found = str(err)
        if not re.search(message, found):
            wrong.append((message, found))
    return wrong


def test_wrong_stages_and_episodes_are_refused(fakes):
    assert find_wrong(WRONG_STAGES, lambda key, value: fakes.make_stage(**{key: value})) == []
    assert find_wrong(WRONG_EPISODES, lambda change: fakes.make_episode(**change)) == []


def test_affordance_may_touch_both_limits(fakes):
    limits = np.tile(np.float32([0.0, 1.0]), (2048, 1))
    assert fakes.make_stage(points_affordance_feature=limits).frame_count == 2


def test_a_truncated_file_is_refused(written):
    content = written.read_bytes()
    for share in (0.0, 0.01, 0.5, 0.99):
        written.write_bytes(content[: int(share * len(content))])
        with pytest.raises(CorruptEpisodeError, match=r"episode\.h5: not a whole HDF5 file"):
            read_episode(written)


def test_flipped_bits_are_noticed_everywhere(written, fakes):
    """A damaged byte is refused or, in unused room of the file, harmless; never other numbers."""
    content = bytearray(written.read_bytes())
    given = fakes.make_episode(1)
    rng = np.random.default_rng(0)
    refused = 0
    for position in rng.integers(0, len(content), 40):
        content[position] ^= 0xFF
        written.write_bytes(content)
        try:
            found = read_episode(written)
        except CorruptEpisodeError:
            refused += 1
        else:
            for a, b in zip(given.stages, found.stages, strict=True):
                for key in ARRAYS:
                    np.testing.assert_array_equal(getattr(b, key), getattr(a, key))
        content[position] ^= 0xFF
    assert refused > 30


def replace(file, name, **changes):
    """Put another data set in the place of one."""
    del file[name]
    file.create_dataset(name, **changes)


WRONG_FILES = (
    (lambda f: f.attrs.__setitem__("format_version", 2), "format_version must be 1; got 2"),
    (lambda f: f.attrs.__delitem__("task"), "missing .*'task'"),
    (lambda f: f["stage_1"].__delitem__("action"), "stage_1/action is missing"),
    (lambda f: f.__delitem__("stage_1"), "stage groups must be"),
    (lambda f: f["stage_1"].create_dataset("pickle", data=1), "unknown keys: .'pickle'"),
    (lambda f: f["stage_2/action"].__setitem__((0, 0), np.nan), "stage_2: action must be finite"),
    (lambda f: f["stage_1"].attrs.__setitem__("name", "other"), "stage_names must be"),
    (lambda f: f.attrs.__setitem__("randomisation", "[]"), "randomisation should be a valid"),
    (lambda f: f.attrs.__setitem__("randomisation", "{"), "EOF while parsing"),
    (lambda f: f.attrs.__setitem__("randomisation", "[" * 10**5), "recursion limit"),
    (lambda f: f.attrs.__setitem__("randomisation", '{"a": 1e999}'), "finite|out of range|number"),
    (lambda f: f.attrs.__setitem__("success", "False"),
        "success should be a valid boolean; got 'False'"),
    (lambda f: f.attrs.__setitem__("success", np.nan),
        "success should be a valid boolean; got nan"),
    (lambda f: f.attrs.__setitem__("format_version", 1.9), "format_version must be 1; got 1.9"),
    (lambda f: f.attrs.__setitem__("seed", "1"), "seed should be a valid integer; got '1'"),
    (lambda f: f.attrs.__setitem__("task", 3), "task should be a valid string; got 3"),
    (lambda f: replace(f, "stage_1/action", data=np.zeros((1, 60), np.float32)),
        r"action must have shape \(2, 60\)"),
    (lambda f: replace(f, "stage_1/image", shape=(2, 480, 640, 4), dtype="u1"),
        "image must have shape"),
    (lambda f: replace(f, "stage_1/image", shape=(10**6, 480, 640, 3), dtype="u1", chunks=True),
        "at most 4 GB"),
    (lambda f: f.create_dataset("extra/huge", shape=(10**12,), dtype="f4", chunks=True),
        "at most 4 GB"),
    (lambda f: f.__setitem__("extra", h5py.ExternalLink("other.h5", "/x")),
        "extra must be in the file itself"),
    (lambda f: f.__setitem__("extra/soft", h5py.SoftLink("/stage_1/action")),
        "extra/soft must be in the file"),
    (lambda f: f.create_dataset("extra/raw", shape=(4,), dtype="u1",
        external=[("/etc/passwd", 0, 4)]), "data of other files"),
    (lambda f: f.create_virtual_dataset("extra/v", h5py.VirtualLayout((2,), "f4")),
        "data of other files"),
    (lambda f: f["stage_1"].attrs.__setitem__("points", '{"cuff": {"xyz": "abc"}}'),
        "stage_1: points.cuff.xyz"),
    (lambda f: (f.__delitem__("stage_2"), f.create_dataset("stage_2", data=1)),
        "stage_2 must be a Group; got"),
    (lambda f: f.create_group("commands"), "commands must be a Dataset; got"),
)  # fmt: skip


def test_wrong_files_are_refused_with_their_fault(written):
    content = written.read_bytes()

    def read(edit):
        written.write_bytes(content)
        with h5py.File(written, "r+") as file:
            edit(file)
        read_episode(written)

    assert (
        find_wrong([(edit, rf"episode\.h5: .*({text})") for edit, text in WRONG_FILES], read) == []
    )


def test_a_file_that_cannot_be_read_now_is_not_called_damaged(written, monkeypatch):
    command = "import h5py, sys; f = h5py.File(sys.argv[1], 'r+'); print(1, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", command, written], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        other.stdout.readline()
        for read in (read_episode, read_previews):
            with pytest.raises(FileUnavailableError, match="read now: another process has locked"):
                read(written)
        other.communicate(b"\n")
    for code, reason in ((errno.EACCES, "permission denied"), (errno.EIO, "input/output error")):

        def fail(*_, code=code):
            raise OSError(code, "no")

        monkeypatch.setattr(h5py, "File", fail)
        with pytest.raises(FileUnavailableError, match=f"{written} cannot be read now: {reason}"):
            read_episode(written)


def test_a_missing_file_is_not_called_corrupt(tmp_path):
    with pytest.raises(FileNotFoundError, match="no episode file"):
        read_episode(tmp_path / "nothing.h5")


def test_a_failed_write_leaves_what_was_there(written, fakes, monkeypatch):
    before = written.read_bytes()
    monkeypatch.setattr("dgl_collect.episodes._write_fields", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        write_episode(written, fakes.make_episode(2))
    assert written.read_bytes() == before
    assert [path.name for path in written.parent.iterdir()] == ["episode.h5"]
