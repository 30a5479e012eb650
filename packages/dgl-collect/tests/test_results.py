import json

import pytest

from dgl_collect import AttemptResult, Criterion, OutputFolderError, wilson_interval
from dgl_collect.results import read_results, summarize
from dgl_files.whole import append_line, drop_unfinished_line


def make_result(index, *, success=True, **changes):
    reason = None if success else "slipped"
    return AttemptResult(index=index, seed=7, success=success, **({"reason": reason} | changes))


def test_wilson_interval_has_the_published_values():
    """Values of Newcombe, Statistics in Medicine 17 (1998), table I."""
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson_interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert wilson_interval(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)


def test_wilson_interval_is_symmetric_and_knows_nothing_from_nothing():
    low, high = wilson_interval(3, 20)
    assert wilson_interval(17, 20) == pytest.approx((1 - high, 1 - low))
    assert wilson_interval(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match=r"successes must be in \[0, 2\]; got 3"):
        wilson_interval(3, 2)


@pytest.mark.parametrize(
    ("comparison", "met"),
    [("<", [1, 0, 0]), ("<=", [1, 1, 0]), (">", [0, 0, 1]), (">=", [0, 1, 1])],
)
def test_a_criterion_on_both_sides_of_its_threshold(comparison, met):
    for value, expected in zip((0.4, 0.5, 0.6), met, strict=True):
        criterion = Criterion(name="x", value=value, comparison=comparison, threshold=0.5)
        assert criterion.is_met == bool(expected)


def test_a_line_of_before_beliefs_were_kept_is_still_read():
    line = '{"index": 3, "seed": 7, "success": false, "reason": "slipped"}'
    result = AttemptResult.from_line(line)
    assert (result.first_try, result.beliefs) == (False, {})


def test_a_line_gives_the_result_back():
    criterion = Criterion(name="inside", value=0.5, comparison=">=", threshold=0.8)
    result = make_result(
        3,
        success=False,
        first_try=True,
        criteria=(criterion,),
        files={"video": "a.mp4"},
        beliefs={"value": 0.9},
    )
    assert "\n" not in result.to_line()
    assert AttemptResult.from_line(result.to_line()) == result


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"success": True, "reason": "x"}, "reason must be None"),
        ({"success": False, "reason": None}, "reason must be given"),
        ({"value": float("nan")}, "finite"),
        ({"beliefs": {"flat_area": float("inf")}}, "finite"),
        ({"randomisation": {"x": object()}}, "JSON-ready"),
    ],
)
def test_a_contradictory_result_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        make_result(0, **change)


def test_results_come_back_in_order_and_without_a_broken_last_line(tmp_path):
    path = tmp_path / "attempts.jsonl"
    for index in (2, 0):
        append_line(path, make_result(index).to_line())
    with path.open("a") as file:
        file.write(make_result(5).to_line()[:20])
    assert [result.index for result in read_results(path)] == [0, 2]
    drop_unfinished_line(path)
    append_line(path, make_result(1).to_line())
    assert [result.index for result in read_results(path)] == [0, 1, 2]


def test_broken_and_repeated_lines_are_refused(tmp_path):
    path = tmp_path / "attempts.jsonl"
    path.write_text("{}\n")
    with pytest.raises(OutputFolderError, match="line 1"):
        read_results(path)
    path.write_text(f"{make_result(1).to_line()}\n" * 2)
    with pytest.raises(OutputFolderError, match="attempt 1 is there twice"):
        read_results(path)


def test_the_summary_counts():
    results = [
        make_result(0, seconds=1.0, garment_id="b", first_try=True),
        make_result(1, seconds=3.0, garment_id="a", success=False),
        make_result(2, seconds=8.0, garment_id="b", success=False),
    ]
    summary = summarize(
        results, task="FoldTops-v1", seed=0, requested=4, status="interrupted", versions={}
    )
    assert (summary.attempted, summary.succeeded, summary.succeeded_first) == (3, 1, 1)
    assert summary.success_rate == pytest.approx(1 / 3)
    assert summary.seconds_per_attempt == {"median": 3.0, "mean": 4.0}
    assert summary.garments["b"] == {"attempted": 2, "succeeded": 1}
    assert list(summary.garments) == ["a", "b"]
    assert summary.reasons == {"slipped": 2}


def test_a_first_try_counts_by_what_was_true_then():
    """Whatever became of it, and however often something was done again."""
    again = {"further_rounds": 1.0, "further_tries": 2.0}
    results = [
        make_result(0, first_try=True),
        make_result(1, first_try=False, measurements=again),
        make_result(2, first_try=True, measurements=again),  # done again for nothing
        make_result(3, success=False, first_try=True, measurements=again),  # undone
        make_result(4, success=False, first_try=False),
    ]
    summary = summarize(results, task="x", seed=0, requested=5, status="complete", versions={})
    assert (summary.succeeded, summary.succeeded_first) == (3, 3)
    assert not make_result(5).first_try  # what is not said is not claimed


def test_the_summary_of_nothing_is_valid_json():
    summary = summarize([], task="x", seed=0, requested=1, status="interrupted", versions={})
    assert summary.success_rate is None
    json.dumps(summary.seconds_per_attempt, allow_nan=False)
