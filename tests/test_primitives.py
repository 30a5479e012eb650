"""Primitives from episode files: what they learn, which files they take, and the verb."""

import copy
import importlib
import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from dexgarmentlab import cli
from dexgarmentlab.learned_methods import METHODS
from dexgarmentlab.primitives import PrimitiveSkill, load_skill
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_collect import write_episode
from dgl_collect.demonstration import FOLDER, load_demonstration
from dgl_collect.errors import DemonstrationError
from dgl_collect.evaluation.methods import check_method
from dgl_collect.names import list_anchors, name_scene
from dgl_collect.options import EvaluationOptions, RunOptions
from dgl_sadp import CheckpointError
from dgl_sadp.primitive_file import PRIMITIVES_FILE, find_primitives, load_primitives
from dgl_tasks import get_task, task_ids
from dgl_tasks.grasps import GRASP_ORIENTATIONS
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.objects import compute_frames

TASKS = task_ids()
"""Before any other test makes a task of its own known."""
TASK = get_task("HangCoat-v1")
DEMONSTRATION = load_demonstration(TASK.id)
OFFSET = np.array([0.0, -0.35, -0.2])
"""From the hook to the middle of the hands at the end [m]."""


def make_scene(rng):
    """Lapels, the coat's cloud, and the draws."""
    middle = np.array([*rng.uniform(-0.1, 0.1, 1), *rng.uniform(0.65, 0.75, 1), 0.01])
    half = rng.uniform(0.1, 0.14)
    aside = np.array([half, 0, 0])
    points = {"left_lapel": middle - aside, "right_lapel": middle + aside}
    cloud = middle + rng.uniform([-0.3, -0.5, 0], [0.3, 0.1, 0.02], (2048, 3))
    draws = {"hook_x": float(rng.uniform(-0.05, 0.05)), "hook_y": float(rng.uniform(1.0, 1.1))}
    return points, cloud.astype(np.float32), draws


def record(fakes, path, seed, *, motion):
    """Hang a coat: hands at the lapels, closed, go to either side of the hook, and open."""
    points, cloud, draws = make_scene(np.random.default_rng(seed))
    hook = compute_frames(TASK, draws)["hook"]["target"]
    half = (points["right_lapel"] - points["left_lapel"])[0] / 2
    begin = {"left": points["left_lapel"], "right": points["right_lapel"]}
    end = {s: hook + OFFSET + [x * half, 0, 0] for s, x in zip(SIDES, (-1, 1), strict=True)}
    standard = GRASP_ORIENTATIONS["standard"]
    motion.reset(DEFAULT_ROBOT.compute_start("open"))
    motion.reach(begin, standard)
    start = motion.target.copy()
    rows = [motion.set_hands(dict.fromkeys(SIDES, "close")), motion.move(end, standard),
            motion.set_hands(dict.fromkeys(SIDES, "open"))]  # fmt: skip
    actions = np.concatenate(rows)[4::5].astype(np.float32)
    states = np.concatenate([start[None], actions[:-1]]).astype(np.float32)
    frames = len(actions)
    images = np.zeros((frames, 480, 640, 3), np.uint8)
    stage = fakes.make_stage(
        seed, frames=frames, name="hang", joint_state=states, action=actions, image=images,
        garment_point_cloud=cloud, points={n: {"xyz": p.tolist()} for n, p in points.items()},
    )  # fmt: skip
    write_episode(
        path, fakes.make_episode(seed, task=TASK.id, stages=(stage,), randomisation=draws)
    )


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    """A folder of six episodes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[1] / "packages/dgl-collect/tests"))
        fakes = importlib.import_module("dgl_collect_fakes")
    folder, motion = tmp_path_factory.mktemp("episodes"), BimanualMotion(TASK)
    for seed in range(6):
        record(fakes, folder / f"{seed}.h5", seed, motion=motion)
    return folder


@pytest.fixture(scope="module")
def trained(episodes, tmp_path_factory):
    out = tmp_path_factory.mktemp("run")
    assert cli.main(["train", "primitive", "--data", str(episodes), "--out", str(out)]) == 0
    return out


def make_options(trained=None, policy="primitive", **changes):
    return EvaluationOptions(policy=policy, checkpoints=trained, **changes)


def test_six_episodes_teach_the_way_to_any_hook(trained):
    primitives = load_primitives(trained / PRIMITIVES_FILE)
    assert (primitives.task, list(primitives.stages)) == (TASK.id, ["hang"])
    assert primitives.card["episodes"] == [f"{k}.h5" for k in range(6)]
    assert primitives.card["error_cm"]["hang"] < 2
    skill = PrimitiveSkill(primitives=primitives)
    for seed in range(100, 105):
        points, cloud, draws = make_scene(np.random.default_rng(seed))
        frames = compute_frames(TASK, draws)
        starts = {"left": points["left_lapel"], "right": points["right_lapel"]}
        ways = skill.plan("hang", starts, list_anchors(name_scene(cloud, frames, points))).hands
        half = (points["right_lapel"] - points["left_lapel"])[0] / 2
        for side, x in zip(SIDES, (-1, 1), strict=True):
            end = frames["hook"]["target"] + OFFSET + [x * half, 0, 0]
            assert ways[side].points[-1] == pytest.approx(end, abs=0.02)
            assert ways[side].poses.max(axis=0) == pytest.approx([1, 0, 0, 0, 0], abs=0.02)
            assert np.abs(ways[side].turns).max() < 0.01
    blind = PrimitiveSkill(primitives=primitives, is_blind=True)
    moved = []
    for shift in (np.zeros(3), np.array([0.1, 0, 0])):
        way = blind.plan("hang", {side: p + shift for side, p in starts.items()}, {})
        moved.append(way.hands["left"].points[-1])
    assert moved[1] - moved[0] == pytest.approx([0.1, 0, 0])


def test_methods_take_fitting_primitives_alone(trained, tmp_path, capsys):
    check_method(TASK, make_options(trained), METHODS)
    check_method(TASK, make_options(trained / PRIMITIVES_FILE, policy="blind"), METHODS)
    with pytest.raises(ValueError, match="it must be of task HangTops-v1; got HangCoat-v1"):
        check_method(get_task("HangTops-v1"), make_options(trained), METHODS)
    with pytest.raises(CheckpointError, match="cannot be read as a file of primitives"):
        check_method(TASK, make_options(tmp_path), METHODS)


def test_episodes_that_do_not_fit_are_refused(episodes, trained, tmp_path, capsys):
    def train(*arguments):
        code = cli.main(["train", "primitive", "--out", str(tmp_path / "out"), *arguments])
        assert not (tmp_path / "out").exists()
        return code, capsys.readouterr().err

    few = tmp_path / "few"
    few.mkdir()
    for arguments, message in (
        (["--data", str(few)], "--data must hold episodes (*.h5)"),
        (["--data", str(few / "none")], "--data must be a folder of episodes"),
        (["--data", str(episodes / "0.h5")], "--data must be a folder of episodes"),
        (["--data", str(episodes), "--episodes", "2"], "needs 3 recordings or more; got 2"),
        (["--data", str(episodes), "--episodes", "0"], "must be from 1 to 6, the number of"),
        (["--data", str(episodes), "--episodes", "99"], f"episodes in {episodes}; got 99"),
        (["--data", str(episodes), "--task", "HangTops-v1"], "must declare 'HangCoat-v1'"),
    ):
        code, told = train(*arguments)
        assert code != 0
        assert message in told

    def change(name, edit):
        folder = tmp_path / name
        shutil.copytree(episodes, folder)
        with h5py.File(folder / "1.h5", "r+") as opened:
            edit(opened)
        return str(folder)

    def damage(opened):
        opened["stage_1/action"][3, 5] = np.nan

    copies = tmp_path / "copies"
    shutil.copytree(episodes, copies)
    shutil.copy(copies / "0.h5", copies / "copy.h5")
    for folder, message in (
        (change("foreign", lambda file: file.attrs.update(robot="hexapod")), "1.h5: robot: "),
        (change("cut", lambda file: file.attrs.__delitem__("robot")), "1.h5: "),
        (change("failed", lambda file: file.attrs.update(success=False)), "1.h5: it must be of a"),
        (change("damaged", damage), "1.h5: stage_1 must hold finite numbers"),
        (str(copies), "copy.h5 must be another episode than"),
    ):
        code, told = train("--data", folder)
        assert code != 0
        assert message in told.replace("\n", "")
    file = tmp_path / "file"
    file.touch()
    for folder, message in (
        (trained, "has primitives already"),
        (file, "is a file"),
        (file / "out", f"cannot write to {file / 'out'}: Not a directory"),
    ):
        assert cli.main(["train", "primitive", "--data", str(episodes), "--out", str(folder)]) != 0
        assert message in capsys.readouterr().err
    for k in range(4):
        shutil.copy(episodes / f"{k}.h5", few)
    (few / "2.h5").write_bytes((few / "2.h5").read_bytes()[:5000])
    code, told = train("--data", str(few))
    assert code != 0
    assert "2.h5" in told


def test_a_demonstration_of_recordings_gives_their_skill(episodes, trained, tmp_path):
    content = json.loads((FOLDER / "HangCoat.json").read_text())
    stage = content["stages"][0]
    del stage["definitions"]
    steps = {step["step"]: step for step in stage["steps"]}
    stage["steps"] = [steps["approach"], {"step": "follow"}, steps["retreat"]]
    file = tmp_path / "mine.json"
    ends = []
    run = tmp_path / "run"
    shutil.copytree(episodes, run / "episodes")
    for recordings in (episodes, run, trained, trained / PRIMITIVES_FILE):
        file.write_text(json.dumps(content | {"recordings": str(recordings)}))
        demonstration = load_demonstration(TASK, file)
        skill = load_skill(TASK, demonstration, RunOptions())
        points, cloud, draws = make_scene(np.random.default_rng(100))
        anchors = list_anchors(name_scene(cloud, compute_frames(TASK, draws), points))
        starts = {"left": points["left_lapel"], "right": points["right_lapel"]}
        ends.append(skill.plan("hang", starts, anchors).hands["left"].points[-1])
    assert ends[0] == pytest.approx(ends[2], abs=1e-4)
    assert ends[1] == pytest.approx(ends[0])
    assert ends[2] == pytest.approx(ends[3])
    shutil.copytree(episodes, tmp_path / "beside")  # relative to the demonstration's file
    file.write_text(json.dumps(content | {"recordings": "beside"}))
    load_skill(TASK, load_demonstration(TASK, file), RunOptions())
    one_armed = copy.deepcopy(content)
    one_armed["stages"][0]["grasp"].pop("right")
    file.write_text(json.dumps(one_armed | {"recordings": "beside"}))
    with pytest.raises(DemonstrationError, match=r"'hang': the right hand must rest.*it moves by"):
        load_skill(TASK, load_demonstration(TASK, file), RunOptions())
    for recordings, message in (("nowhere", "recordings: .*nowhere"), (None, "need the field")):
        file.write_text(json.dumps(content | ({"recordings": recordings} if recordings else {})))
        with pytest.raises(DemonstrationError, match=message):
            load_skill(TASK, load_demonstration(TASK, file), RunOptions())


def test_every_task_has_primitives_that_fit_its_demonstration():
    for name in TASKS:
        task, demonstration = get_task(name), load_demonstration(name)
        check_method(task, make_options(), METHODS)
        primitives = load_primitives(find_primitives(name))
        draws = {f"{item.name}_{axis}": 0.0 for item in task.objects for axis in "xy"}
        known = list_anchors(
            name_scene(np.zeros((1, 3)), compute_frames(task, draws), demonstration.points)
        )
        for stage, primitive in primitives.stages.items():
            assert set(primitive.anchors) <= set(known), (name, stage)
        assert set(primitives.card["error_cm"]) == set(primitives.stages)
        assert 5 <= len(primitives.card["episodes"]) <= 10
