"""The pages `tasks.md` and `add_a_task.md`: their tables are complete, their examples run."""

import copy
import dataclasses
import json
import re
import runpy
import shutil
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import dgl_tasks  # registers the environments
from dexgarmentlab.cli import main
from dgl_assets import load_garment
from dgl_assets.props import make_prop
from dgl_assets.robots import HAND_POSES
from dgl_collect.demonstration import (
    check_demonstration,
    load_demonstration,
    parse_demonstration,
)
from dgl_collect.errors import DemonstrationError
from dgl_collect.steps import STEPS, Demonstration, Stage
from dgl_tasks import success
from dgl_tasks.declaration import SceneObject, Start, Task
from dgl_tasks.scene_check import REACH

DOCS = Path(__file__).parents[1] / "docs"
TASKS = (DOCS / "tasks.md").read_text(encoding="utf-8")
PAGE = (DOCS / "add_a_task.md").read_text(encoding="utf-8")
EXAMPLES = ("fold_scarf", "hang_vest")
RULES = ("ShareInBox", "CoversFlatArea", "HangsOver", "RestsOn", "SitsOn")


def read_example(name):
    task = runpy.run_path(str(DOCS / f"examples/{name}.py"))["TASK"]
    return task, json.loads((DOCS / f"examples/{name}.json").read_text(encoding="utf-8"))


def check(content, task):
    check_demonstration(parse_demonstration(content, source="it"), task, source="it")


TASK, HANG = read_example("hang_vest")
(BAR,) = TASK.objects


# Tables ------------------------------------------------------------------------------------------


def find_words(section):
    """Words in code format in the tables of a section."""
    lines = re.split(r"^## ", PAGE.split(f"\n## {section}\n")[1], flags=re.MULTILINE)[
        0
    ].splitlines()
    return set(re.findall(r"`\"?(\w+)", " ".join(line for line in lines if line[:1] == "|")))


def get_names(kind):
    return {item.name for item in dataclasses.fields(kind) if item.init}


def test_the_page_has_every_field_of_a_declaration():
    wanted = get_names(Task) | get_names(SceneObject) | get_names(Start) | set(RULES)
    for rule in RULES:
        wanted |= get_names(getattr(success, rule))
    assert sorted(wanted - find_words("Declaration")) == []


def test_the_page_has_every_key_of_a_demonstration():
    wanted = {"format", "left", "right", "recorded", *STEPS}
    for task_id in dgl_tasks.task_ids():
        for stage in load_demonstration(task_id).stages:
            given = (getattr(step, "orientation", None) for step in stage.steps)
            wanted |= {name for name in given if isinstance(name, str)}
    for kind in (Demonstration, Stage, *STEPS.values()):
        wanted |= get_names(kind) - {"targets"}  # written as `left` and `right`
    section = PAGE.split("\n## Demonstration\n")[1]
    words = find_words("Demonstration") | set(re.findall(r"`(\w+)`", section))
    assert sorted(wanted - words) == []


def test_the_picture_of_hand_poses_names_all_of_them():
    assert f"Hand poses: {', '.join(HAND_POSES)}]" in PAGE


def test_the_table_of_tasks_names_all_of_them_with_their_stages_and_rules():
    table = TASKS.split("| task | objects |")[1].split("\n\n")[0]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]
    shown = {title: row[1:] for row in rows for title in row[0].split(", ")}
    tasks = {dgl_tasks.get_task(task_id).title: task_id for task_id in dgl_tasks.task_ids()}
    assert set(shown) == set(tasks)
    for title, (objects, stages, rounds, rule) in shown.items():
        task, demonstration = dgl_tasks.get_task(tasks[title]), load_demonstration(tasks[title])
        assert objects == ", ".join(item.name for item in task.objects)
        assert re.findall(r"`(\w+)`", stages) == [stage.name for stage in demonstration.stages]
        assert int(rounds) == demonstration.rounds
        assert type(task.success).__name__ in rule


# Examples ----------------------------------------------------------------------------------------


def test_the_page_shows_the_files_of_the_fold():
    shown = re.findall(r"```(?:python|json)\n(.*?)```", PAGE, re.DOTALL)
    files = [DOCS / f"examples/fold_scarf.{end}" for end in ("py", "json")]
    assert shown == [file.read_text(encoding="utf-8") for file in files]


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_is_a_new_task_whose_demonstration_fits(name):
    task, content = read_example(name)
    assert task.id not in dgl_tasks.task_ids()
    check(content, task)
    garment = load_garment(content["garment"])
    for landmark, position in content["points"].items():
        if landmark in garment.landmarks:
            marked = garment.vertices[garment.landmarks[landmark]]
            assert np.linalg.norm(marked - position) < 0.05, landmark


def test_the_hang_begins_with_its_bar_where_it_was_drawn(coarse_garments):
    task = dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2))
    made = gymnasium.make("FoldTops-v1", task=task, obs_mode="none", render_backend="none")
    try:
        made.reset(seed=5)
        env = made.unwrapped
        low, high = BAR.x_range
        assert low <= env.draws["bar_x"] <= high
        middle = env.get_frames()["bar"]["target"]
        assert middle == pytest.approx([env.draws["bar_x"], 0.9, 0.6], abs=1e-6)
        assert not env.judge().success
    finally:
        made.close()


# Mistakes ----------------------------------------------------------------------------------------


def test_mistakes_in_the_demonstration_are_told():
    text = json.dumps(HANG)
    no_point = copy.deepcopy(HANG)
    no_point["stages"][0]["grasp"]["left"] = "left_strap"
    cases = {
        r"stage 'hang': formula 'bar\.middle\.z \+ 0\.1' .*'middle'.*known: .*target": (
            json.loads(text.replace("bar.target.z + 0.1", "bar.middle.z + 0.1")),
            TASK,
        ),
        r"stage 'hang': .*unknown name 'rail'; known: .*bar, garment": (
            json.loads(text.replace("bar.target", "rail.target")),
            TASK,
        ),
        r"unknown name 'bar'": (HANG, dataclasses.replace(TASK, objects=())),
        r"stage 'hang': unknown points \['left_strap'\]; known: ": (no_point, TASK),
    }
    for message, (content, task) in cases.items():
        with pytest.raises(DemonstrationError, match=message):
            check(content, task)


def test_mistakes_in_the_declaration_are_told():
    low, high = make_prop(BAR.prop).extent
    touching = high[0] - low[0] + BAR.x_range[1]  # where both are drawn nearest

    def beside(gap):
        position = (touching + gap, *BAR.position[1:])
        return dataclasses.replace(BAR, name="rail", position=position, x_range=(0.0, 0.1))

    far = SceneObject(name="bar", prop="hanger", position=(0.0, 2.2, 0.0))
    middle = dataclasses.replace(TASK.success, frame="bar.middle")
    rail = dataclasses.replace(TASK.success, frame="rail.target")
    shelf = dataclasses.replace(TASK.start, on="bar.shelf")
    cases: dict[str, dict[str, object]] = {
        r"task HangVest-v1: 'bar\.middle': bar has no \w+ 'middle'; it has .*'target'": {
            "success": middle
        },
        r"there is no object 'rail'; there are \['bar'\]": {"success": rail},
        r"'bar\.shelf': bar has no \w+ 'shelf'": {"start": shelf},
        "objects 'bar' and 'rail' overlap, or may": {"objects": (BAR, beside(-0.01))},
        rf"'bar' must be within {REACH} m of a robot's base; it may be 2\.36 m": {
            "objects": (far,)
        },
    }
    for message, wrong in cases.items():
        with pytest.raises(ValueError, match=message):
            make(dataclasses.replace(TASK, **wrong))  # pyright: ignore[reportArgumentType]
    make(dataclasses.replace(TASK, objects=(BAR, beside(0.01)))).close()


def make(task):
    return gymnasium.make("FoldTops-v1", task=task, obs_mode="none", render_backend="none")


# From outside ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.render
@pytest.mark.parametrize("name", EXAMPLES)
def test_dgl_collects_an_example_from_a_folder_of_its_own(
    name, tmp_path, monkeypatch, fine_garments
):
    for end in ("py", "json"):
        shutil.copy(DOCS / f"examples/{name}.{end}", tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["collect", f"{name}.py", "--episodes", "1", "--seed", "1", "--out", "out"]) == 0
    summary = json.loads((tmp_path / "out/summary.json").read_text(encoding="utf-8"))
    assert summary["task"] == read_example(name)[0].id
    assert summary["succeeded"] == 1
    if name == EXAMPLES[0]:
        (episode,) = (tmp_path / "out/episodes").glob("*.h5")
        assert main(["replay", str(episode), "--task", f"{name}.py"]) == 0
