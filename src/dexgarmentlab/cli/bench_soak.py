"""`dgl bench soak`: random actions over every task, for a long time."""

from dataclasses import dataclass, field
from pathlib import Path

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.bench_physics import print_rows
from dexgarmentlab.cli.flags import Flags, WorkerFlags

__all__ = ["BenchSoakOptions", "measure_soak"]


@dataclass(frozen=True, kw_only=True)
class BenchSoakOptions:
    """Make random actions in every task; count exceptions, overflows, NaN; watch memory.

    Hands are sent to the garment and anywhere, fingers move at random. Each episode has a seed of
    its own, which is told where something goes wrong. The exit status is 1 then.

    Example: dgl bench soak --steps 20000 --workers 2
    """

    steps: int = 20_000
    """Actions in all, each of five control steps."""
    episode: int = 100
    """Actions of an episode."""
    task: tuple[str, ...] = ()
    """Tasks; all of them when none is named."""
    seed: int = 0
    """Of everything drawn."""
    log: Path | None = None
    """Write a line of JSON for each episode to this file."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Print the rows as JSON."""


def measure_soak(options: BenchSoakOptions) -> int:
    """Run the episodes and write the rows."""
    import dataclasses
    import json
    from contextlib import closing

    from dgl_bench.soak import SoakConfig, Spell, list_requests, make_rows, soak
    from dgl_collect.workers import stop_signals
    from dgl_files.whole import append_line

    config = SoakConfig(
        steps=options.steps, episode=options.episode, tasks=options.task, seed=options.seed
    )
    requests = list_requests(config)
    spells: list[Spell] = []
    with (
        stop_signals() as stop,
        closing(soak(requests, workers=options.workers.make(), stop=stop)) as running,
        console.progress("soaking", len(requests)) as bar,
    ):
        for spell in running:
            spells.append(spell)
            wrong = sum(bool(s.error or s.not_finite) for s in spells)
            bar.advance(note=f"{wrong} with a fault" if wrong else "no fault")
            if options.log is not None:
                append_line(options.log, json.dumps(dataclasses.asdict(spell)))
        is_interrupted = stop.is_set()
    rows = make_rows(spells)
    print_rows(rows, as_json=options.json)
    if is_interrupted:
        console.error(f"interrupted after {len(spells)} of {len(requests)} episodes")
        return EXIT_INTERRUPTED
    return EXIT_FAILURE if any(row.ok is False for row in rows) else EXIT_OK
