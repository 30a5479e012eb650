"""`dgl gam data`: training data, made by simulation."""

import time
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.collect import format_duration
from dexgarmentlab.cli.flags import Flags, WorkerFlags, tell_command, told_how_to_continue

if TYPE_CHECKING:
    from dgl_collect.gam_data import DataConfig, Made

__all__ = ["DataOptions", "make_data"]


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """Make training data: simulated states of catalogue garments and camera views.

    Every finished garment is on disk: Ctrl-C keeps it, and --resume continues. A garment that
    cannot be simulated has a line with the reason in failures.jsonl, and no file.

    Example: dgl gam data --out gam-data --category Trousers --train 100 --test 20 --workers 4
    """

    out: Path
    """Folder for the data; it must be empty or missing, unless --resume is given."""
    category: tuple[str, ...] = ()
    """Categories; all of them when none is named."""
    train: int = 200
    """Garments of each category to train on."""
    test: int = 40
    """Garments of each category to measure on."""
    flat: int = 600
    """Further training garments of each category, flat state only, without simulation."""
    flat_test: int = 60
    """More garments of each category to measure on, likewise."""
    resume: bool = False
    """Continue the data set in the folder; the other options must be as they were."""
    seed: int = 0
    """Of everything drawn."""
    preview: Path | None = None
    """Write a picture (PNG) of the views of two garments of each category."""
    workers: Flags[WorkerFlags] = field(default_factory=WorkerFlags)
    json: bool = False
    """Write the summary as JSON."""


def make_data(options: DataOptions) -> int:
    """Make the garments that are left, and sum up."""
    from dexgarmentlab.gam.data_sheet import draw_data_sheet
    from dgl_collect.gam_data import DataConfig

    config = DataConfig(
        categories=options.category,
        train=options.train,
        test=options.test,
        flat=options.flat,
        flat_test=options.flat_test,
        seed=options.seed,
    )
    done, is_interrupted = _generate(config, options)
    summary = summarize(done)
    if options.json:
        console.out_json({"out": str(options.out), **summary})
    else:
        _print(options.out, summary)
    if is_interrupted:
        console.error(
            f"interrupted after {len(done)} garments; continue with: "
            f"{tell_command('gam data', options)} --resume"
        )
        return EXIT_INTERRUPTED
    if not summary["garments"]:
        console.error(f"no garment could be made; the reasons are in {options.out}/failures.jsonl")
        return EXIT_FAILURE
    if options.preview is not None:
        count = draw_data_sheet(options.out, options.preview)
        console.info(f"{options.preview}: views of {count} garments")
    return EXIT_OK


def summarize(done: "Sequence[Made]") -> dict[str, Any]:
    """Sum up a data set: garments, failures with their reasons, time and size by category."""
    rows = []
    for category in dict.fromkeys(made.id.partition("/")[0] for made in done):
        own = [made for made in done if made.id.startswith(f"{category}/")]
        whole = [made for made in own if not made.error]
        timed = [made.seconds for made in whole if made.seconds > 0]
        rows.append(
            {
                "category": category,
                "garments": len(whole),
                "failed": len(own) - len(whole),
                "made_now": len(timed),
                "cpu_seconds_mean": sum(timed) / len(timed) if timed else None,
                "cpu_seconds_longest": max(timed, default=None),
                "megabytes_mean": sum(m.bytes for m in whole) / len(whole) / 1e6 if whole else None,
            }
        )
    return {
        "garments": sum(row["garments"] for row in rows),
        "failed": sum(row["failed"] for row in rows),
        "megabytes": sum(made.bytes for made in done) / 1e6,
        "categories": rows,
        "notes": [{"id": made.id, "note": made.note} for made in done if made.note],
        "failures": [{"id": made.id, "reason": made.error} for made in done if made.error],
    }


def _print(out: Path, summary: dict[str, Any]) -> None:
    columns = ("category", "garments", "failed", "CPU s", "longest", "MB")
    keys = ("cpu_seconds_mean", "cpu_seconds_longest", "megabytes_mean")
    console.out_table(
        columns,
        [
            [
                *(row[key] for key in ("category", "garments", "failed")),
                *("-" if row[key] is None else f"{row[key]:.2f}" for key in keys),
            ]
            for row in summary["categories"]
        ],
    )
    for noted in summary["notes"]:
        console.out(f"{noted['id']}: {noted['note']}")
    for failure in summary["failures"]:
        console.out(f"failed: {failure['id']}: {failure['reason']}")
    console.out(f"{out}: {summary['garments']} garments, {summary['megabytes']:.1f} MB")


def _generate(config: "DataConfig", options: DataOptions) -> tuple[list["Made"], bool]:
    """Make garments with a progress bar; the second value tells whether Ctrl-C has ended it."""
    from dgl_collect.gam_data import generate_data, list_garments
    from dgl_collect.workers import stop_signals

    done: list[Made] = []
    total, began, made_now = len(list_garments(config)), time.monotonic(), 0
    with (
        stop_signals() as stop,
        told_how_to_continue(tell_command("gam data", options)),
        closing(
            generate_data(
                config,
                options.out,
                workers=options.workers.make(),
                resume=options.resume,
                stop=stop,
            )
        ) as running,
        console.progress("making garments", total) as bar,
    ):
        for made in running:
            done.append(made)
            made_now += made.seconds > 0
            if not made_now:  # an earlier run has left these
                bar.advance()
                continue
            left = (time.monotonic() - began) / made_now * (total - len(done))
            bar.advance(note=f"{format_duration(left)} left")
        return done, stop.is_set()
