"""Episodes in the formats of other projects."""

import dataclasses
import json
import threading
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import zarr

from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_collect import NotReplayableError, OutputFolderError, read_episode, write_episode
from dgl_collect.exporting import ExportOptions, export_episodes
from dgl_collect.exporting.frames import find_work, make_frames
from dgl_collect.exporting.origins import Origin, Origins, read_origins
from dgl_collect.exporting.trajectory import Trajectory, read_trajectory, write_trajectory
from dgl_collect.exporting.writers import get_writer
from dgl_tasks import get_task
from dgl_tasks.hand_span import HandPoseActions

CAMERAS = ("video_camera", "left_wrist_camera")
SOURCE = Origins(task="FoldTops-v1", robot="ur10e+shadow", cloud="segmented", look="studio")


def make_trajectory(seed=0, frames=4, **changes):
    rng = np.random.default_rng(seed)
    content = {
        "instruction": "Fold it.",
        "success": True,
        "seed": seed,
        "garment": "tops/1",
        "names": ("a", "b", "c"),
        "state": rng.random((frames, 3), np.float32),
        "action": rng.random((frames, 3), np.float32),
        "ee_pose": rng.random((frames, 2, 7), np.float32),
        "place_names": ("cuff.x", "cuff.y", "cuff.z"),
        "places": rng.random(3, np.float32),
        "cloud": rng.random((frames, 2048, 6), np.float32),
        "images": {name: rng.integers(0, 255, (frames, 24, 32, 3), np.uint8) for name in CAMERAS},
    }
    return Trajectory(**(content | changes))


def assert_equal(one, other):
    assert (one.instruction, one.success, one.names, one.place_names) == (
        other.instruction, other.success, other.names, other.place_names,
    )  # fmt: skip
    for name in ("state", "action", "ee_pose", "places", "cloud"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert one.images.keys() == other.images.keys()
    for name, images in one.images.items():
        np.testing.assert_array_equal(images, other.images[name])


def test_frames_survive_their_file(tmp_path):
    for number, wanted in enumerate((make_trajectory(), make_trajectory(cloud=None, images={}))):
        write_trajectory(tmp_path / f"{number}.h5", wanted)
        assert_equal(read_trajectory(tmp_path / f"{number}.h5"), wanted)


@pytest.mark.render
def test_a_whole_episode_is_replayed_from_the_parked_arms_on(recorded, attempts):
    episode, setup = read_episode(recorded), attempts._setup
    options = ExportOptions(cameras=CAMERAS, size=(64, 48), cloud=True, matcher="exact")
    ((name, frames),) = make_frames(episode, options, setup)
    robot = setup.motion.robot
    rows = episode.commands[episode.stages[0].first_step - 3 :]
    begin, end = find_work(rows, robot)
    assert begin == 10  # its arms rest in the first two frames
    assert (name, len(frames)) == ("", (end - begin) // 5) == ("", 4)
    np.testing.assert_array_equal(frames.action, rows[begin:end][4::5][:4])
    for side in ("left", "right"):
        arm = robot.joint_slice(side, "arm")
        np.testing.assert_allclose(frames.state[0, arm], robot.arm.parked[side], atol=0.01)
    assert frames.names == robot.joint_names
    assert frames.images["left_wrist_camera"].shape == (4, 48, 64, 3)
    assert frames.images["video_camera"].std() > 10
    assert frames.cloud.shape == (4, 2048, 6)
    places = dict(zip(frames.place_names, frames.places, strict=True))
    assert places["hanger.target.z"] == pytest.approx(setup.env.get_frames()["hanger"]["target"][2])
    assert places["left_waistband.x"] < places["right_waistband.x"]
    assert not frames.success
    short = dataclasses.replace(options, control_mode="pd_hand_poses", cameras=(), cloud=False)
    ((_, fewer),) = make_frames(episode, short, setup)
    np.testing.assert_array_equal(
        fewer.action, HandPoseActions(robot).from_joints(frames.action).astype(np.float32)
    )
    assert fewer.names == HandPoseActions(robot).names
    grasped = dataclasses.replace(short, content="grasped")
    ((_, later),) = make_frames(episode, grasped, setup)
    rows = episode.commands[episode.stages[0].first_step :]
    np.testing.assert_array_equal(
        later.action, HandPoseActions(robot).from_joints(rows[4::5]).astype(np.float32)
    )
    np.testing.assert_array_equal(later.places, fewer.places)
    other = dataclasses.replace(episode, success=True)
    with pytest.raises(NotReplayableError, match="another verdict"):
        list(make_frames(other, short, setup))


def make_commands(*parts):
    """Joint targets of a way: rest, work, way back, rest; numbers of control steps of each."""
    rest, work, back, end = parts
    parked = DEFAULT_ROBOT.compute_start("open")
    for side in SIDES:
        parked[DEFAULT_ROBOT.joint_slice(side, "arm")] = DEFAULT_ROBOT.arm.parked[side]
    turned = parked + np.outer(np.sin(np.linspace(0, 2, work + 1)[1:]), np.linspace(0, 1, 60))
    turned[-1, 0] += 0.3  # it ends beside the line from the parked arms
    way = turned[-1] + np.linspace(0, 1, back + 1)[1:, None] ** 2 * (parked - turned[-1])
    return np.concatenate([np.tile(parked, (rest, 1)), turned, way, np.tile(parked, (end, 1))])


def test_rest_and_the_way_back_are_no_work():
    for rest, back, end in ((12, 40, 200), (7, 33, 60), (1, 25, 5)):
        found = find_work(make_commands(rest, 50, back, end), DEFAULT_ROBOT)
        begin, last = found
        assert begin == (rest - 1) // 5 * 5
        assert rest + 50 - 1 <= last <= rest + 50 + 5
        assert last % 5 == 0
    moving = make_commands(12, 50, 1, 1)[:62]  # ends away from the parked arms
    assert find_work(moving, DEFAULT_ROBOT) == (10, 62)
    still = np.tile(moving[0], (30, 1))
    assert find_work(still, DEFAULT_ROBOT) == (0, 30)


def test_stages_are_exported_as_they_were_recorded(fakes):
    episode, robot = fakes.make_episode(), DEFAULT_ROBOT
    env = SimpleNamespace(task=get_task("FoldTops-v1"))
    setup = SimpleNamespace(env=env, motion=SimpleNamespace(robot=robot))
    options = ExportOptions(content="stages", size=(32, 24))
    found = dict(make_frames(episode, options, setup))
    assert list(found) == ["left_sleeve", "right_sleeve"]
    stage, frames = episode.stages[1], found["right_sleeve"]
    np.testing.assert_array_equal(frames.state, stage.joint_state)
    np.testing.assert_array_equal(frames.action, stage.action)
    assert frames.images["environment_camera"].shape == (3, 24, 32, 3)
    assert frames.instruction.endswith("Stage: right_sleeve.")
    assert frames.place_names == ("left cuff.x", "left cuff.y", "left cuff.z")
    with pytest.raises(ValueError, match="stages hold pictures of the environment_camera alone"):
        ExportOptions(content="stages", cameras=("video_camera",))


def test_zarr_holds_the_replay_buffer_of_diffusion_policy(tmp_path):
    made = [make_trajectory(0), make_trajectory(1, frames=3)]
    get_writer("zarr")(tmp_path / "z", iter(made), SOURCE)
    root = zarr.open(str(tmp_path / "z"), mode="r")
    assert root["meta/episode_ends"][:].tolist() == [4, 7]
    for name, key in (("state", "state"), ("action", "action"), ("point_cloud", "cloud")):
        wanted = np.concatenate([getattr(each, key) for each in made])
        np.testing.assert_array_equal(root[f"data/{name}"][:], wanted)
    wanted = np.concatenate([each.images["video_camera"] for each in made])
    np.testing.assert_array_equal(root["data/img_video_camera"][:], wanted)
    assert json.loads((tmp_path / "z/.zgroup").read_text()) == {"zarr_format": 2}


def test_robomimic_files_have_its_groups_and_attributes(tmp_path):
    made = [make_trajectory(0, cloud=None), make_trajectory(1, frames=3, cloud=None, success=False)]
    get_writer("robomimic")(tmp_path / "r.hdf5", iter(made), SOURCE)
    with h5py.File(tmp_path / "r.hdf5") as file:
        data = file["data"]
        assert data.attrs["total"] == 7
        assert json.loads(data.attrs["env_args"])["env_name"] == "FoldTops-v1"
        assert sorted(data) == ["demo_0", "demo_1"]
        first, second = data["demo_0"], data["demo_1"]
        np.testing.assert_array_equal(first["actions"][:], made[0].action)
        np.testing.assert_array_equal(first["obs/state"][:], made[0].state)
        np.testing.assert_array_equal(first["next_obs/state"][:3], made[0].state[1:])
        assert first["dones"][:].tolist() == [0, 0, 0, 1]
        assert first["rewards"][:].tolist() == [0, 0, 0, 1]
        assert second["rewards"][:].tolist() == [0, 0, 0]
        assert second.attrs["num_samples"] == 3


def test_robomimic_reads_its_files(tmp_path):
    obs_utils = pytest.importorskip("robomimic.utils.obs_utils")
    dataset = pytest.importorskip("robomimic.utils.dataset")
    made = [make_trajectory(0, cloud=None), make_trajectory(1, frames=3, cloud=None)]
    get_writer("robomimic")(tmp_path / "r.hdf5", iter(made), SOURCE)
    obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": ["state"]}})
    sequences = dataset.SequenceDataset(
        str(tmp_path / "r.hdf5"),
        obs_keys=["state"],
        dataset_keys=["actions", "rewards", "dones"],
        seq_length=2,
        load_next_obs=True,
    )
    assert len(sequences) == 4 + 3
    assert sequences.n_demos == 2
    window = sequences[1]
    np.testing.assert_array_equal(window["actions"], made[0].action[1:3])
    np.testing.assert_array_equal(window["obs"]["state"], made[0].state[1:3])
    np.testing.assert_array_equal(window["next_obs"]["state"], made[0].state[2:4])
    np.testing.assert_array_equal(sequences[4]["obs"]["state"], made[1].state[:2])
    assert sequences[2]["dones"].tolist() == [0, 1]


@pytest.fixture
def run(fakes, monkeypatch, tmp_path):
    """Exports episodes in this process; a replay gives frames drawn with the episode's seed."""
    fakes.work_here(monkeypatch)
    replayed = []

    def make(episode, options, setup):
        del options, setup
        replayed.append(episode.seed)
        if episode.seed == 2:
            raise NotReplayableError("another verdict")
        yield "", make_trajectory(episode.seed, frames=3 + episode.seed, cloud=None)

    patched = "dgl_collect.exporting.export."
    monkeypatch.setattr(f"{patched}make_frames", make)
    env = SimpleNamespace(close=lambda: None)
    monkeypatch.setattr(f"{patched}make_setup", lambda *_: SimpleNamespace(env=env))
    files = [write_episode(tmp_path / f"e{seed}.h5", fakes.make_episode(seed)) for seed in range(4)]

    def go(out="z", *, stop=None, options=None, **settings):
        return export_episodes(
            files,
            tmp_path / out,
            get_writer("zarr"),
            options or ExportOptions(),
            format_name="zarr",
            stop=stop,
            **settings,
        )

    return SimpleNamespace(go=go, files=files, replayed=replayed, folder=tmp_path)


def test_episodes_keep_their_order_and_those_that_fail_are_left_out(run):
    exported = run.go()
    assert (exported.episodes, exported.frames) == (3, 3 + 4 + 6)
    assert exported.left_out == {"e2": "another verdict"}
    root = zarr.open(str(run.folder / "z"), mode="r")
    assert root["meta/episode_ends"][:].tolist() == [3, 7, 13]
    np.testing.assert_array_equal(root["data/action"][:3], make_trajectory(0, frames=3).action)
    origins = read_origins(run.folder / "z")
    assert (origins.task, origins.control_mode) == ("FoldTops-v1", "pd_joint_pos")
    assert origins.episodes == tuple(
        Origin(seed=seed, garment="tops/1", success=True) for seed in (0, 1, 3)
    )
    with pytest.raises(ValueError, match=r"holds no data set of dgl export"):
        read_origins(run.folder)
    assert not (run.folder / "z.part").exists()
    with pytest.raises(OutputFolderError, match="is there already"):
        run.go()


def test_an_interrupted_export_goes_on_where_it_was(run):
    stop = threading.Event()
    assert run.go(stop=stop, on_episode=lambda: len(run.replayed) == 2 and stop.set()) is None
    assert not (run.folder / "z").exists()
    with pytest.raises(OutputFolderError, match="unfinished export; add --resume"):
        run.go()
    with pytest.raises(OutputFolderError, match=r"cannot resume .*control_mode"):
        run.go(resume=True, options=ExportOptions(control_mode="pd_hand_poses"))
    seen = []
    exported = run.go(resume=True, on_episode=lambda: seen.append(1))
    assert exported.episodes == 3
    assert len(seen) == 4  # those of the earlier run, too
    assert run.replayed == [0, 1, 2, 3]


def test_episodes_must_be_of_one_kind(run, fakes, tmp_path):
    other = write_episode(tmp_path / "other.h5", fakes.make_episode(9, task="FoldDress-v1"))
    run.files.append(other)
    with pytest.raises(ValueError, match=r"one task; got FoldTops-v1 \(e0.h5\) and FoldDress-v1"):
        run.go()
    run.files[:] = []
    with pytest.raises(ValueError, match="at least one episode"):
        run.go()
