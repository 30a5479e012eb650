"""Rows of a soak."""

from collections.abc import Sequence

from dgl_bench.rows import Reading
from dgl_bench.soak.spell import Spell

__all__ = ["find_growth", "make_rows"]

EARLY = 0.1
"""Share of a worker's episodes in which memory may still grow: caches fill."""


def make_rows(spells: Sequence[Spell]) -> list[Reading]:
    """Count what went wrong, and measure how memory has grown.

    Args:
        spells: Episodes in the order in which they ended.
    """
    steps = sum(spell.steps for spell in spells)
    errors = [spell for spell in spells if spell.error and not spell.overflows]
    first = (
        f"{errors[0].request.task}, seed {errors[0].request.seed}: {errors[0].error}"
        if errors
        else ""
    )
    touching = sum(spell.touching for spell in spells)
    growth = find_growth(spells)
    name = "growth of a process's memory after the first tenth, at most"
    grown = Reading(name, growth, "%", bar="<= 5")
    if growth is None:
        why = "a process needs ten episodes, and two of each task"
        grown = Reading.skip(name, "%", why, bar="<= 5")
    return [
        Reading("random actions", float(steps), "", note="five control steps each"),
        Reading("with a hand on the garment", 100 * touching / max(steps, 1), "%"),
        Reading(
            "numbers that are not finite",
            float(sum(spell.not_finite for spell in spells)),
            "actions",
            bar="<= 0",
        ),
        Reading(
            "contact lists that could not grow",
            float(sum(spell.overflows for spell in spells)),
            "",
            bar="<= 0",
        ),
        Reading("exceptions", float(len(errors)), "", bar="<= 0", note=first),
        grown,
        Reading(
            "memory of a process, at most",
            max((spell.memory for spell in spells), default=0) / 2**30,
            "GiB",
        ),
    ]


def find_growth(spells: Sequence[Spell]) -> float | None:
    """Find the largest growth of a process's memory after the first tenth of its episodes [%].

    Compared are the largest values of the first tenth, or of the first episode of each task where
    that is longer, and of the last tenth.

    Args:
        spells: In the order in which they ended.

    Returns:
        The growth; None where no process has run ten episodes.
    """
    tasks = len({spell.request.task for spell in spells})
    growths = []
    for process in {spell.process for spell in spells if spell.process}:
        memory = [spell.memory for spell in spells if spell.process == process]
        early = max(round(EARLY * len(memory)), tasks)
        late = max(round(EARLY * len(memory)), 1)
        if len(memory) >= max(10, early + late):
            growths.append(100 * (max(memory[-late:]) / max(memory[:early]) - 1))
    return max(growths, default=None)
