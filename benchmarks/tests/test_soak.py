"""`dgl bench soak`: which episodes it runs, what it counts, and a few actions for real."""

import dataclasses

import numpy as np
import pytest

from dgl_bench.soak import SoakConfig, Spell, list_requests, make_rows
from dgl_bench.soak.rows import find_growth
from dgl_bench.soak.spell import SpellRequest, Spells
from dgl_physics import ContactOverflowError, SimulationDivergedError
from dgl_tasks.env import GarmentEnv
from dgl_tasks.errors import UnknownTaskError
from dgl_tasks.tasks import task_ids


def make_spell(number=0, *, process=1, memory=100, task="FoldTops-v1", **changes):
    request = SpellRequest(task=task, number=number, seed=number, steps=10)
    content = {"steps": 10, "touching": 4, "not_finite": 0, "overflows": 0, "error": ""}
    return Spell(request=request, process=process, memory=memory, **(content | changes))


def test_tasks_come_by_turns_and_steps_add_up():
    requests = list_requests(SoakConfig(steps=1250, episode=100))
    assert [request.task for request in requests[:13]] == list(task_ids())
    assert sum(request.steps for request in requests) == 1250
    assert len({request.seed for request in requests}) == len(requests) == 13
    assert requests == list_requests(SoakConfig(steps=1250, episode=100))
    assert requests[0].seed != list_requests(SoakConfig(seed=1))[0].seed


def test_wrong_numbers_and_tasks_are_refused():
    with pytest.raises(ValueError, match="steps must be at least 1; got 0"):
        SoakConfig(steps=0)
    with pytest.raises(UnknownTaskError, match="did you mean 'FoldTops-v1'"):
        SoakConfig(tasks=("FoldTop-v1",))


def test_growth_is_of_the_process_that_has_grown_most():
    steady = [make_spell(k, memory=100 + (k % 3)) for k in range(30)]
    assert find_growth(steady) == pytest.approx(0.0)
    leaks = [make_spell(k, process=2, memory=100 + k) for k in range(30)]
    assert find_growth(steady + leaks) == pytest.approx(100 * (129 / 102 - 1))
    assert find_growth(steady[:9]) is None
    by_turns = [make_spell(k, task=f"T{k % 8}", memory=100 + 10 * min(k, 8)) for k in range(10)]
    assert find_growth(by_turns) == pytest.approx(100 * (180 / 170 - 1))


def test_faults_are_counted_and_told_with_their_seed():
    spells = [make_spell(k) for k in range(20)]
    spells[3] = make_spell(3, error="SimulationDivergedError: step 5", steps=5)
    spells[4] = make_spell(4, error="lists of shapes", overflows=1)
    spells[5] = make_spell(5, not_finite=2)
    rows = {row.name: row for row in make_rows(spells)}
    assert rows["random actions"].value == 195
    assert rows["numbers that are not finite"].value == 2
    assert rows["contact lists that could not grow"].value == 1
    assert rows["exceptions"].value == 1
    assert rows["exceptions"].note == "FoldTops-v1, seed 3: SimulationDivergedError: step 5"
    assert [row.name for row in rows.values() if row.ok is False] == [
        "numbers that are not finite", "contact lists that could not grow", "exceptions",
    ]  # fmt: skip
    assert not [row for row in make_rows([make_spell(k) for k in range(20)]) if row.ok is False]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")
@pytest.mark.filterwarnings("ignore:Deprecated member:UserWarning")
def test_a_spell_is_repeated_by_its_seed_and_tells_what_goes_wrong(monkeypatch, tmp_path):
    request = SpellRequest(task="FoldTops-v1", number=0, seed=5, steps=8)
    spells = Spells()
    first, second = spells.run(request, tmp_path), spells.run(request, tmp_path)
    assert (first.steps, first.error, first.not_finite, first.overflows) == (8, "", 0, 0)
    assert dataclasses.replace(second, memory=first.memory) == first
    assert first.memory > 1e8
    monkeypatch.setattr(GarmentEnv, "step", lambda env, action: (None, np.nan, False, False, {}))
    spell = spells.run(request, tmp_path)
    assert (spell.steps, spell.not_finite, spell.error) == (8, 8, "")
    for error, overflows in ((ContactOverflowError("x"), 1), (SimulationDivergedError(3, [0]), 0)):

        def fail(env, action, error=error):
            raise error

        monkeypatch.setattr(GarmentEnv, "step", fail)
        spell = spells.run(request, tmp_path)
        assert (spell.steps, spell.overflows, bool(spell.error)) == (0, overflows, True)
    spells.close()
