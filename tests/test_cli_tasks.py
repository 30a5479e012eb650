"""The verb `tasks`."""

import dataclasses
import json

from dexgarmentlab.cli import main
from dgl_collect import DemonstrationError
from dgl_collect.demonstration import load_demonstration
from dgl_tasks import get_task, task_ids
from dgl_tasks import tasks as tasks_module


def test_every_task_is_described_as_it_is_declared(capsys):
    assert main(["tasks", "--json"]) == 0
    tasks = json.loads(capsys.readouterr().out)["tasks"]
    assert [task["id"] for task in tasks] == list(task_ids())
    for shown in tasks:
        task = get_task(shown["id"])
        assert shown["category"] == task.category
        stages = load_demonstration(task.id).stages
        assert [stage["name"] for stage in shown["stages"]] == [s.name for s in stages]
        for stage, declared in zip(shown["stages"], stages, strict=True):
            assert set(stage["grasp"]) == set(declared.grasp)
            taken = declared.approach.orientation
            told = taken if isinstance(taken, str) else dataclasses.asdict(taken)
            assert stage["orientation"] == told
            assert stage["learned"] == declared.is_learned
        assert [item["name"] for item in shown["objects"]] == [o.name for o in task.objects]
        assert shown["lacks"] is None
        assert shown["success"] == task.success_text
        assert shown["robot_bases"] == {
            "left": list(task.left_base),
            "right": list(task.right_base),
        }


def test_the_text_says_what_is_done_where_and_what_counts(capsys):
    assert main(["tasks"]) == 0
    text = capsys.readouterr().out
    assert "FoldTops-v1  Fold Tops" in text
    assert "Tops_LongSleeve, 8,000 for training, 2,000 for testing" in text
    assert "x -0.1 to 0.1 m, y 0.7 to 0.9 m" in text
    assert "3. bottom_up: left hand at left_hem, right hand at right_hem" in text
    assert "at least 85 %" in text
    assert "left (-0.8, 0, 0.5) m, yaw 0 rad; right (0.8, 0, 0.5) m, yaw 0 rad" in text


def test_a_task_without_a_demonstration_is_listed_with_what_it_lacks(monkeypatch, capsys):
    def load(task):
        if task.id == "FoldTops-v1":
            raise DemonstrationError("there is no demonstration of 'FoldTops-v1'")
        return load_demonstration(task)

    monkeypatch.setattr("dgl_collect.demonstration.load_demonstration", load)
    assert main(["tasks"]) == 0
    text = capsys.readouterr().out
    assert "stages    there is no demonstration of 'FoldTops-v1'" in text
    assert "FlingTops-v1  Fling Tops" in text


def test_where_objects_and_what_lies_on_them_may_be_is_told(capsys):
    assert main(["tasks"]) == 0
    text = capsys.readouterr().out
    assert "position  on stand.seat" in text
    assert "hanger (hanger), x -0.15 to 0.15 m, y 0.8 to 0.9 m" in text


def test_props_and_turns_that_are_drawn_are_told(monkeypatch, capsys):
    hang = get_task("HangTops-v1")
    bar = dataclasses.replace(hang.objects[0], prop=("hanger",) * 3, yaw_range=(-0.1, 0.2618))
    changed = dataclasses.replace(hang, objects=(bar,))
    monkeypatch.setitem(tasks_module._TASKS, hang.id, changed)
    assert main(["tasks", hang.id]) == 0
    told = "hanger (hanger, one of 3), x -0.15 to 0.15 m, y 0.8 to 0.9 m, yaw -5.7 to 15 degrees"
    assert told in capsys.readouterr().out


def test_an_option_that_is_not_there_is_a_usage_error(capsys):
    assert main(["tasks", "--category", "coats"]) == 2
    assert "--category" in capsys.readouterr().err
