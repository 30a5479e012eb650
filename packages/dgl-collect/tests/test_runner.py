import errno
import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from dgl_collect import (
    CollectConfig,
    Limits,
    MachineError,
    OutputFolderError,
    WorkerError,
    Workers,
    collect,
    read_episode,
    run_folder,
)
from dgl_collect.attempt_jobs import make_attempt_seed
from dgl_collect.demonstration import FOLDER
from dgl_collect.options import RunOptions
from dgl_collect.results import read_results
from dgl_collect.run_folder import opened_run, read_run
from dgl_files.whole import append_line
from dgl_tasks.errors import UnknownTaskError

SUCCESSES = [index for index in range(8) if make_attempt_seed(0, index) % 2 == 0]


@pytest.fixture
def run(run_processes, fakes, monkeypatch):
    """Collects with workers in this process."""
    fakes.work_here(monkeypatch)
    return run_processes


@pytest.fixture
def run_processes(tmp_path, fakes):
    """Collects with processes as workers."""

    def go(*, out=tmp_path / "out", on_progress=None, **changes):
        settings = {"task": "FoldTops-v1", "episodes": 2, "attempt_factory": fakes.FACTORY}
        config = CollectConfig(out=out, **(settings | changes))
        return collect(config, on_progress=on_progress)

    return go


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """The folder of a finished run of four attempts in this process, and what it told."""
    out, reports = tmp_path_factory.mktemp("finished") / "out", []
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))
        fakes = importlib.import_module("dgl_collect_fakes")
        fakes.work_here(patch)
        config = CollectConfig(
            task="FoldTops-v1", episodes=4, attempt_factory=fakes.FACTORY, out=out
        )
        summary = collect(config, on_progress=reports.append)
    return out, summary, reports


@pytest.fixture
def finished_out(finished, tmp_path):
    """A copy of the finished run, where `run` looks for one."""
    return Path(shutil.copytree(finished[0], tmp_path / "out"))


def results_of(folder):
    return read_results(folder / "attempts.jsonl")


def files_of(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def facts(result):
    return (result.index, result.seed, result.success, result.value, result.randomisation)


def test_seeds_differ_between_attempts_and_between_runs():
    seeds = {make_attempt_seed(run, index) for run in range(20) for index in range(50)}
    assert len(seeds) == 1000
    assert make_attempt_seed(3, 4) == make_attempt_seed(3, 4)
    assert SUCCESSES  # the made-up attempt succeeds for even seeds; both kinds are needed below
    assert len(SUCCESSES) < 8


def test_a_run_writes_what_the_design_names(finished):
    out, summary, reports = finished
    assert summary.status == "complete"
    assert (summary.attempted, summary.succeeded) == (4, len([i for i in SUCCESSES if i < 4]))
    written = json.loads((out / "summary.json").read_text())
    assert {"task", "attempted", "succeeded", "success_rate", "seconds_per_attempt"} < set(written)
    assert {"garments", "seed", "versions", "reasons", "success_interval"} < set(written)
    expected = {"attempts.jsonl", "run.json", "summary.json", "logs/worker-0.log"}
    for result in results_of(out):
        kind, suffixes = ("episodes", "h5 mp4 png") if result.success else ("failed", "mp4 png")
        expected |= {f"{kind}/FoldTops-v1-s0-{result.index:05d}.{s}" for s in suffixes.split()}
        assert all((out / path).is_file() for path in result.files.values())
        if result.success:
            assert read_episode(out / result.files["episode"]).seed == result.seed
        else:
            assert result.reason == "too little inside the box"
    assert set(files_of(out)) == expected
    assert [len(report.results) for report in reports] == [0, 0, 1, 2, 3, 4]
    assert "attempt 3 speaks" in (out / "logs/worker-0.log").read_text()


def test_results_depend_neither_on_processes_nor_on_their_number_nor_on_lost_ones(
    run_processes, finished, tmp_path
):
    """Two workers, the second of which is lost in its first attempt."""
    one, two = finished[0], tmp_path / "out"
    options = {"die_once_at": [1], "marks": str(tmp_path), "tell_garbage": True}
    run_processes(episodes=4, workers=Workers(count=2), options=options)
    for a, b in zip(results_of(one), results_of(two), strict=True):
        assert facts(a) == facts(b)
        if a.success:
            path = a.files["episode"]
            assert (one / path).read_bytes() == (two / path).read_bytes()
    logs = [(two / f"logs/worker-{number}.log").read_text() for number in range(2)]
    spoken = [sum(log.count(f"attempt {k} speaks") for log in logs) for k in range(4)]
    assert spoken == [1, 2, 1, 1]
    # What they have imported is none of the garbage collector's business.
    assert all("collects True, passes over many True" in log for log in logs)


def test_resume_makes_only_what_is_missing(run, finished, tmp_path):
    run(episodes=2)
    lines = (tmp_path / "out/attempts.jsonl").read_text()
    reports = []
    summary = run(episodes=4, resume=True, on_progress=reports.append)
    assert (tmp_path / "out/attempts.jsonl").read_text().startswith(lines)
    assert [result.index for result in results_of(tmp_path / "out")] == [0, 1, 2, 3]
    assert summary.attempted == 4
    assert reports[0].resumed == 2
    whole = results_of(finished[0])
    assert [facts(a) for a in results_of(tmp_path / "out")] == [facts(b) for b in whole]


def test_resume_makes_attempts_again_whose_episode_is_deleted_or_cut(run, finished, finished_out):
    whole = results_of(finished[0])
    episode = finished_out / next(r.files["episode"] for r in whole if r.success)
    content = episode.read_bytes()
    for spoil in (episode.unlink, lambda: episode.write_bytes(content[:-100])):
        spoil()
        reports = []
        summary = run(episodes=4, resume=True, on_progress=reports.append)
        assert (reports[0].resumed, summary.attempted) == (3, 4)
        assert [facts(a) for a in results_of(finished_out)] == [facts(b) for b in whole]
        assert episode.read_bytes() == content


def test_resume_of_a_finished_run_starts_no_worker(run, finished_out):
    limits = Limits(build_seconds=1e-9)
    assert run(episodes=4, resume=True, limits=limits).attempted == 4
    assert len(json.loads((finished_out / "run.json").read_text())["commands"]) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": 1}, "its seed is 0, this run's is 1"),
        ({"task": "FoldDress-v1"}, "its task is 'FoldTops-v1'"),
        (
            {"options": {"seconds": 0.0}},
            r"options: its seconds is not given, this run's is 0\.0; choose another",
        ),
    ],
)
@pytest.mark.usefixtures("finished_out")
def test_resume_refuses_another_run(run, change, message):
    with pytest.raises(OutputFolderError, match=message):
        run(resume=True, **change)


def test_a_folder_in_use_or_not_ours_is_refused(run, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("precious")
    with pytest.raises(OutputFolderError, match="not empty; add --resume"):
        run()
    with pytest.raises(OutputFolderError, match="holds no run to resume"):
        run(resume=True)
    assert files_of(out) == ["thesis.tex"]
    with pytest.raises(OutputFolderError, match=r"cannot write to .*thesis"):
        run(out=out / "thesis.tex" / "out")


def test_two_runs_cannot_share_a_folder(run, finished_out):
    folder = opened_run(finished_out, read_run(finished_out), resume=True)
    with folder, pytest.raises(OutputFolderError, match="another run is writing"):
        run(resume=True)


def test_an_exception_is_a_result_and_the_run_goes_on(run, tmp_path):
    summary = run(episodes=4, options={"raise_at": [1]})
    result = results_of(tmp_path / "out")[1]
    assert (result.reason, result.detail) == ("exception: RuntimeError", "the cloth exploded")
    assert summary.attempted == 4
    assert summary.reasons["exception: RuntimeError"] == 1


def test_an_attempt_that_crashes_each_time_is_a_result_with_its_reason(run, tmp_path):
    summary = run(episodes=4, options={"exit_at": [1]})
    result = results_of(tmp_path / "out")[1]
    assert result.reason == "worker crashed"
    assert result.detail == "exit status 3, 5 times (see logs/worker-0.log)"
    assert (summary.attempted, summary.status) == (4, "complete")
    assert not (tmp_path / "out/.staging").exists()


def test_memory_that_is_used_up_is_no_result_of_the_attempt(run, finished, tmp_path):
    run(episodes=2, options={"use_up_memory_once_at": [0], "marks": str(tmp_path)})
    assert [facts(a) for a in results_of(tmp_path / "out")] == [
        facts(b) for b in results_of(finished[0])[:2]
    ]


def test_a_full_disk_ends_the_run_and_is_no_result(run, finished, tmp_path):
    options = {"fill_disk_once_at": [1], "marks": str(tmp_path)}
    with pytest.raises(MachineError, match=r"the disk is full: .*film"):
        run(episodes=4, options=options)
    assert [result.index for result in results_of(tmp_path / "out")] == [0]
    assert json.loads((tmp_path / "out/summary.json").read_text())["status"] == "failed"
    assert run(episodes=4, options=options, resume=True).attempted == 4
    assert [facts(a) for a in results_of(tmp_path / "out")] == [
        facts(b) for b in results_of(finished[0])
    ]


def test_a_line_that_finds_no_room_is_taken_back(run, tmp_path, monkeypatch):
    lines = []

    def append(path, line):
        if len(lines) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        lines.append(line)
        append_line(path, line)

    with monkeypatch.context() as patch:
        patch.setattr(run_folder, "append_line", append)
        with pytest.raises(MachineError, match="the disk is full"):
            run(episodes=4)
    assert len(results_of(tmp_path / "out")) == 2
    assert run(episodes=4, resume=True).attempted == 4


@pytest.fixture
def small_disk(tmp_path):
    """A disk of 3 MB."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=3m", "tmpfs", str(folder)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("mounting a small disk needs rights")
    yield folder
    subprocess.run(["umount", "--lazy", str(folder)], check=True)


def test_a_small_disk_loses_nothing_and_the_run_goes_on_elsewhere(
    run, finished, small_disk, tmp_path
):
    with pytest.raises(MachineError, match="the disk is full"):
        run(out=small_disk / "out", episodes=4, options={"film_bytes": 800_000})
    done = results_of(small_disk / "out")
    assert 1 <= len(done) < 4
    for result in done:
        assert all((small_disk / "out" / path).is_file() for path in result.files.values())
    moved = shutil.copytree(small_disk / "out", tmp_path / "out")
    assert run(out=moved, episodes=4, options={"film_bytes": 800_000}, resume=True).attempted == 4
    assert [facts(a) for a in results_of(moved)] == [facts(b) for b in results_of(finished[0])]


def test_an_attempt_that_hangs_is_ended(run, tmp_path):
    run(episodes=2, options={"hang_at": [0]}, limits=Limits(job_seconds=0.05))
    late, fine = results_of(tmp_path / "out")
    assert (late.reason, fine.reason == "time limit") == ("time limit", False)


@pytest.mark.slow
def test_a_process_that_hangs_is_ended(run_processes, tmp_path):
    run_processes(episodes=2, options={"hang_at": [0]}, limits=Limits(job_seconds=1.5))
    late, fine = results_of(tmp_path / "out")
    assert (late.reason, fine.reason == "time limit") == ("time limit", False)


def test_an_environment_that_is_never_ready_ends_the_run(run_processes):
    with pytest.raises(WorkerError, match=r"building took longer than 0\.01 s"):
        run_processes(limits=Limits(build_seconds=0.01, crashes_in_a_row=1))


def test_crash_after_crash_gives_up_and_keeps_the_results(run, tmp_path):
    limits = Limits(crashes=1, crashes_in_a_row=2)
    with pytest.raises(WorkerError, match="2 workers in a row ended early"):
        run(episodes=9, options={"exit_at": [1, 2]}, limits=limits)
    assert [result.index for result in results_of(tmp_path / "out")] == [0, 1, 2]
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert (summary["status"], summary["attempted"]) == ("failed", 3)


def test_an_environment_that_cannot_be_built_ends_the_run(run, tmp_path):
    with pytest.raises(WorkerError, match="cannot be built: RuntimeError: no Vulkan device"):
        run(options={"fail_when_built": True})
    with pytest.raises(WorkerError, match="exit status 4"):
        run(
            out=tmp_path / "b", options={"exit_when_built": True}, limits=Limits(crashes_in_a_row=1)
        )


def test_a_policy_of_the_wrong_form_ends_the_run_and_keeps_the_results(run, tmp_path):
    """Every further attempt would fail alike."""
    with pytest.raises(
        WorkerError, match=r"-00002: actions must have shape \(N, 60\); got \(1, 59\)"
    ):
        run(episodes=9, options={"give_wrong_actions_at": [2]})
    assert [result.index for result in results_of(tmp_path / "out")] == [0, 1]


@pytest.mark.slow
def test_a_script_without_a_guard_is_told_what_it_needs(tmp_path, fakes):
    script = tmp_path / "mine.py"
    script.write_text(
        "import sys\n"
        f"sys.path.append({str(Path(fakes.__file__).parent)!r})\n"
        "from pathlib import Path\n"
        "from dgl_collect import CollectConfig, collect\n"
        f"out = Path({str(tmp_path / 'out')!r})\n"
        "config = CollectConfig(task='FoldTops-v1', episodes=2, out=out, "
        f"attempt_factory={fakes.FACTORY!r})\n"
        "collect(config)\n"
    )
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 1
    assert "put its calls under `if __name__ == '__main__':`\n" in done.stderr


def test_a_success_without_its_episode_is_not_a_success(run, tmp_path):
    success = SUCCESSES[0]
    run(episodes=success + 1, options={"forget_file_at": [success]})
    result = results_of(tmp_path / "out")[success]
    assert "must have an episode file" in result.detail


def test_an_evaluation_leaves_no_episodes(run, tmp_path):
    success = SUCCESSES[0]
    run(episodes=success + 1, options={"forget_file_at": [success]}, has_episodes=False)
    result = results_of(tmp_path / "out")[success]
    assert result.success
    assert set(result.files) == {"video", "picture"}


def test_numbers_are_checked(run):
    with pytest.raises(ValueError, match="episodes should be greater than or equal to 1; got 0"):
        run(episodes=0)
    with pytest.raises(ValueError, match="workers must be at least 1; got 0"):
        Workers(count=0)
    with pytest.raises(ValueError, match="address is for engine ray; got engine local"):
        Workers(address="auto")
    with pytest.raises(ValueError, match="job_seconds should be greater than 0; got 0"):
        Limits(job_seconds=0)


def test_an_unknown_task_is_refused_before_the_folder_is_made(run, tmp_path):
    with pytest.raises(UnknownTaskError, match="FoldTops-v1"):
        run(task="foldtop")
    assert not (tmp_path / "out").exists()


def test_collect_works_outside_the_main_thread(run):
    found = []
    thread = threading.Thread(target=lambda: found.append(run(episodes=1).status))
    thread.start()
    thread.join(20)
    assert found == ["complete"]


@pytest.mark.usefixtures("heeds_interrupts")
@pytest.mark.parametrize(
    ("number", "least"),
    [pytest.param(signal.SIGTERM, 3, marks=pytest.mark.slow), (signal.SIGINT, 0)],
)
def test_an_interrupt_keeps_what_has_finished(tmp_path, number, least, fakes):
    """The whole process group is signalled, as a terminal does; also while workers are starting."""
    out = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, fakes.__file__, str(out)],
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        for line in process.stdout:
            if int(line) >= least:
                break
        os.killpg(process.pid, number)
        errors = process.stderr.read()
        assert process.wait(60) == 130
    assert errors == ""
    results = results_of(out)
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["status"], summary["attempted"]) == ("interrupted", len(results))
    assert least <= len(results) < 200  # it does not finish what is left first
    assert {result.reason for result in results} <= {None, "too little inside the box"}
    kept = {path for result in results for path in result.files.values()}
    assert kept == {path for path in files_of(out) if path.startswith(("episodes", "failed"))}
    for path in (out / "episodes").glob("*.h5"):
        read_episode(path)
    assert not (out / ".staging").exists()
    assert [path for path in out.rglob("*") if ".partial" in path.name] == []


@pytest.mark.slow
def test_workers_end_when_the_run_is_killed(tmp_path, fakes):
    out = tmp_path / "out"
    with subprocess.Popen(
        [sys.executable, fakes.__file__, str(out)], stdout=subprocess.PIPE, text=True
    ) as process:
        for line in process.stdout:
            if int(line) >= 1:
                break
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
    deadline = time.monotonic() + 60  # on a busy machine too
    while any(Path(f"/proc/{child}").exists() for child in children):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_run_goes_on_with_the_same_demonstration_alone(run, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text((FOLDER / "FoldTops.json").read_text())
    settings = {"options": RunOptions(demonstration=file)}
    assert run(**settings).attempted == 2
    assert run(**settings, episodes=3, resume=True).attempted == 3
    file.write_text(file.read_text().replace("0.94", "0.95"))
    with pytest.raises(OutputFolderError, match="was begun with another demonstration"):
        run(**settings, episodes=4, resume=True)


def test_a_run_goes_on_with_the_same_declaration_alone(run, tmp_path):
    file = tmp_path / "fold_mine.py"
    code = Path(find_spec("dgl_tasks.tasks.fold_tops").origin).read_text()
    file.write_text(code.replace("FoldTops-v1", "FoldMine-v1"))
    settings = {"task": str(file), "resume": True}
    assert run(**settings).attempted == 2
    file.write_text(file.read_text() + "# changed\n")
    with pytest.raises(OutputFolderError, match="was begun with another declaration; undo"):
        run(**settings, episodes=3)
