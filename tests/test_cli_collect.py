"""The verbs `collect` and `demo`, with made-up attempts."""

import importlib
import json
import os
import signal
import threading
from pathlib import Path

import pytest

import dgl_collect
from dexgarmentlab.cli import collect as collect_verb
from dexgarmentlab.cli import demo as demo_verb
from dexgarmentlab.cli import main
from dgl_assets.importing import AssetImportError
from dgl_collect import AttemptResult, RecordOptions, own_garment
from dgl_collect.attempt_jobs import make_attempt_seed
from dgl_collect.errors import OutputFolderError, WorkerError
from dgl_tasks.errors import UnknownTaskError

COLLECT_TESTS = Path(__file__).parents[1] / "packages/dgl-collect/tests"


@pytest.fixture
def fake(monkeypatch):
    """Make the verbs use made-up attempts with the given options, made in this process."""
    monkeypatch.syspath_prepend(str(COLLECT_TESTS))
    fakes = importlib.import_module("dgl_collect_fakes")

    def use(*, has_processes=False, **options):
        if not has_processes:
            fakes.work_here(monkeypatch)
        config, made_up = dgl_collect.CollectConfig, {"attempt_factory": fakes.FACTORY}
        monkeypatch.setattr(
            "dgl_collect.CollectConfig",
            lambda **asked: config(**{**asked, **made_up, "options": options}),
        )

    return use


def options(out, **changes):
    return collect_verb.CollectOptions(
        **({"task": "FoldTops-v1", "episodes": 2, "out": out} | changes)
    )


def test_collect_says_how_many_succeeded(fake, tmp_path, capsys):
    fake()
    assert collect_verb.run(options(tmp_path / "out")) == 0
    out = capsys.readouterr().out
    first, succeeded = (sum(make_attempt_seed(0, k) % of == 0 for k in range(2)) for of in (4, 2))
    assert f"{first} of 2 attempts succeeded at the first try, {succeeded} with retries, " in out
    assert f"report: {tmp_path}/out/index.html" in out
    assert collect_verb.run(options(tmp_path / "out", episodes=3, resume=True, json=True)) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["attempted"] == 3
    commands = json.loads((tmp_path / "out/run.json").read_text())["commands"]
    assert commands[1].endswith("--resume")


def test_the_look_is_an_option_of_the_attempts(monkeypatch, tmp_path):
    seen = []

    def stop(config):
        seen.append(config)
        raise KeyboardInterrupt

    monkeypatch.setattr(collect_verb, "collect_with_progress", stop)
    for look in ("studio", "random"):
        with pytest.raises(KeyboardInterrupt):
            collect_verb.run(options(tmp_path / "out", run=RecordOptions(look=look)))
    assert [config.options.look for config in seen] == ["studio", "random"]
    assert [" --look random" in config.command for config in seen] == [False, True]


def test_collect_refuses_in_one_line(fake, tmp_path):
    fake()
    with pytest.raises(UnknownTaskError, match="did you mean 'FoldTops-v1'"):
        collect_verb.run(options(tmp_path / "out", task="FoldTop-v1"))
    with pytest.raises(ValueError, match="episodes should be greater than or equal to 1; got 0"):
        collect_verb.run(options(tmp_path / "out", episodes=0))
    (tmp_path / "out").mkdir()
    (tmp_path / "out/file").touch()
    with pytest.raises(OutputFolderError, match="not empty; add --resume"):
        collect_verb.run(options(tmp_path / "out"))


@pytest.mark.usefixtures("heeds_interrupts")
def test_an_interrupted_collect_tells_the_command_that_goes_on(fake, tmp_path, capsys):
    fake(has_processes=True, seconds=0.5)
    timer = threading.Timer(1.5, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    assert collect_verb.run(options(tmp_path / "my out", episodes=50)) == 130
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert "of 50 attempts; continue with: dgl collect FoldTops-v1 --out" in last
    assert last.endswith("my out' --episodes 50 --resume")


def test_the_report_is_there_when_the_workers_give_up(fake, tmp_path):
    fake(fail_when_built=True)
    with pytest.raises(WorkerError, match="no Vulkan device"):
        collect_verb.run(options(tmp_path / "out"))
    assert (tmp_path / "out/index.html").exists()


def test_demo_says_where_everything_is_and_can_be_repeated(fake, tmp_path, capsys):
    fake()
    succeeds = make_attempt_seed(0, 0) % 2 == 0
    for _ in range(2):
        assert demo_verb.run(demo_verb.DemoOptions(out=tmp_path / "out")) == (0 if succeeds else 1)
    out, err = capsys.readouterr()
    for kind in ("video", "picture", "report"):
        assert f"  {kind}" in out
    assert ("the demonstration failed: too little inside the box" in err) != succeeds


def test_demo_leaves_other_peoples_folders_alone(fake, tmp_path):
    fake()
    demo_verb.run(demo_verb.DemoOptions(out=tmp_path / "out"))
    (tmp_path / "out/notes.txt").write_text("precious")
    with pytest.raises(ValueError, match="not \\(only\\) an earlier demonstration's"):
        demo_verb.run(demo_verb.DemoOptions(out=tmp_path / "out"))
    assert (tmp_path / "out/attempts.jsonl").exists()
    assert (tmp_path / "out/notes.txt").read_text() == "precious"
    collect_verb.run(options(tmp_path / "mine", episodes=1))
    with pytest.raises(ValueError, match="choose another --out"):
        demo_verb.clear_previous(tmp_path / "mine")


def test_a_garment_that_cannot_be_had_is_told_before_there_is_a_folder(
    tmp_path, capsys, monkeypatch
):
    out, source = tmp_path / "out", tmp_path / "shirt.obj"
    command = ["collect", "FoldTops-v1", "--out", str(out), "--garment", str(source)]
    assert main(command) == 1
    told = capsys.readouterr().err
    assert "garment must be a mesh file, the folder of an imported garment or an id" in told
    source.touch()
    assert main(command) == 1
    told = capsys.readouterr().err
    assert "shirt.obj is empty" in told
    assert "dgl assets import" not in told

    def refuse(source, task):
        raise AssetImportError("its size is unclear; give `units`")

    monkeypatch.setattr(own_garment, "prepare_garment", refuse)
    assert main(command) == 1
    told = capsys.readouterr().err
    assert "its size is unclear; give --units; " in told
    assert f"import it with them (dgl assets import {source} --out FOLDER" in told
    assert not out.exists()


def test_notes_beside_the_bar():
    def progress(**changes):
        state = {"requested": 4, "resumed": 0, "results": (), "seconds": 0.0, "workers_ready": 0}
        state["workers_waiting"] = 0
        return dgl_collect.Progress(**(state | changes))

    result = AttemptResult(index=0, seed=0, success=True, seconds=30.0)
    assert collect_verb._note(progress()) == "building the environment"
    assert collect_verb._note(progress(workers_ready=1)) == "making the first attempt"
    note = collect_verb._note(progress(results=(result,) * 2, seconds=60.0))
    assert note == "2 succeeded, 30 s each, 60 s left"
    assert collect_verb._note(progress(results=(result,), resumed=1)) == "1 succeeded, 30 s each"
    note = collect_verb._note(progress(results=(result,), resumed=1, workers_waiting=7))
    assert note == "1 succeeded, 30 s each, 7 workers wait for a place"
    note = collect_verb._note(progress(workers_waiting=1))
    assert note == "building the environment, 1 worker waits for a place"


@pytest.mark.parametrize(
    ("seconds", "text"), [(1, "1 s"), (89, "89 s"), (90, "2 min"), (5400, "1 h 30 min")]
)
def test_durations(seconds, text):
    assert collect_verb.format_duration(seconds) == text
