"""The report shows what the run's files say, and needs nothing from elsewhere."""

import importlib
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from dexgarmentlab import _report_figures as figures
from dexgarmentlab.report import write_report
from dgl_collect import AttemptResult, CorruptEpisodeError, Criterion, VideoWriter, write_episode
from dgl_collect.run_folder import RunFolder
from dgl_collect.video import save_png

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

    def make(successes, *, status="complete", reason="left <cuff> slipped"):
        identity = {"task": "FoldTops-v1", "seed": 5}
        command = "dgl collect FoldTops-v1 --out 'my out'"
        folder = RunFolder(tmp_path / "run", identity=identity, resume=False, command=command)
        with folder:
            for index, success in enumerate(successes):
                staging = folder.staging(str(index))
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
    page = Page(write_report(folder))
    for text in (
        "Fold Tops", "67% success", "95 % interval 20.8% to 93.9%", "2 of 3", "left <cuff> slipped",
        "after 3.2 s", "tops/0001", "0.9 needs ≥ 0.8", "left sleeve 20.0 s", "0.05, 0.8, 0.2",
        "dgl collect FoldTops-v1 --out 'my out'", "numpy", "left cuff",
    ):  # fmt: skip
        assert text in page.text, text
    assert page.ids == ["a0", "a1", "a2"]
    for address in page.addresses:
        if address.startswith("#"):
            assert address[1:] in page.ids
        elif not address.startswith("data:"):
            assert (folder / address).is_file()
    assert "episodes/0.mp4" in page.addresses
    assert "failed/1.mp4" in page.addresses


def test_an_embedding_report_is_one_file(make_run):
    path = write_report(make_run([True]), embed_media=True)
    page = Page(path)
    assert page.addresses
    assert all(address.startswith("data:") for address in page.addresses)
    assert not re.search(r"https?://|url\(|@import", path.read_text(encoding="utf-8"))
    assert "Success" in page.text


def test_an_interrupted_run_says_how_to_go_on(make_run):
    page = Page(write_report(make_run([False], status="interrupted")))
    assert "Failed" in page.text
    assert "interrupted after 1 of 1 attempts. The same command with --resume" in page.text


def test_a_run_without_attempts_is_reported(make_run):
    assert "No attempts yet" in Page(write_report(make_run([], status="interrupted"))).text


def test_many_attempts_are_all_in_the_table(make_run, monkeypatch):
    monkeypatch.setattr("dexgarmentlab.report.SHOWN_EACH", 2)
    page = Page(write_report(make_run([True, True, True, False])))
    assert page.ids == ["a0", "a1", "a3"]
    assert "3 of 4, see the table" in page.text


def test_what_cannot_be_reported_is_said(make_run, tmp_path):
    with pytest.raises(FileNotFoundError, match="holds no run to report"):
        write_report(tmp_path)
    folder = make_run([True])
    (folder / "episodes/0.h5").write_bytes(b"\x89HDF")
    with pytest.raises(CorruptEpisodeError, match=r"0\.h5"):
        write_report(folder)
    assert not (folder / "index.html").exists()


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
    assert figures.format_number(value) == text


@pytest.mark.parametrize(("threshold", "state"), [(0.5, "met"), (0.51, "missed")])
def test_the_meter_agrees_with_the_criterion(threshold, state):
    criterion = Criterion(name="x", value=0.5, comparison=">=", threshold=threshold, unit="m")
    assert f'class="meter {state}"' in figures.meter(criterion)


def test_a_degenerate_cloud_is_drawn():
    cloud = np.zeros((1, 3), np.float32)
    assert "data:image/png" in figures.cloud_figure(cloud, np.ones((1, 2)), {}, alt="one point")
