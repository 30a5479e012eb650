"""Faults of run folders are found, and nothing is changed."""

import dataclasses
import errno
import hashlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from dgl_collect import CollectConfig, collect
from dgl_collect.attempt import describe_episode
from dgl_collect.attempt_jobs import make_attempt_seed
from dgl_collect.errors import FileUnavailableError
from dgl_collect.results import drop_lost_attempts, read_results, summarize
from dgl_collect.verify import verify_run
from dgl_collect.video import VideoWriter, save_png
from dgl_files.whole import write_json
from dgl_tasks.errors import PolicyUnavailableError

GOOD, BAD = (
    next(k for k in range(8) if (make_attempt_seed(0, k) % 2 == 0) == success)
    for success in (True, False)
)
COUNT = max(GOOD, BAD) + 1


@pytest.fixture(scope="module")
def whole(tmp_path_factory, request):
    """The folder of a run with a success and a failure."""
    out = tmp_path_factory.mktemp("whole") / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parent))
        import dgl_collect_fakes as fakes

        fakes.work_here(patch)
        config = CollectConfig(
            task="FoldTops-v1", episodes=COUNT, attempt_factory=fakes.FACTORY, out=out
        )
        collect(config)
    for film in out.glob("*/*.mp4"):  # the made-up attempts' are none
        film.unlink()
        with VideoWriter(film) as video:
            video.add(np.full((16, 16, 3), int(film.stem[-1]) * 20, np.uint8))
    lines = [json.loads(line) for line in (out / "attempts.jsonl").read_text().splitlines()]
    for line in lines:
        film = out / line["files"]["video"]
        line["checksums"]["video"] = hashlib.sha256(film.read_bytes()).hexdigest()
    (out / "attempts.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return out


@pytest.fixture
def out(whole, tmp_path):
    return Path(shutil.copytree(whole, tmp_path / "out"))


def find_faults(out):
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    faults = [fault for _, fault in verify_run(out) if fault]
    assert before == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    return faults


def edit_line(out, index, **changes):
    path = out / "attempts.jsonl"
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    for line in lines:
        if line["index"] == index:
            line |= changes
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def edit_episode(out, **attributes):
    with h5py.File(out / f"episodes/FoldTops-v1-s0-{GOOD:05d}.h5", "r+") as file:
        for name, value in attributes.items():
            file.attrs[name] = value


def edit_summary(out, **changes):
    path = out / "summary.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def add_note(out):
    with h5py.File(out / f"episodes/FoldTops-v1-s0-{GOOD:05d}.h5", "r+") as file:
        file.attrs["note"] = "what readers pass over"


def change_byte(path):
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)


def swap(first, second):
    a, b = first.read_bytes(), second.read_bytes()
    first.write_bytes(b)
    second.write_bytes(a)


def forget_last_attempt(out):
    path = out / "attempts.jsonl"
    lines = path.read_text().splitlines(keepends=True)
    for file in json.loads(lines[-1])["files"].values():
        (out / file).unlink()
    path.write_text("".join(lines[:-1]))
    results = read_results(path)
    summary = json.loads((out / "summary.json").read_text())
    kept = {name: summary[name] for name in ("task", "seed", "requested", "status", "versions")}
    write_json(out / "summary.json", dataclasses.asdict(summarize(results, **kept)))


def append(path, text):
    path.write_text(path.read_text() + text)


def damage(path, count=5000):
    path.write_bytes(path.read_bytes()[:-count])


def test_a_whole_run_has_no_fault(whole):
    assert find_faults(whole) == []
    assert len({path for path, _ in verify_run(whole)}) == len(
        [path for path in whole.rglob("*") if path.is_file() and path.suffix != ".log"]
    )


STEM, OTHER = f"FoldTops-v1-s0-{GOOD:05d}", f"FoldTops-v1-s0-{BAD:05d}"


FAULTS = (
    (lambda o: (o / "run.json").unlink(), "holds no run"),
    (lambda o: (o / "run.json").write_text("{}"), r"run.json: run_format: field required"),
    (lambda o: append(o / "attempts.jsonl", '{"index": 9'), "last line is not finished"),
    (lambda o: edit_line(o, GOOD, seed=5), f"attempt {GOOD}: its seed must be .* got 5"),
    (lambda o: edit_line(o, GOOD, success=0.5), "success should be a valid boolean; got 0.5"),
    (lambda o: edit_line(o, BAD, success=True, reason=None),
        "called a success, and 'inside' is not"),
    (lambda o: edit_line(o, GOOD, success=False, reason="x"),
        "called a failure .* all criteria are met"),
    (lambda o: edit_line(o, GOOD, garment_id="tops/0"),
        "has garment .*; attempts.jsonl says tops/0"),
    (lambda o: edit_line(o, GOOD, files={"picture": "../x.png"}),
        "picture file must lie in the run"),
    (lambda o: edit_line(o, GOOD, files={"picture": f"failed/{STEM}.png"}), "must be episodes/"),
    (lambda o: (o / f"episodes/{STEM}.h5").unlink(),
        f"{STEM}.h5 is missing; --resume makes the attempt again"),
    (lambda o: damage(o / f"episodes/{STEM}.h5"),
        f"{STEM}.h5: not a whole HDF5 file .*; remove it; --resume makes the attempt again"),
    (lambda o: (o / f"episodes/{STEM}.mp4").write_bytes(b"film"), f"{STEM}.mp4 cannot be read"),
    (lambda o: (o / f"episodes/{STEM}.png").write_bytes(b"x"), f"{STEM}.png is no PNG picture"),
    (lambda o: (o / f"episodes/{STEM}.png").write_text("text " * 99),
        f"{STEM}.png is no PNG picture"),
    (lambda o: edit_episode(o, seed=7), f"{STEM}.h5 has seed 7; attempts.jsonl says"),
    (lambda o: edit_episode(o, success=np.bool_(0)), "has success False; attempts.jsonl says True"),
    (lambda o: save_png(o / "episodes/left.png", np.zeros((4, 4, 3), np.uint8)),
        "no attempt .* names it"),
    (lambda o: (o / "summary.json").unlink(), "summary.json is missing"),
    (lambda o: edit_summary(o, succeeded=77), "succeeded is 77; the lines"),
    (lambda o: edit_summary(o, success_rate=0.0), "success_rate is 0.0; the lines"),
    (lambda o: edit_summary(o, seconds_per_attempt={}), "seconds_per_attempt is {}; the lines"),
    (lambda o: edit_summary(o, requested="4"), "summary.json: requested .*integer"),
    (lambda o: edit_line(o, GOOD, seconds=-1.0),
        "seconds should be greater than or equal to 0; got -1.0"),
    (lambda o: edit_line(o, GOOD, randomisation={"x": 9}),
        f"{STEM}.h5 has draw 'x' .*attempts.jsonl says 9"),
    (lambda o: edit_line(o, GOOD, measurements={}),
        f"{STEM}.h5 has measurement 'max_strain_mean' 0.1; .*says None"),
    (lambda o: edit_line(o, GOOD, checksums={}),
        f"{STEM}.mp4: attempts.jsonl holds no SHA-256 of it"),
    (add_note, f"{STEM}.h5: it was changed since the run wrote it"),
    (lambda o: change_byte(o / f"episodes/{STEM}.mp4"), f"{STEM}.mp4: it was changed"),
    (lambda o: swap(o / f"episodes/{STEM}.mp4", o / f"failed/{OTHER}.mp4"),
        f"{OTHER}.mp4: it was changed"),
    (lambda o: swap(o / f"episodes/{STEM}.png", o / f"failed/{OTHER}.png"),
        f"{STEM}.png: it was changed"),
    (forget_last_attempt, f"called complete, and attempt {COUNT - 1} of {COUNT} is missing"),
)  # fmt: skip


def test_faults_are_found_and_nothing_is_changed(whole, tmp_path):
    missed = []
    for number, (edit, message) in enumerate(FAULTS):
        out = Path(shutil.copytree(whole, tmp_path / str(number)))
        edit(out)
        found = find_faults(out)
        if not any(re.search(message, fault) for fault in found):
            missed.append((number, message, found))
        shutil.rmtree(out)
    assert missed == []


def test_a_line_that_is_no_result_does_not_end_the_check(out):
    lines = (out / "attempts.jsonl").read_text().splitlines(keepends=True)
    (out / "attempts.jsonl").write_text("".join(["{}\n", "[" * 9 + "\n", *lines, lines[GOOD]]))
    (out / f"episodes/{STEM}.png").write_bytes(b"x")
    faults = find_faults(out)
    assert [re.search(r"line (\d+)", fault)[1] for fault in faults[:3]] == [
        "1",
        "2",
        str(COUNT + 3),
    ]
    assert faults[3:] == [f"{out}/episodes/{STEM}.png is no PNG picture"]


def test_a_locked_or_forbidden_file_stops_the_check(out, monkeypatch):
    with subprocess.Popen(
        [sys.executable, "-c",
         "import h5py,sys; f=h5py.File(sys.argv[1],'r+'); print(flush=True); input()",
         out / f"episodes/{STEM}.h5"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as other:  # fmt: skip
        other.stdout.readline()
        with pytest.raises(FileUnavailableError, match="another process has locked it"):
            list(verify_run(out))
        other.communicate(b"\n")
    read = Path.read_bytes

    def refuse(path):
        if path.suffix == ".mp4":
            raise PermissionError(errno.EACCES, "no", str(path))
        return read(path)

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(FileUnavailableError, match=r"mp4 cannot be read now: permission denied"):
        list(verify_run(out))


def test_attempts_whose_episode_is_lost_are_dropped_and_others_kept(out):
    before = (out / "attempts.jsonl").read_bytes()
    assert [result.index for result in drop_lost_attempts(out)] == list(range(COUNT))
    assert (out / "attempts.jsonl").read_bytes() == before
    left = [index for index in range(COUNT) if index != GOOD]
    path = out / f"episodes/{STEM}.h5"
    content = path.read_bytes()
    for spoil in (
        path.unlink,
        lambda: path.write_bytes(b""),
        lambda: path.write_bytes(content[:-9]),
    ):
        (out / "attempts.jsonl").write_bytes(before)
        spoil()
        assert [result.index for result in drop_lost_attempts(out)] == left
        assert [result.index for result in read_results(out / "attempts.jsonl")] == left


def test_an_attempt_whose_policy_server_was_lost_is_dropped(out):
    lost = describe_episode(
        PolicyUnavailableError("ws://127.0.0.1:9: the connection is lost"),
        index=COUNT,
        seed=0,
        measurements={},
    )
    with (out / "attempts.jsonl").open("a") as file:
        file.write(f"{lost.to_line()}\n")
    assert len(read_results(out / "attempts.jsonl")) == COUNT + 1
    assert [result.index for result in drop_lost_attempts(out)] == list(range(COUNT))
