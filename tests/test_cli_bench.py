"""The verb `bench`."""

import json
import subprocess
import sys

import pytest

import dgl_bench.physics
from dexgarmentlab.cli import main
from dgl_bench.physics import Experiment, Reading, Result
from dgl_bench.physics.figures import Bars, Figure
from dgl_bench.physics.report import write_report


@pytest.fixture
def made_up(monkeypatch):
    rows = [
        Reading("fast", 5.0, "ms", bar="<= 10"),
        Reading("slow", 10.1, "ms", bar="<= 10"),
        Reading("many", 123456.0, "1/s", bar=">= 100"),
        Reading("broken", None, "mm", bar="<= 2"),
        Reading.skip("absent", "mm", "no CUDA", bar="<= 2"),
        Reading("plain", 0.5, "%"),
    ]
    benches = []

    def measure(bench):
        benches.append(bench)
        return Result(rows)

    experiment = Experiment("made_up", "Made up", "", measure)
    monkeypatch.setattr(dgl_bench.physics, "select", lambda names: (experiment,))
    return benches


def test_rows_as_json(made_up, capsys):
    assert main(["bench", "physics", "--json"]) == 0
    captured = capsys.readouterr()
    rows = json.loads(captured.out)
    assert [list(row) for row in rows] == [["name", "value", "unit", "bar", "ok", "note"]] * 6
    assert [row["ok"] for row in rows] == [True, False, True, False, None, None]
    assert rows[1] == {
        "name": "slow", "value": 10.1, "unit": "ms", "bar": "<= 10", "ok": False, "note": None
    }  # fmt: skip
    assert rows[3]["value"] is None
    assert rows[5]["bar"] is None
    assert "made_up: 2 of 4 bars met" in captured.err  # progress, beside the result


def test_rows_as_a_table(made_up, capsys):
    assert main(["bench", "physics"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert lines[0] == ["name", "value", "unit", "bar", "ok", "note"]
    assert lines[1] == ["fast", "5", "ms", "<=", "10", "yes"]
    assert lines[3] == ["many", "123,456", "1/s", ">=", "100", "yes"]
    assert lines[4] == ["broken", "failed", "mm", "<=", "2", "no"]
    assert lines[5] == ["absent", "skipped", "mm", "<=", "2", "no", "CUDA"]
    assert lines[6] == ["plain", "0.5", "%"]


def test_effort_and_seed_reach_the_experiments(made_up, capsys):
    main(["bench", "physics", "--effort", "0.25", "--seed", "7"])
    capsys.readouterr()
    assert [(b.effort, b.seed) for b in made_up] == [(0.25, 7)]


def test_a_report_that_cannot_be_written_is_refused_before_anything_is_measured(
    made_up, tmp_path, capsys
):
    (tmp_path / "file").touch()
    assert main(["bench", "physics", "--report", str(tmp_path / "file")]) == 1
    assert str(tmp_path / "file") in capsys.readouterr().err
    assert not made_up


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["weather"], 2, "physics"),
        (["physics", "--only", "free_fal"], 1, "did you mean free_fall?"),
        (["physics", "--only", "free_fall", "--effort", "0"], 1, "effort must be > 0"),
    ],
)
def test_what_does_not_exist_is_refused(arguments, status, message, capsys):
    assert main(["bench", *arguments]) == status
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_an_experiment_is_measured_and_reported(tmp_path):
    """Warp greets in a new process only; nothing but JSON comes out."""
    program = "import sys; from dexgarmentlab.cli import main; sys.exit(main())"
    options = ["--only", "free_fall", "--report", str(tmp_path), "--json"]
    done = subprocess.run(
        [sys.executable, "-c", program, "bench", "physics", *options],
        capture_output=True,
        text=True,
        check=True,
    )
    [row] = json.loads(done.stdout)
    assert row["ok"] is True
    assert 0.05 < row["value"] < 0.5
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "free_fall.png",
        "index.html",
        "rows.json",
    ]
    assert "dgl bench physics --only free_fall" in (tmp_path / "index.html").read_text()


@pytest.mark.slow
def test_policies_are_timed(capsys):
    command = ["bench", "sadp", "--method", "sadp", "--repeats", "1", "--json"]
    assert main(command) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert list(rows) == [
        "sadp, small, chunk of 4 targets",
        "sadp, small, chunk of 4 targets, processor time",
        "sadp, small, once a stage",
        "sadp, small, float32, training, batch of 64",
        "sadp, small, float32, training of 60 epochs",
    ]
    assert all(row["value"] > 0 for row in rows.values())
    assert rows["sadp, small, chunk of 4 targets"]["bar"] == "<= 150"
    rate, hours = (row["value"] for row in list(rows.values())[3:])
    assert hours == pytest.approx(60 * 52 / rate / 3600)  # 3,300 windows are 52 batches of 64.


def test_policies_are_timed_at_least_once(capsys):
    assert main(["bench", "sadp", "--repeats", "0"]) == 1
    assert "repeats and threads must be positive; got 0" in capsys.readouterr().err


def test_the_report_is_whole(tmp_path):
    rows = (
        Reading("a < b", 1.0, "mm", bar="<= 2"),
        Reading("c", 3.0, "mm", bar="<= 2"),
        Reading.skip("d", "mm", "no CUDA", bar="<= 2"),
    )
    experiment = Experiment("made_up", "Made up", "Theory & more.", lambda bench: Result(rows))
    bars = Bars("bars", ("a",), (1.0,), "ms")
    figure = Figure("all_kinds", "kinds", (bars,))
    result = Result(rows, (figure,))
    folder = tmp_path / "new" / "report"
    page = write_report(folder, [(experiment, result, 1.0)], command="dgl bench")
    text = page.read_text(encoding="utf-8")
    assert sorted(p.name for p in folder.iterdir()) == ["all_kinds.png", "index.html", "rows.json"]
    for part in ('src="all_kinds.png"', "a &lt; b", "Theory &amp; more.", "1 of 2", "skipped"):
        assert part in text
    assert [r["ok"] for r in json.loads((folder / "rows.json").read_text())] == [True, False, None]


def test_benchmarks_that_are_not_installed_are_told_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["bench", "gam"]) == 1
    assert capsys.readouterr().err.startswith("dgl: the benchmarks are not installed")
