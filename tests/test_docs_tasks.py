"""The worked example of `docs/tasks.md` is checked, refused where it is wrong, and carried out."""

import copy
import dataclasses
import json
import re
import textwrap
from pathlib import Path

import gymnasium
import pytest

import dgl_tasks  # registers the environments
from dgl_assets import garment_ids, load_garment
from dgl_assets.props import make_prop
from dgl_collect.demonstration import (
    check_demonstration,
    load_demonstration,
    parse_demonstration,
)
from dgl_collect.errors import DemonstrationError
from dgl_collect.steps import STEPS, Demonstration, Stage
from dgl_tasks.declaration import SceneObject, Task
from dgl_tasks.scene_check import REACH

PAGE = (Path(__file__).parents[1] / "docs/tasks.md").read_text(encoding="utf-8")
SOURCE = "HangVest.json"


def find_blocks(language):
    """Code blocks of the worked example, without the indent of the list that they stand in."""
    section = re.split(r"^## ", PAGE.split("## Add a task with an object\n")[1], flags=re.M)[0]
    found = re.findall(rf"^( *)```{language}\n(.*?)^ *```", section, re.DOTALL | re.MULTILINE)
    return [textwrap.dedent(code) for _, code in found]


DECLARATION, SCRIPT = find_blocks("python")
(TEXT,) = find_blocks("json")


def declare():
    names: dict = {}
    exec(compile(DECLARATION, "docs/tasks.md, declaration", "exec"), names)
    return names["TASK"]


TASK = declare()


@pytest.fixture
def content():
    return json.loads(TEXT)


def make(task):
    return gymnasium.make("FoldTops-v1", task=task, obs_mode="none", render_backend="none")


def check(content, task=TASK):
    demonstration = parse_demonstration(content, source=SOURCE)
    check_demonstration(demonstration, task, source=SOURCE)
    return demonstration


# What the page shows ----------------------------------------------------------------------------


def test_the_example_is_a_task_with_an_object_that_is_not_there_yet():
    assert isinstance(TASK, Task)
    assert TASK.id not in dgl_tasks.task_ids()
    assert len(TASK.objects) == 1


def test_its_demonstration_fits_it(content):
    demonstration = check(content)
    marked = load_garment(demonstration.garment)
    assert marked.category == TASK.category
    assert demonstration.garment in garment_ids(TASK.category, "train")
    assert [stage.is_learned for stage in demonstration.stages] == [True]
    (bar,) = TASK.objects
    used = {formula for stage in content["stages"] for formula in stage["definitions"].values()}
    for place in ("target.x", "target.y", "target.z"):
        assert any(f"{bar.name}.{place}" in formula for formula in used)


def test_its_scene_is_built_and_the_object_stands_where_it_was_drawn():
    task = dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2))
    made = make(task)
    try:
        made.reset(seed=5)
        env = made.unwrapped
        (bar,) = TASK.objects
        low, high = bar.x_range
        assert low <= env.draws["bar_x"] <= high
        middle = env.get_frames()["bar"]["target"]
        assert middle == pytest.approx([env.draws["bar_x"], 0.9, 0.6], abs=1e-6)
        assert not env.judge().success
    finally:
        made.close()


def test_every_key_and_every_step_of_the_format_is_on_the_page():
    section = PAGE.split("### Demonstration\n")[1].split("\n## ")[0]
    rows = [re.findall(r"`(\w+)`", line) for line in section.splitlines() if line[:3] == "| `"]
    told = {word for row in rows for word in row} | set(re.findall(r"\*\*`(\w+)`", section))
    for kind in (Demonstration, Stage, *STEPS.values()):
        fields = {item.name for item in dataclasses.fields(kind)} - {"targets"}  # `left`, `right`
        assert fields <= told, kind.__name__
    assert set(STEPS) | {"format", "left", "right"} <= told


def test_the_table_of_tasks_names_all_of_them_with_their_stages_and_rules():
    table = PAGE.split("| task | objects |")[1].split("\n\n")[0]
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


# What is refused --------------------------------------------------------------------------------


def rename(content, old, new):
    return json.loads(json.dumps(content).replace(old, new))


def test_a_place_that_the_object_has_not_is_refused_by_its_stage_and_name(content):
    wrong = rename(content, "bar.target.z + 0.1", "bar.middle.z + 0.1")
    with pytest.raises(
        DemonstrationError,
        match=r"HangVest\.json: stage 'hang': formula 'bar\.middle\.z \+ 0\.1' .*'middle'.*"
        r"known: .*target",
    ):
        check(wrong)


def test_an_object_that_is_not_there_is_refused_with_the_names_there_are(content):
    wrong = rename(content, "bar.target", "rail.target")
    with pytest.raises(
        DemonstrationError, match=r"stage 'hang': .*unknown name 'rail'; known: .*bar, garment"
    ):
        check(wrong)


def test_the_example_without_its_object_is_refused(content):
    with pytest.raises(DemonstrationError, match="unknown name 'bar'"):
        check(content, dataclasses.replace(TASK, objects=()))


def test_a_point_that_is_not_marked_is_refused(content):
    wrong = copy.deepcopy(content)
    wrong["stages"][0]["grasp"]["left"] = "left_strap"
    with pytest.raises(
        DemonstrationError, match=r"stage 'hang': unknown points \['left_strap'\]; known: "
    ):
        check(wrong)


def test_a_rule_at_a_place_that_is_not_there_is_refused_as_the_environment_is_made():
    rule = dataclasses.replace(TASK.success, frame="bar.middle")
    with pytest.raises(
        ValueError,
        match=r"task HangVest-v1: 'bar\.middle': bar has no place 'middle'; it has .*'target'",
    ):
        make(dataclasses.replace(TASK, success=rule))
    rule = dataclasses.replace(TASK.success, frame="rail.target")
    with pytest.raises(ValueError, match=r"there is no object 'rail'; there are \['bar'\]"):
        make(dataclasses.replace(TASK, success=rule))


def test_a_start_at_a_place_that_is_not_there_is_refused():
    start = dataclasses.replace(TASK.start, on="bar.shelf")
    with pytest.raises(ValueError, match=r"'bar\.shelf': bar has no place 'shelf'"):
        make(dataclasses.replace(TASK, start=start))


def test_objects_that_may_overlap_are_refused():
    (bar,) = TASK.objects
    low, high = make_prop(bar.prop).extent
    beside = high[0] - low[0] + bar.x_range[1]  # they touch where both are drawn nearest
    for gap, is_refused in ((-0.01, True), (0.01, False)):
        other = dataclasses.replace(
            bar, name="rail", position=(beside + gap, *bar.position[1:]), x_range=(0.0, 0.1)
        )
        task = dataclasses.replace(TASK, objects=(bar, other))
        if is_refused:
            with pytest.raises(ValueError, match="objects 'bar' and 'rail' overlap, or may"):
                make(task)
        else:
            make(task).close()


def test_an_object_out_of_reach_is_refused():
    far = SceneObject(name="bar", prop="hanger", position=(0.0, 2.2, 0.0))
    with pytest.raises(
        ValueError,
        match=rf"target of object 'bar' must be within {REACH} m of a robot's base; "
        r"it may be 2\.36 m",
    ):
        make(dataclasses.replace(TASK, objects=(far,)))


# What it does -----------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.render
def test_the_script_hangs_a_top_over_the_bar(capsys):
    names: dict = {"TASK": TASK, "text": TEXT}
    exec(compile(SCRIPT, "docs/tasks.md, script", "exec"), names)
    result, recorder, runner = names["result"], names["recorder"], names["runner"]
    assert result.success, result.detail
    assert result.first_try.success or result.measurements["further_tries"] >= 1
    record = recorder.records["hang"]
    # the recorded steps: a hand pose, four moves and a release, all but the approach and the
    # retreat
    assert set(recorder.records) == {stage.name for stage in runner.demonstration.stages}
    assert 20 < record.frame_count < len(result.commands) // 5
    assert record.object_point_cloud.shape == (2048, 3)
    assert record.object_point_cloud[:, 2].min() > 0.5  # the bar, on its own
    on_ground, off_middle, *_ = result.verdict.criteria
    assert off_middle.value < 0.08
    assert on_ground.value == 0.0
    # what is believed is kept beside the truth
    assert result.beliefs["value"] == pytest.approx(on_ground.value, abs=0.02)
    assert "True" in capsys.readouterr().out
