"""A run of many episodes of random actions, tasks by turns."""

import tempfile
import threading
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dgl_bench.soak.spell import Spell, SpellRequest
from dgl_collect.workers import Dispatcher, Job, Work, Workers
from dgl_tasks import load_task, task_ids

__all__ = ["SoakConfig", "list_requests", "soak"]


@dataclass(frozen=True, kw_only=True)
class SoakConfig:
    """Length and tasks of a soak.

    Raises:
        ValueError: If a number is out of its range.
        UnknownTaskError: If a task does not exist.
    """

    steps: int = 20_000
    """Actions in all, each of five control steps; at least one."""
    episode: int = 100
    """Actions of an episode; at least one."""
    tasks: tuple[str, ...] = ()
    """Tasks; all of them when none is named."""
    seed: int = 0
    """Of everything drawn; at least 0."""

    def __post_init__(self) -> None:
        for name, least in (("steps", 1), ("episode", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}; got {getattr(self, name)}")
        for task in self.tasks:
            load_task(task)


def list_requests(config: SoakConfig) -> list[SpellRequest]:
    """List the episodes of a run, each with a seed of its own."""
    tasks = config.tasks or task_ids()
    count = -(-config.steps // config.episode)
    requests = []
    for number in range(count):
        sequence = np.random.SeedSequence(config.seed, spawn_key=(number,))
        steps = min(config.episode, config.steps - number * config.episode)
        requests.append(
            SpellRequest(
                task=tasks[number % len(tasks)],
                number=number,
                seed=int(sequence.generate_state(1, np.uint32)[0]),
                steps=steps,
            )
        )
    return requests


def soak(
    requests: Sequence[SpellRequest], *, workers: Workers, stop: threading.Event
) -> Generator[Spell, None, None]:
    """Run episodes, and give what came of each.

    Args:
        requests: The episodes.
        workers: How many, and where.
        stop: Ends the run when it is set.

    Raises:
        WorkerError: If workers keep dying.
    """
    with tempfile.TemporaryDirectory(prefix="dgl-soak-") as folder:
        dispatcher = Dispatcher(
            (Job(name=f"spell-{request.number}", request=request) for request in requests),
            work=Work(factory="dgl_bench.soak.spell:Spells"),
            workers=workers,
            folder=Path(folder),
            stop=stop,
        )
        with closing(dispatcher.run()) as outcomes:
            for outcome in outcomes:
                if isinstance(outcome.result, Spell):
                    yield outcome.result
                    continue
                assert isinstance(outcome.job.request, SpellRequest)
                assert outcome.failure is not None
                error = f"{outcome.failure.reason}: {outcome.failure.detail}"
                yield Spell(request=outcome.job.request, error=error)
