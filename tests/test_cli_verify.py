"""The verb `verify`, on folders of made-up runs."""

import json

import pytest

from dexgarmentlab.cli import main
from dgl_collect import AttemptResult
from dgl_collect.attempt_jobs import make_attempt_seed
from dgl_collect.run_folder import RunRecord, opened_run

RUN = RunRecord(
    run_format=1,
    task="FoldTops-v1",
    seed=1_000_003,
    attempt_factory="m:f",
    options={},
    versions={},
    commands=("dgl",),
)


@pytest.fixture
def evaluation(tmp_path):
    """An evaluation of two episodes of seed 3, one of them a success."""
    out = tmp_path / "eval"
    runs = []
    with opened_run(out / "seed-3", RUN, resume=False) as folder:
        for index, success in enumerate((True, False)):
            result = AttemptResult(
                index=index,
                seed=make_attempt_seed(RUN.seed, index),
                success=success,
                reason=None if success else "on the ground",
            )
            folder.commit(result, tmp_path / "none")
            runs.append(
                {"seed": 3, "episode": index, "episode_seed": result.seed, "garment": None,
                 "success": success, "first_try": success, "value": None}
            )  # fmt: skip
        folder.write_summary(requested=2, status="complete")
    content = {"format": 1, "task": "FoldTops-v1", "policy": "x", "friction": 1.0, "runs": runs}
    (out / "results.json").write_text(json.dumps(content))
    return out


def test_a_whole_evaluation_has_no_fault(evaluation, capsys):
    assert main(["verify", str(evaluation)]) == 0
    assert f"{evaluation}: 4 files, no fault" in capsys.readouterr().out


def test_results_that_say_otherwise_than_the_lines_are_found(evaluation, capsys):
    path = evaluation / "results.json"
    path.write_text(path.read_text().replace('"success": false', '"success": true'))
    assert main(["verify", str(evaluation), "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found["files"] == 4
    (fault,) = found["faults"]
    assert "episode 1 of seed 3 is a success with the seed" in fault
    assert "of seed-3 says a failure" in fault


def test_a_run_of_an_evaluation_is_checked_too(evaluation, capsys):
    (evaluation / "seed-3/summary.json").unlink()
    assert main(["verify", str(evaluation)]) == 1
    assert "summary.json is missing" in capsys.readouterr().out


def test_another_folder_is_refused(tmp_path, capsys):
    assert main(["verify", str(tmp_path)]) == 1
    assert "must be the folder of a collection or an evaluation" in capsys.readouterr().err


def test_attempts_that_are_not_made_yet_are_told_and_no_fault(tmp_path, capsys):
    out = tmp_path / "out"
    with opened_run(out, RUN, resume=False) as folder:
        seed = make_attempt_seed(RUN.seed, 1)
        result = AttemptResult(index=1, seed=seed, success=False, reason="on the ground")
        folder.commit(result, tmp_path / "none")
        folder.write_summary(requested=4, status="interrupted")
    assert main(["verify", str(out)]) == 0
    told = capsys.readouterr().out
    assert "not complete: attempts 0, 2, 3 are not made yet; --resume makes them" in told
    assert "no fault" in told
