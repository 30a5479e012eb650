"""Verb `dgl verify`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console

__all__ = ["VerifyOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class VerifyOptions:
    """Check the folder of a collection or an evaluation; nothing in it is changed.

    Every file is opened: shapes and numbers are right, lines and files agree, seeds are those of
    the run, success follows from the recorded criteria, and the summary counts what there is. What
    is wrong is said in a line each, and the exit status is 1 then.

    Example: dgl verify out/fold-tops
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of `dgl collect` or `dgl eval`."""
    json: bool = False
    """Write what is wrong as JSON."""


def run(options: VerifyOptions) -> int:
    """Check, and say what is wrong."""
    from dgl_collect.evaluation.results import RESULTS_FILE
    from dgl_collect.run_folder import RUN_FILE, SUMMARY_FILE
    from dgl_collect.verify import find_missing, verify_evaluation, verify_run

    folder = options.folder
    if (folder / RUN_FILE).is_file():
        checks = verify_run(folder)
    elif (folder / RESULTS_FILE).is_file():
        checks = verify_evaluation(folder)
    else:
        raise ValueError(
            f"DIR must be the folder of a collection or an evaluation; {folder} has neither "
            f"{RUN_FILE} nor "
            f"{RESULTS_FILE}"
        )
    faults: list[str] = []
    files: set[Path] = set()
    with console.progress(f"verifying {folder}") as bar:
        for path, fault in checks:
            if path not in files:
                files.add(path)
                bar.advance()
            faults += [fault] if fault else []
    if options.json:
        console.out_json({"files": len(files), "faults": faults})
    else:
        for fault in faults:
            console.out(fault)
        for part in sorted({path.parent for path in files if path.name == SUMMARY_FILE}):
            if left := find_missing(part):
                named = ", ".join(map(str, left[:8])) + (" …" if len(left) > 8 else "")
                console.out(
                    f"{part}: not complete: attempts {named} are not made yet; --resume makes them"
                )
        console.out(
            f"{folder}: {len(files)} file{'s' if len(files) > 1 else ''}, {len(faults) or 'no'} "
            f"fault{'s' if len(faults) > 1 else ''}"
        )
    return EXIT_FAILURE if faults else EXIT_OK
