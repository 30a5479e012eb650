"""Tasks by id, and that their declarations fit robots, garments and cameras."""

import importlib
import pickle
import re
from importlib.metadata import EntryPoint, EntryPoints
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets import garment_ids, list_categories, load_garment
from dgl_assets.props import make_prop
from dgl_tasks import tasks
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.errors import DeclarationError, UnknownTaskError
from dgl_tasks.success import Verdict, compute_covered_area
from dgl_tasks.views import TrueView

TASKS = [dgl_tasks.get_task(task_id) for task_id in dgl_tasks.task_ids()]
DECLARED = "from dgl_tasks import get_task\nfrom dgl_tasks.declaration import Task\nTASK = "
each_task = pytest.mark.parametrize("task", TASKS, ids=lambda task: task.id)


def test_the_ids_are_registered_with_gymnasium():
    assert "FoldTops-v1" in dgl_tasks.task_ids()
    for task_id in dgl_tasks.task_ids():
        assert gymnasium.spec(task_id).kwargs["task"] == task_id
        assert dgl_tasks.get_task(task_id).id == task_id


@pytest.mark.parametrize("wrong", ["FoldTop-v1", "foldtops", "Hang a coat"])
def test_an_unknown_id_names_the_closest_and_all(wrong):
    with pytest.raises(UnknownTaskError, match=f"unknown task {wrong!r}; did you mean") as caught:
        dgl_tasks.get_task(wrong)
    assert f"Known tasks: {', '.join(dgl_tasks.task_ids())}" in str(caught.value)
    assert isinstance(caught.value, dgl_tasks.TaskError)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("wrong", [3, None, ["FoldTops-v1"]])
def test_what_is_no_id_is_refused(wrong):
    with pytest.raises(ValueError, match=r"must be an id, such as .*, or a declaration.*; got"):
        dgl_tasks.get_task(wrong)
    with pytest.raises(ValueError, match="must be an id"):
        gymnasium.make("FoldTops-v1", task=wrong, render_backend="none")


def test_every_file_of_tasks_is_found_by_itself():
    files = list(Path(tasks.__file__).parent.glob("[!_]*.py"))
    assert len(dgl_tasks.task_ids()) == len(files)
    for path in files:
        declared = importlib.import_module(f"dgl_tasks.tasks.{path.stem}").TASK
        assert dgl_tasks.get_task(declared.id) is declared
        # the file is named like the task
        assert declared.id.removesuffix("-v1").lower() == path.stem.replace("_", "")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("vest_a", "TASK = ", "vest_a.py: SyntaxError: "),
        ("vest_b", "NAME = 1", "vest_b.py: AttributeError: .*'TASK'"),
        ("vest_c", DECLARED + "Task(colour='red')", "vest_c.py: TypeError: .*'colour'"),
        (
            "vest_d",
            DECLARED + "get_task('FoldTops-v1')",
            "another file declares 'FoldTops-v1', too",
        ),
    ],
)
def test_a_file_that_declares_no_new_task_is_named(tmp_path, monkeypatch, name, text, message):
    (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.setattr(tasks, "__path__", [*tasks.__path__, str(tmp_path)])
    with pytest.raises(DeclarationError, match=message):
        tasks._find_built_in()


# From outside ----------------------------------------------------------------------------------

SCARF = """
import dataclasses
from dgl_tasks import get_task

TASK = dataclasses.replace(get_task("FoldTops-v1"), id="FoldScarf-v1", title="Fold Scarf")
"""


@pytest.fixture
def forget(monkeypatch):
    """Let what a test registers be forgotten at its end."""
    for name in ("_TASKS", "_FILES"):
        monkeypatch.setattr(tasks, name, dict(getattr(tasks, name)))
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    monkeypatch.setattr(gymnasium, "registry", gymnasium.envs.registration.registry)


def test_a_task_comes_from_a_file_a_module_or_an_installed_package(tmp_path, monkeypatch, forget):
    file = tmp_path / "fold_scarf_outside.py"
    file.write_text(SCARF)
    monkeypatch.syspath_prepend(tmp_path)
    installed = EntryPoint("FoldScarf-v1", file.stem, tasks.GROUP)
    sources = (str(file), file.stem, "FoldScarf-v1")
    for source in sources:
        tasks._TASKS.pop("FoldScarf-v1", None)
        if source == "FoldScarf-v1":
            found = EntryPoints([installed])
            monkeypatch.setattr(tasks, "entry_points", lambda group, found=found: found)
            assert source in tasks.task_ids()
        task = tasks.load_task(source)
        assert (task.id, task.title) == ("FoldScarf-v1", "Fold Scarf")
        assert tasks.get_task("FoldScarf-v1") is tasks.load_task("FoldScarf-v1") is task
        assert gymnasium.spec("FoldScarf-v1").kwargs["task"] == "FoldScarf-v1"
        assert tasks.find_declaration("FoldScarf-v1") == file
        assert tasks.find_demonstration("FoldScarf-v1") == file.with_suffix(".json")
        assert pickle.loads(pickle.dumps(task)) == task
    assert tasks.find_demonstration("FoldTops-v1") is None
    file.write_text(SCARF.replace("Fold Scarf", "Another"))
    assert tasks.load_task(str(file)).title == "Another"


def test_an_environment_is_made_of_a_file_by_its_path_or_its_id(tmp_path, forget, coarse_garments):
    file = tmp_path / "fold_scarf.py"
    file.write_text(SCARF)
    options = {"obs_mode": "none", "reward_mode": "none", "render_backend": "none"}
    for task_id, task in (("FoldTops-v1", str(file)), ("FoldScarf-v1", "FoldScarf-v1")):
        made = gymnasium.make(task_id, task=task, **options)
        assert made.unwrapped.task.title == "Fold Scarf"
        made.close()


def test_a_task_from_outside_is_refused_in_one_line(tmp_path, forget):
    table = {
        "TASK = (": "SyntaxError",
        "1 / 0": "ZeroDivisionError: division by zero",
        "import sys; sys.exit(3)": "SystemExit: 3",
        "NAME = 1": "AttributeError: .*'TASK'",
        "TASK = 3": "TASK must be a `Task`; got 3",
        SCARF.replace("FoldScarf-v1", "FoldDress-v1"): "'FoldDress-v1' is that of a task of",
        SCARF.replace("FoldScarf-v1", "Fold Scarf"): "'Fold Scarf' must be a name and a version",
    }
    wrong = []
    for number, (text, message) in enumerate(table.items()):
        file = tmp_path / f"own_{number}.py"
        file.write_text(text)
        try:
            tasks.load_task(str(file))
            wrong.append((text, "taken"))
        except DeclarationError as err:
            if not re.match(f"{file.name}: .*{message}", str(err)) or "\n" in str(err):
                wrong.append((text, str(err)))
    assert wrong == []
    with pytest.raises(DeclarationError, match=r"there is no .*nowhere\.py"):
        tasks.load_task(str(tmp_path / "nowhere.py"))
    for source in ("no.such.module", "FoldTop-v1", ""):
        with pytest.raises(UnknownTaskError, match="unknown task"):
            tasks.load_task(source)


@each_task
def test_the_rule_names_points_and_places_that_exist(task):
    landmarks = load_garment(garment_ids(task.category, "train", count=1)[0]).landmarks
    assert set(task.success.landmarks) <= set(landmarks)
    places = {
        f"{item.name}.{place}"
        for item in task.objects
        for place in make_prop(item.props[0]).landmarks
    }
    assert set(task.success.frames) <= places


def place_upright(item):
    return np.array([*item.position, np.cos(item.yaw / 2), 0, 0, np.sin(item.yaw / 2)])


@each_task
def test_the_rule_judges_a_garment_of_the_category(task):
    garment = load_garment(garment_ids(task.category, "train", count=1)[0])
    marks = {name: garment.vertices[garment.landmarks[name]] for name in task.success.landmarks}
    surface = sample_visible_surface(garment.vertices, garment.faces)
    view = TrueView(
        particles=garment.vertices,
        upright=garment.vertices,
        faces=garment.faces,
        landmarks=marks,
        flat_area=compute_covered_area(surface),
        frames={
            item.name: make_prop(item.props[0]).compute_landmarks(place_upright(item))
            for item in task.objects
        },
    )
    verdict = task.success(view)
    assert isinstance(verdict, Verdict)
    # lying flat is the goal of a fling, and of nothing else
    assert verdict.success is task.id.startswith("Fling")


@each_task
def test_category_cameras_and_workspace_fit(task):
    assert task.category in list_categories()
    assert {"garment_camera", "environment_camera", "video_camera"} <= set(task.cameras)
    assert all(camera.name == name for name, camera in task.cameras.items())
    low, high = np.array(task.workspace.low), np.array(task.workspace.high)
    for x in task.start.x_range:
        for y in task.start.y_range:
            assert np.all((low[:2] < (x, y)) & ((x, y) < high[:2]))


def test_fold_tops_is_as_specified():
    task = dgl_tasks.get_task("FoldTops-v1")
    assert task.category == "Tops_LongSleeve"
    start = task.start
    assert (start.x_range, start.y_range, start.yaw) == ((-0.1, 0.1), (0.7, 0.9), 0.0)
    assert task.left_base == (-0.8, 0.0, 0.5, 0.0)
    assert task.right_base == (0.8, 0.0, 0.5, 0.0)
    assert task.success_text.startswith("at least 85 %")


PLACES = {
    "FoldTops-v1": ("Tops_LongSleeve", (0.7, 0.9)),
    "FoldDress-v1": ("Dress_LongSleeve", (0.65, 0.9)),
    "FoldTrousers-v1": ("Trousers", (0.7, 0.9)),
    "FlingTops-v1": ("Tops_LongSleeve", (0.5, 0.7)),
    "FlingDress-v1": ("Dress_LongSleeve", (0.5, 0.7)),
    "FlingTrousers-v1": ("Trousers", (0.5, 0.7)),
}


@pytest.mark.parametrize("task_id", PLACES)
def test_category_and_place_are_as_specified(task_id):
    task = dgl_tasks.get_task(task_id)
    category, y_range = PLACES[task_id]
    start = task.start
    assert (task.category, start.x_range, start.y_range) == (category, (-0.1, 0.1), y_range)
    tilt = (65, 80) if "Fling" in task_id else (0, 0)
    np.testing.assert_allclose(np.degrees(start.roll_range), tilt)
    assert start.yaw == pytest.approx(np.pi / 2 if task_id == "FoldTrousers-v1" else 0.0)
