"""Verb `dgl demo`."""

import json
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.collect import collect_with_progress, format_duration, prepare_run
from dexgarmentlab.cli.flags import Flags, tell_command
from dgl_collect.options import RecordOptions

__all__ = ["TASK", "DemoOptions", "clear_previous", "run"]

TASK = "FoldTops-v1"
SEED = 0
_COMMAND = "dgl demo"


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Collect one demonstration: two dexterous hands fold a long-sleeved top.

    Writes the episode, its film, its final picture and a report that shows them.

    Example: dgl demo --out demo-out
    """

    out: Path = Path("demo-out")
    """Output folder; an earlier demonstration in it is replaced, anything else is left alone."""
    run: Flags[RecordOptions] = field(default_factory=RecordOptions)
    json: bool = False
    """Write where the files are as JSON."""


def run(options: DemoOptions) -> int:
    """Collect the demonstration, write the report, and say where everything is."""
    from dgl_collect import CollectConfig
    from dgl_collect.results import ATTEMPTS_FILE, read_results
    from dgl_tasks import get_task

    prepared = prepare_run(options.run, get_task(TASK))
    clear_previous(options.out)
    config = CollectConfig(
        task=TASK,
        episodes=1,
        seed=SEED,
        out=options.out,
        options=prepared,
        command=tell_command("demo", options),
    )
    summary, report = collect_with_progress(config, embed_media=True)
    if summary.status == "interrupted":
        console.error(f"interrupted; run `{config.command}` to start again")
        return EXIT_INTERRUPTED
    result = read_results(options.out / ATTEMPTS_FILE)[0]
    paths = {kind: str(options.out / name) for kind, name in result.files.items()}
    paths["report"] = str(report)
    if options.json:
        console.out_json({"success": result.success, "seconds": result.seconds, **paths})
    else:
        if result.success:
            console.out(f"folded a top in {format_duration(result.seconds)}:")
        for kind, path in paths.items():
            console.out(f"  {kind:<8} {path}")
    if not result.success:
        detail = f" ({result.detail})" if result.detail else ""
        console.error(f"the demonstration failed: {result.reason}{detail}; see {report}")
        return EXIT_FAILURE
    return EXIT_OK


def clear_previous(folder: Path) -> None:
    """Empty a folder that an earlier demonstration has made.

    Args:
        folder: The folder; one that is missing or empty is left as it is.

    Raises:
        ValueError: If the folder holds anything that a demonstration does not write.
    """
    from dexgarmentlab.reports.collection import REPORT_FILE
    from dgl_collect.results import ATTEMPTS_FILE
    from dgl_collect.run_folder import RUN_FILE, SUMMARY_FILE
    from dgl_collect.workers.dispatch import STAGING

    if not folder.is_dir() or not any(folder.iterdir()):
        return
    ours = {RUN_FILE, ATTEMPTS_FILE, SUMMARY_FILE, REPORT_FILE, STAGING}
    ours |= {"episodes", "failed", "logs"}
    found = {path.name for path in folder.iterdir()}
    if not _is_demo(folder / RUN_FILE) or not found <= ours:
        raise ValueError(
            f"{folder} is not empty and not (only) an earlier demonstration's; choose another --out"
        )
    # What marks the folder as ours goes last, so that an interrupted clearing can be repeated.
    for name in sorted(found, key=lambda name: name == RUN_FILE):
        path = folder / name
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _is_demo(run_path: Path) -> bool:
    """Say whether a run folder was made by this verb."""
    try:
        commands = json.loads(run_path.read_text(encoding="utf-8"))["commands"]
        return all(str(command).startswith(_COMMAND) for command in commands)
    except (OSError, ValueError, KeyError, TypeError):
        return False
