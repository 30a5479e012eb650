"""`dgl bench collect`: the stopwatch, the rows, the comparison of workers, and a real attempt."""

import itertools
import json

import pytest

import dgl_bench
from dexgarmentlab.cli import main
from dgl_bench.collect import Plan, measure_collection
from dgl_bench.collect.components import COMPONENTS, REST, STEP
from dgl_bench.collect.rows import (
    make_memory_rows,
    make_start_rows,
    make_task_rows,
    make_worker_rows,
    select_median,
)
from dgl_bench.collect.stopwatch import Stopwatch, find_owner, watch_functions
from dgl_bench.collect.throughput import compare_throughput
from dgl_bench.collect.timed import AttemptTimes, TimedAttempts
from dgl_collect import AttemptRequest, AttemptResult


class Hand:
    """Stand-in with methods to watch."""

    def hold(self, cloth=None):
        return cloth


class Glove(Hand):
    """Inherits what is watched."""


HOLD, WEAR = f"{__name__}:Hand.hold", f"{__name__}:Glove.hold"


def make_times(
    seconds, *, index=0, success=True, process=1, began=0.0, elapsed=None, start=None, memory=100
):
    """An attempt whose time is spent equally on all components."""
    names = (*COMPONENTS, REST)
    return AttemptTimes(
        index=index,
        process=process,
        success=success,
        components={name: seconds / len(names) for name in names},
        began=began,
        ended=began + (seconds if elapsed is None else elapsed),
        memory=memory,
        start=start,
        start_elapsed=None if start is None else 2 * start,
    )


def test_a_moment_counts_for_the_innermost_part():
    watch = Stopwatch(itertools.count().__next__)  # a second goes by at every look
    with watch.part("outer"):
        with watch.part("inner"):
            pass
        with pytest.raises(KeyError), watch.part("inner"):
            raise KeyError
    assert watch.seconds == {"outer": 3, "inner": 2}
    assert [at for at, _ in watch.first.values()] == [0, 1]


def test_functions_are_watched_and_then_as_they_were():
    watch, before = Stopwatch(itertools.count().__next__), Hand.hold
    with watch_functions(watch, {"hand": [HOLD], "glove": [WEAR]}), watch.part("rest"):
        assert Hand().hold("top") == Glove().hold("top") == "top"
    assert watch.seconds == {"rest": 3, "hand": 2, "glove": 2}  # which calls the hand's
    assert Hand.hold is before
    assert "hold" not in vars(Glove)
    with pytest.raises(AttributeError), watch_functions(watch, {"hand": [HOLD, HOLD + "s"]}):
        pass
    assert Hand.hold is before


def test_every_component_is_there():
    paths = [path for paths in COMPONENTS.values() for path in paths]
    assert len(set(paths)) == len(paths)
    for path in paths:
        find_owner(path)
    assert STEP in COMPONENTS
    assert REST not in COMPONENTS


class StillRunner:
    """Makes no step in its first attempt."""

    closed = False

    def run(self, request, out_dir):
        if request.index > 0:
            Hand().hold()
        return AttemptResult(index=request.index, seed=request.seed, success=True)

    def close(self):
        self.closed = True


def test_attempts_time_themselves(monkeypatch, tmp_path):
    module = "dgl_bench.collect.timed.COMPONENTS"
    monkeypatch.setattr(module, {STEP: [HOLD]})
    runner = StillRunner()
    timed = TimedAttempts(runner, launched=0.0)
    results = [
        timed.run(AttemptRequest(index=k, seed=k, episode_id=f"{k}"), tmp_path) for k in range(3)
    ]
    times = [AttemptTimes.from_result(result) for result in results]
    assert [t.start is None for t in times] == [True, False, True]  # the first step of the process
    assert all(set(t.components) == {STEP, REST} for t in times)
    assert all(t.elapsed >= 0 for t in times)
    assert all(1e7 < t.memory < 1e11 for t in times)
    timed.close()
    assert runner.closed
    lost = AttemptResult(index=4, seed=0, success=False, reason="worker crashed", detail="killed")
    with pytest.raises(ValueError, match="attempt 4 did not end: worker crashed, killed"):
        AttemptTimes.from_result(lost)


@pytest.mark.parametrize("seconds", [(14, 30, 17), (14, 30, 17, 16)])
def test_components_add_up_to_the_median_attempt(seconds):
    whole, _, *parts = make_task_rows("FoldTops-v1", [make_times(s) for s in seconds])
    assert whole.value == pytest.approx({3: 17, 4: 16.5}[len(seconds)])
    assert whole.ok is True
    assert sum(row.value for row in parts) == pytest.approx(whole.value)
    assert [row.name for row in parts] == [f"FoldTops-v1, {c}" for c in (*COMPONENTS, REST)]


def test_an_attempt_that_fails_costs_time_too():
    attempts = [make_times(19, success=False), make_times(21), make_times(18)]
    whole, elapsed = make_task_rows("FlingTops-v1", attempts)[:2]
    assert (round(whole.value, 6), whole.bar, whole.ok) == (19, "<= 20", True)
    assert "median of 3, 18.0 to 21.0; 2 succeeded" in whole.note
    assert elapsed.value == 19
    assert make_task_rows("FoldDress-v1", attempts)[0].bar == ""


def test_the_quickest_start_counts():
    starts = [make_times(1, start=s) for s in (9.0, 7.0, None)]
    quickest, elapsed = make_start_rows(starts)
    assert (quickest.value, elapsed.value, quickest.ok) == (7.0, 14.0, True)
    assert make_start_rows(starts[2:])[0].is_skipped


def test_memory_may_grow_in_the_first_attempts_alone():
    filling = [make_times(1, index=k, memory=2**30 * min(k + 1, 20)) for k in range(30)]
    at_end, growth = make_memory_rows("FoldTops-v1", filling)
    assert (at_end.value, growth.value, growth.ok) == (20, 0, True)
    leaking = [make_times(1, index=k, memory=100 + k) for k in range(30)]
    growth = make_memory_rows("FoldTops-v1", leaking)[1]
    assert growth.value == pytest.approx(100 * (129 / 119 - 1))
    assert growth.ok is False
    assert len(make_memory_rows("FoldTops-v1", leaking[:20])) == 1
    leaking[25] = make_times(1, process=2)  # after a crash
    assert len(make_memory_rows("FoldTops-v1", leaking)) == 1


def test_two_workers_side_by_side():
    alone = [make_times(10, index=k) for k in range(4)]
    ideal = [make_times(10, index=k, process=k % 2, began=10 * (k // 2)) for k in range(4)]
    found = compare_throughput(alone, ideal, workers=2)
    assert (found.ratio, found.cores, found.processor_ratio) == pytest.approx((2, 2, 2))
    # the first worker makes three attempts and the second one, so long that both end together
    uneven = [make_times(10, index=k, process=1, began=10 * k) for k in range(3)]
    uneven += [make_times(10, index=3, process=2, began=5.0, elapsed=25.0)]
    found = compare_throughput(alone, uneven, workers=2)
    assert found.ratio == pytest.approx((25 + 10) / 25)
    assert found.processor_ratio == pytest.approx(2)
    assert select_median(alone) == alone[1:3]


def test_workers_that_cannot_be_compared(monkeypatch):
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1})
    alone = [make_times(10, index=k) for k in range(2)]
    with pytest.raises(ValueError, match="must make the same attempts"):
        compare_throughput(alone, alone[:1], workers=2)
    with pytest.raises(ValueError, match="2 workers must be busy at the same time"):
        compare_throughput(alone, alone, workers=2)
    [row] = make_worker_rows("FoldTops-v1", alone, alone, workers=2)
    assert row.is_skipped
    assert "make 4 --attempts or more" in row.note
    [row] = make_worker_rows("FoldTops-v1", alone, alone, workers=999)
    assert "this machine has 2 cores; compare fewer" in row.note


def test_a_plan_is_carried_out(monkeypatch):
    asked = []
    monkeypatch.setattr("os.sched_getaffinity", lambda process: {0, 1})

    def make(task, count, workers):
        asked.append((task, count, workers))
        return [make_times(10, index=k, process=k % workers, start=5.0) for k in range(count)]

    plan = Plan()
    names = [row.name for row in measure_collection(plan, make)]
    assert asked == [("FoldTops-v1", 6, 1), ("FlingTops-v1", 1, 1), ("FoldTops-v1", 6, 2)]
    assert plan.total == 13
    assert len(set(names)) == len(names)
    asked.clear()
    plan = Plan(tasks=("FoldDress-v1",), attempts=2, workers=1)
    names = [row.name for row in measure_collection(plan, make)]
    assert asked == [("FoldDress-v1", 2, 1)]
    assert plan.total == 2
    assert not any("worker" in name for name in names if not name.startswith("start"))
    asked.clear()
    plan = Plan(tasks=("FoldDress-v1",), attempts=2)
    *_, last = measure_collection(plan, make)
    assert (asked, plan.total, last.is_skipped) == ([("FoldDress-v1", 2, 1)], 2, True)


def test_rows_as_json(monkeypatch, capsys):
    def make(task, count, workers, *, seed, on_attempt):
        on_attempt(count)
        assert seed == 3
        return [make_times(19, index=k, start=5.0) for k in range(count)]

    monkeypatch.setattr(dgl_bench.collect, "make_attempts", make)
    command = ["bench", "collect", "--task", "FoldTops-v1", "--seed", "3", "--workers", "1"]
    assert main([*command, "--json"]) == 0  # a bar that is missed is a finding
    rows = json.loads(capsys.readouterr().out)
    assert all(list(r) == ["name", "value", "unit", "bar", "ok", "note"] for r in rows)
    assert (round(rows[0]["value"], 6), rows[0]["bar"], rows[0]["ok"]) == (19, "<= 18", False)
    assert main(command) == 0
    assert "FoldTops-v1, PhysX" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--attempts", "0"], "attempts must be at least 1; got 0"),
        (["--workers", "0"], "workers must be at least 1; got 0"),
        (["--seed", "-1"], "seed must be at least 0; got -1"),
        (["--task", "FoldTop-v1"], "FoldTops-v1"),
    ],
)
def test_what_cannot_be_measured_is_refused(arguments, message, capsys):
    assert main(["bench", "collect", *arguments]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_an_attempt_is_timed(capsys):
    command = ["bench", "collect", "--task", "FoldTops-v1", "--attempts", "1", "--workers", "1"]
    assert main([*command, "--json"]) == 0
    rows = {row["name"]: row["value"] for row in json.loads(capsys.readouterr().out)}
    parts = [rows[f"FoldTops-v1, {name}"] for name in (*COMPONENTS, REST)]
    assert min(parts) > 0
    assert sum(parts) == pytest.approx(rows["FoldTops-v1, attempt"])
    assert rows["FoldTops-v1, rest"] < 0.1 * rows["FoldTops-v1, attempt"]
