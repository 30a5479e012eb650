"""`dgl bench assets`: garments of every category, measured and dropped."""

import time
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from dexgarmentlab.cli import EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.bench_physics import print_rows
from dexgarmentlab.cli.collect import format_duration
from dexgarmentlab.cli.flags import Flags, WorkerFlags, tell_command, told_how_to_continue

if TYPE_CHECKING:
    from dgl_bench.assets import Attempt, RunConfig

__all__ = ["BenchAssetsOptions", "measure_assets"]

_COUNT, _FRAMES = 2500, 300


@dataclass(frozen=True, kw_only=True)
class BenchAssetsOptions:
    """Measure garments of every category, drop each onto the ground, and check that it stays whole.

    Every finished garment is on disk: Ctrl-C keeps it, and --resume continues. A bar that is not
    met is a finding and no failure: the exit status is 0.

    Example: dgl bench assets --out out/drops --workers 4
    """

    out: Path
    """Output folder; it must be empty or missing, unless --resume is given."""
    count: int = _COUNT
    """Garments in all, divided equally among the categories."""
    category: tuple[str, ...] = ()
    """Categories; all of them when none is named."""
    frames: int = _FRAMES
    """Simulated time, in sixtieths of a second."""
    resume: bool = False
    """Continue the run in the output folder."""
    report: bool = False
    """Write report.html, with pictures, and table.md into the folder, of what it holds by then."""
    drop: bool = True
    """With --no-drop nothing is dropped: the run in the folder is summed up as it is, even while it
    goes on."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Print the rows as JSON."""


def measure_assets(options: BenchAssetsOptions) -> int:
    """Drop the garments that are left and write the rows."""
    from dgl_bench.assets import RunConfig, load_run, make_rows

    if options.drop:
        config = RunConfig(count=options.count, categories=options.category, frames=options.frames)
        attempts, is_interrupted = _drop(config, options)
    else:
        (_, attempts), is_interrupted = load_run(options.out), False
    if options.report and attempts:
        console.info(f"report: {_report(options.out, attempts)}")
    print_rows(make_rows(attempts), as_json=options.json)
    if is_interrupted:
        console.error(
            f"interrupted after {len(attempts)} of {options.count} garments; continue with: "
            f"{tell_command('bench assets', options)} --resume"
        )
        return EXIT_INTERRUPTED
    return EXIT_OK


def _report(folder: Path, attempts: "list[Attempt]") -> Path:
    """Write the report with a progress bar."""
    from dgl_bench.assets import count_pictures, write_report

    with console.progress("drawing", count_pictures(attempts)) as bar:
        return write_report(folder, on_picture=bar.advance)


def _drop(config: "RunConfig", options: BenchAssetsOptions) -> tuple[list["Attempt"], bool]:
    """Drop garments with a progress bar; the second value tells whether Ctrl-C has ended it."""
    from dgl_bench.assets import drop_garments
    from dgl_collect.workers import stop_signals

    done: list[Attempt] = []
    whole, began, found = 0, time.monotonic(), 0
    command = tell_command("bench assets", options) + (" --resume" if options.resume else "")
    with (
        stop_signals() as stop,
        told_how_to_continue(tell_command("bench assets", options)),
        closing(
            drop_garments(
                config,
                options.out,
                workers=options.workers.make(),
                resume=options.resume,
                command=command,
                stop=stop,
            )
        ) as running,
        console.progress("dropping garments", config.count) as bar,
    ):
        for attempt in running:
            done.append(attempt)
            whole += attempt.is_whole
            seconds = time.monotonic() - began
            if seconds < 0.5:  # an earlier run has left these
                found = len(done)
                bar.advance()
                continue
            left = seconds / max(len(done) - found, 1) * (config.count - len(done))
            bar.advance(note=f"{whole} whole, {format_duration(left)} left")
        return done, stop.is_set()
