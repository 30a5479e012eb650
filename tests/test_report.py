"""The report shows what the run's files say, and needs nothing from elsewhere."""

import importlib
import inspect
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from dexgarmentlab.reports import attempt, evaluation, figures, page, pictures
from dexgarmentlab.reports.collection import write_report
from dexgarmentlab.reports.words import DRAWN, MEASURED
from dgl_collect import AttemptResult, Criterion, VideoWriter, package_versions, write_episode
from dgl_collect.evaluation.results import Run, summarize
from dgl_collect.results import PLACEMENT_ERROR, read_results
from dgl_collect.run_folder import ATTEMPTS_FILE, RunRecord, opened_run
from dgl_collect.video import save_png
from dgl_tasks import get_task, task_ids
from dgl_tasks.driver import Driver

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"
VOID = {"meta", "img", "rect", "circle", "line", "polyline", "link", "br", "hr"}


class Page(HTMLParser):
    """Collects addresses and text, and checks that every element is closed."""

    def __init__(self, path):
        super().__init__()
        self.addresses, self.texts, self.open, self.ids = [], [], [], []
        self.feed(path.read_text(encoding="utf-8"))
        assert self.open == []
        self.text = " ".join(" ".join(self.texts).split())

    def handle_starttag(self, tag, attributes):
        names = dict(attributes)
        self.addresses += [names[key] for key in ("src", "href", "poster") if key in names]
        self.ids += [names["id"]] if "id" in names else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


@pytest.fixture
def make_run(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")

    def make(successes, *, status="complete", reason="left <cuff> slipped", first_tries=()):
        record = RunRecord(
            run_format=1,
            task="FoldTops-v1",
            seed=5,
            attempt_factory="m:f",
            options={},
            versions=package_versions(),
            commands=("dgl collect FoldTops-v1 --out 'my out'",),
        )
        with opened_run(tmp_path / "run", record, resume=False) as folder:
            for index, success in enumerate(successes):
                staging = folder.path / ".staging" / str(index)
                staging.mkdir(parents=True)
                image = np.full((480, 640, 3), 90, np.uint8)
                save_png(staging / f"{index}.png", image)
                with VideoWriter(staging / f"{index}.mp4") as video:
                    video.add(image)
                files = {"video": f"{index}.mp4", "picture": f"{index}.png"}
                if success:
                    write_episode(staging / f"{index}.h5", fakes.make_episode(index))
                    files["episode"] = f"{index}.h5"
                value = 0.9 if success else 0.5
                result = AttemptResult(
                    index=index,
                    seed=index,
                    success=success,
                    first_try=index in first_tries,
                    value=value,
                    reason=None if success else reason,
                    detail="" if success else "after 3.2 s",
                    criteria=(
                        Criterion(name="inside", value=value, comparison=">=", threshold=0.8),
                    ),
                    garment_id="tops/0001",
                    seconds=60.0,
                    frames=5,
                    stage_seconds={"left_sleeve": 20.0},
                    files=files,
                    randomisation={"position": [0.05, 0.8, 0.2]},
                )
                folder.commit(result, staging)
            folder.write_summary(requested=len(successes), status=status)
        return folder.path

    return make


def test_a_run_is_reported_with_its_numbers_and_pictures(make_run):
    folder = make_run([True, False, True])
    shown = Page(write_report(folder))
    for text in (
        "Fold Tops", "67% success", "95 % interval 20.8% to 93.9%", "2 of 3", "left <cuff> slipped",
        "after 3.2 s", "tops/0001", "0.9 needs ≥ 0.8", "left sleeve 20.0 s", "0.05, 0.8, 0.2",
        "dgl collect FoldTops-v1 --out 'my out'", "numpy", "Where to grasp: left hand right hand",
    ):  # fmt: skip
        assert text in shown.text, text
    assert shown.ids == ["a0", "a1", "a2"]
    for address in shown.addresses:
        if address.startswith("#"):
            assert address[1:] in shown.ids
        elif not address.startswith("data:"):
            assert (folder / address).is_file()
    assert "episodes/0.mp4" in shown.addresses
    assert "failed/1.mp4" in shown.addresses


def test_what_succeeded_at_once_and_what_with_retries_stand_side_by_side(make_run):
    """The second was done at first and undone."""
    text = Page(write_report(make_run([True, False, True, True], first_tries=(0, 1)))).text
    assert "2 of 4 succeeded at the first try" in " ".join(text.split())
    assert "3 of 4 succeeded with retries" in " ".join(text.split())


def test_a_stage_names_the_hands_that_work_in_it(make_run, monkeypatch):
    fakes = importlib.import_module("dgl_collect_fakes")
    stages = [fakes.make_stage(k, name=name, frames=9) for k, name in enumerate(("one", "two"))]
    stages[0].ee_pose[:, 1, :3] = stages[0].ee_pose[0, 1, :3]  # the right hand is parked
    episode = fakes.make_episode(stages=tuple(stages))
    monkeypatch.setattr(fakes, "make_episode", lambda seed: episode)
    text = Page(write_report(make_run([True]))).text
    first, second = re.findall(r"Where to grasp: ([a-z ]*?) +Start", text)
    assert first == "left hand"
    assert second == "left hand right hand both"


@pytest.mark.parametrize(
    ("name", "known", "value", "shown"),
    [
        ("max_strain_p999", MEASURED, 1.5, "strain that 99.9 % of the edges stay below 150 %"),
        ("max_penetration_m", MEASURED, 0.0038, "deepest penetration 3.8 mm"),
        ("steps", MEASURED, 1566.0, "control steps 1566"),
        ("largest_fall", MEASURED, 0.5, "largest fall 0.5"),
        ("roll", DRAWN, np.pi / 2, "garment, tilt when dropped 90 °"),
        ("coat_rack_x", DRAWN, 0.5, "coat rack, x 0.5 m"),
        ("fabric", DRAWN, "blue <denim>", "fabric blue &lt;denim&gt;"),
        ("is_new", DRAWN, True, "is new True"),
    ],
)
def test_measurements_and_draws_are_in_words_and_units(name, known, value, shown):
    drawn = attempt._facts("Facts", {name: value}, known)
    assert " ".join(re.sub(r"<[^>]+>", " ", drawn).split()) == f"Facts {shown}"


def test_what_is_measured_has_words():
    """All that an episode measures is known to the pages."""
    source = inspect.getsource(Driver)
    names = {f"max_{name}" for name in re.findall(r'"(strain_\w+|penetration_m)":', source)}
    names |= set(re.findall(r'"(further_\w+)"', source))
    assert names == set(MEASURED) - {"steps", PLACEMENT_ERROR}


def test_an_embedding_report_is_one_file(make_run):
    path = write_report(make_run([True]), embed_media=True)
    shown = Page(path)
    assert shown.addresses
    assert all(address.startswith("data:") for address in shown.addresses)
    assert not re.search(r"https?://|url\(|@import", path.read_text(encoding="utf-8"))
    assert "Success" in shown.text


def test_an_interrupted_run_says_how_to_go_on(make_run):
    shown = Page(write_report(make_run([False], status="interrupted")))
    assert "Failed" in shown.text
    assert "interrupted after 1 of 1 attempts. The same command with --resume" in shown.text


def test_a_run_without_attempts_is_reported(make_run):
    assert "No attempts yet" in Page(write_report(make_run([], status="interrupted"))).text


def test_many_attempts_are_all_in_the_table(make_run, monkeypatch):
    monkeypatch.setattr("dexgarmentlab.reports.collection.SHOWN_EACH", 2)
    shown = Page(write_report(make_run([True, True, True, False])))
    assert shown.ids == ["a0", "a1", "a3"]
    assert "3 of 4, see the table" in shown.text


def test_what_cannot_be_reported_is_said(make_run, tmp_path):
    with pytest.raises(FileNotFoundError, match="holds no run to report"):
        write_report(tmp_path)


@pytest.mark.parametrize("damage", [lambda p: p.write_bytes(b"\x89HDF"), lambda p: p.unlink()])
def test_an_episode_that_is_damaged_or_gone_is_told_beside_the_others(make_run, damage):
    folder = make_run([True, True])
    damage(folder / "episodes/0.h5")
    shown = Page(write_report(folder))
    assert shown.ids == ["a0", "a1"]
    assert shown.text.count("dgl verify looks at all files") == 1
    assert "episodes/0.h5" in shown.text


def test_the_summary_that_was_written_is_the_one_shown(make_run):
    folder = make_run([True, True])
    content = json.loads((folder / "summary.json").read_text())
    content["succeeded"] = 1
    (folder / "summary.json").write_text(json.dumps(content))
    assert "50% success" in Page(write_report(folder)).text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (0.80000001, "0.8"), (0.0012345, "0.00123"), (1234.5, "1234"), (-0.05, "\u22120.05"),
     (100.0, "100"), (1e-7, "1e-07"), (99.96, "100")],
)  # fmt: skip
def test_numbers_are_written_for_people(value, text):
    assert page.format_number(value) == text


@pytest.mark.parametrize(("threshold", "state"), [(0.5, "met"), (0.51, "missed")])
def test_the_meter_agrees_with_the_criterion(threshold, state):
    criterion = Criterion(name="x", value=0.5, comparison=">=", threshold=threshold, unit="m")
    assert f'class="meter {state}"' in figures.meter(criterion)


def test_a_degenerate_cloud_is_drawn():
    cloud = np.zeros((1, 3), np.float32)
    assert "data:image/png" in figures.cloud_figure(cloud, np.ones((1, 2)), {}, alt="one point")


def name_points(cloud, affordance, points, *, discs=False):
    """Return names and positions [px] of the texts or discs of a cloud, and their number."""
    drawn = figures.cloud_figure(cloud, affordance, points, alt="a top")
    if discs:
        found = re.findall(r'<circle cx="([-\d.]+)" cy="([-\d.]+)"[^>]*><title>(\w+)<', drawn)
        return {name: (float(x), float(y)) for x, y, name in found}, len(found)
    texts = re.findall(r'<text x="([-\d.]+)" y="([-\d.]+)"[^>]*>([^<]*)<', drawn)
    return {name: (float(x), float(y)) for x, y, name in texts}, drawn.count("<circle")


def test_the_cloud_is_the_same_way_up_as_the_pictures():
    """Right and down in the figure are right and down in the environment camera's picture."""
    for task_id in task_ids():
        camera = get_task(task_id).cameras["environment_camera"]
        _, down, _ = np.array(camera.axes)
        right = np.array(camera.axes)[0]
        for second, floor in ((1, [0.4, 0.3, 0.01]), (2, [0.4, 0.01, 0.3])):
            cloud = np.random.default_rng(0).uniform(-np.array(floor), floor, (500, 3))
            one, other = np.zeros(3), np.zeros(3)
            other[[0, second]] = 0.1
            points = {"a": {"xyz": one.tolist()}, "b": {"xyz": other.tolist()}}
            places, _ = name_points(cloud, np.ones((500, 2)), points, discs=True)
            (xa, ya), (xb, yb) = places["a"], places["b"]
            assert np.sign(xb - xa) == np.sign((other - one)[0] * right[0])
            assert np.sign(yb - ya) == np.sign((other - one)[second] * down[second])


def test_hands_that_move_work_in_a_stage():
    still, moving = np.zeros((5, 1, 7)), np.zeros((5, 1, 7))
    moving[:, 0, 2] = np.linspace(0, 2 * figures.MOVES_FROM, 5)
    for left, right, hands in (
        (moving, still, ("left",)), (still, moving, ("right",)),
        (moving, moving, ("left", "right")), (still, still, ("left", "right")),
    ):  # fmt: skip
        assert figures.find_hands(np.concatenate([left, right], axis=1)) == hands


def test_points_have_the_colours_of_the_hands_that_want_them_where_the_garment_is():
    cloud = np.array([[0.0, 0, 0], [0.5, 0, 0], [1.0, 0, 0], [1.5, 0, 0]])
    affordance = np.array([[1, 0], [0, 1], [1, 1], [0, 0]], float)
    points = {str(k): {"xyz": place.tolist()} for k, place in enumerate(cloud)}
    points["away"] = {"xyz": [0.0, 2 * figures.OFF_GARMENT, 0.0]}  # cloth has been folded away
    points["unplaced"] = {"uv": [3.0, 4.0]}

    def find(*hands):
        return list(figures.find_wanted(cloud, affordance, points, hands=hands).items())

    assert find("left", "right") == [("0", "left"), ("1", "right"), ("2", "both"), ("3", "other")]
    assert find("left") == [("0", "left"), ("1", "other"), ("2", "left"), ("3", "other")]
    written, discs = name_points(cloud, affordance, points)
    assert (sorted(written), discs) == (["0", "1", "2"], 4)
    picture = np.zeros((480, 640, 3), np.uint8)
    located = {name: {**point, "uv": [9.0, 9.0]} for name, point in points.items()}
    drawn = figures.picture_with_points(
        picture, located, alt="", wanted=figures.find_wanted(cloud, affordance, located)
    )
    assert drawn.count("<circle") == 4
    assert drawn.count('class="mark both"') == 1


def test_only_points_that_a_hand_wants_are_named_and_beside_each_other():
    cloud = np.random.default_rng(0).uniform([-0.4, -0.3, 0], [0.4, 0.3, 0.01], (500, 3))
    affordance = np.zeros((500, 2))
    affordance[cloud[:, 1] > -0.2, 0] = figures.NAMED_FROM
    affordance[cloud[:, 1] <= -0.2, 1] = figures.NAMED_FROM - 0.01
    names = ["left_sleeve_cuff", "left_sleeve_joint", "left_armpit", "left_shoulder"]
    points = {name: {"xyz": [0.02 * k - 0.38, 0.01, 0.0]} for k, name in enumerate(names)}
    points["hem"] = {"xyz": [0.0, -0.3, 0.0]}
    written, discs = name_points(cloud, affordance, points)
    assert discs == 5
    assert list(written) == [name.replace("_", " ") for name in names]
    baselines = sorted(y for _, y in written.values())
    assert min(b - a for a, b in pairwise(baselines)) >= 18
    assert all(0 < y < figures.CLOUD_HEIGHT and x >= 0 for x, y in written.values())


def test_cloth_has_the_colour_of_the_hands_that_want_it():
    weight = np.array([[0, 0], [1, 0], [0, 1], [1, 1], [1, 0.5]])
    colours = figures._colour_affordance(weight)
    expected = [figures.CLOTH_RGB, figures.LEFT_RGB, figures.RIGHT_RGB, figures.BOTH_RGB]
    np.testing.assert_allclose(colours[:4], expected)
    np.testing.assert_allclose(colours[4], (colours[1] + colours[3]) / 2)


# Pictures beside each other -----------------------------------------------------------------------


def draw_garment(path, x, y, *, size=40, shade=220):
    """Save a picture of a bright square, its corner at (x, y), on a grey floor."""
    image = np.full((480, 640, 3), 90, np.uint8)
    image[y : y + size, x : x + size] = shade
    save_png(path, image)
    return pictures.Shot(path=path, label=path.stem, success=True)


def test_pictures_are_cropped_to_where_they_differ_whatever_lies_far_off(tmp_path):
    shots = [draw_garment(tmp_path / f"{k}.png", 300 + k, 200 + k) for k in range(30)]
    left, upper, right, lower = pictures._find_box(
        np.stack([pictures._read(s.path) for s in shots])
    )
    assert right - left == pytest.approx(lower - upper)  # pictures keep their shape
    assert left < 300 / 640 < 369 / 640 < right
    assert upper < 200 / 480 < 269 / 480 < lower
    assert right - left < 0.3
    # three pixels of one picture, at its edge, are less than a hundredth of all that differs
    far = draw_garment(tmp_path / "far.png", 620, 460, size=12)
    boxes = np.stack([pictures._read(s.path) for s in [*shots, far]])
    assert pictures._find_box(boxes)[2] < 0.7


@pytest.mark.parametrize("count", [pictures.LEAST_CROPPED - 1, pictures.LEAST_CROPPED])
def test_few_pictures_and_equal_ones_are_shown_whole(tmp_path, count):
    whole = (0.0, 0.0, 1.0, 1.0)
    equal = np.stack([pictures._read(draw_garment(tmp_path / "a.png", 300, 200).path)] * count)
    assert pictures._find_box(equal) == whole
    equal = equal.copy()
    equal[0, 60:90, 100:140] = 0
    assert (pictures._find_box(equal) == whole) == (count < pictures.LEAST_CROPPED)


def test_a_box_at_the_edge_stays_inside_the_picture(tmp_path):
    shots = [draw_garment(tmp_path / f"{k}.png", 590 - k, 430 - k) for k in range(8)]
    box = pictures._find_box(np.stack([pictures._read(s.path) for s in shots]))
    assert box[2:] == pytest.approx((1.0, 1.0))
    assert min(box) >= 0.0


def test_the_sheet_frames_failures_in_red(tmp_path):
    shots = [draw_garment(tmp_path / f"{k}.png", 300, 200) for k in range(12)]
    shots[11] = pictures.Shot(path=shots[11].path, label="11", success=False)
    image = iio.imread(pictures.draw_sheet(shots, tmp_path / "sheet.jpg")).astype(int)
    step = np.array([image.shape[0] - pictures._GAP, image.shape[1] - pictures._GAP])
    step //= [2, pictures.COLUMNS]  # two rows of ten
    for index, (red, green) in ((0, (31, 122)), (11, (196, 60))):
        corner = pictures._GAP + 1 + step * divmod(index, pictures.COLUMNS)
        assert np.abs(image[corner[0], corner[1]][:2] - [red, green]).max() < 25, index
    with pytest.raises(ValueError, match="at least one picture; got none"):
        pictures.draw_sheet([], tmp_path / "none.jpg")
    assert not (tmp_path / "none.jpg").exists()


# Evaluations --------------------------------------------------------------------------------------

ASKED = {
    "task": "FoldTops-v1", "policy": "my:<policy>", "matcher": "gam",
    "command": "dgl eval FoldTops-v1 --policy 'my:<policy>'",
}  # fmt: skip


@pytest.fixture
def make_evaluation(make_run):
    def make(outcomes):
        """Make the folders of seeds, each with a success or failure an episode."""
        runs = []
        for seed, successes in enumerate(outcomes):
            source = make_run(successes)
            folder = source.parent / f"seed-{seed}"
            source.rename(folder)
            runs.append(
                Run(
                    seed=seed,
                    folder=Path(folder.name),
                    results=read_results(folder / ATTEMPTS_FILE),
                )
            )
        return folder.parent, runs

    return make


def report(folder, runs, wanted=1):
    return evaluation.write_report(
        folder, summarize(runs), runs, asked=ASKED, wanted=wanted, versions={"numpy": "2.0"}
    )


def test_an_evaluation_is_reported_with_all_its_pictures(make_evaluation):
    folder, runs = make_evaluation([[True, False], [True, True]])
    shown = Page(report(folder, runs))
    for text in (
        "Fold Tops: my:<policy>", "75% success", "3 of 4", "0.750 ± 0.354", "left <cuff> slipped",
        "seed 1", "0.500", "Episode 1 of seed 0", "0 · 0.90", "1 · 0.50", "dgl eval FoldTops-v1",
    ):  # fmt: skip
        assert text in shown.text, text
    assert shown.ids == ["s0e1"]  # failures are shown with film and figures
    files = [a for a in shown.addresses if not a.startswith("data:")]
    assert all((folder / address).is_file() for address in files)
    for film in ("seed-0/episodes/0.mp4", "seed-0/failed/1.mp4", "seed-1/episodes/1.mp4"):
        assert film in files
    assert (folder / "pictures.jpg").is_file()


def test_an_evaluation_without_failures_and_one_without_episodes(make_evaluation):
    folder, runs = make_evaluation([[True]])
    shown = Page(report(folder, runs))
    assert "100% success" in shown.text
    for word in ("Failures", "interrupted"):
        assert word not in shown.text
    empty = [Run(seed=0, folder=runs[0].folder, results=())]
    shown = Page(report(folder, empty))
    assert "No episodes yet" in shown.text
    assert "interrupted after 0 of 1 episodes. The same command with --resume" in shown.text


@pytest.mark.parametrize("seconds", [{}, {"left_sleeve": 20.0}])
def test_only_timed_stages_have_their_times_shown(make_evaluation, seconds):
    folder, [run] = make_evaluation([[False]])
    results = [replace(result, stage_seconds=seconds) for result in run.results]
    shown = Page(report(folder, [replace(run, results=results)]))
    assert ("left sleeve 20.0 s" in shown.text) == ("all else" in shown.text) == bool(seconds)


def test_a_picture_that_is_missing_is_said(make_evaluation):
    folder, runs = make_evaluation([[True]])
    (folder / "seed-0/episodes/0.png").unlink()
    with pytest.raises(FileNotFoundError, match=r"0\.png"):
        report(folder, runs)
    assert not (folder / "index.html").exists()
