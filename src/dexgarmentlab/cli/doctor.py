"""Verb `dgl doctor`."""

from dataclasses import dataclass

from dexgarmentlab import doctor
from dexgarmentlab.cli import console

__all__ = ["DoctorOptions", "run"]

_MARKS = {"ok": "ok      ", "fail": "FAIL    ", "optional": "optional"}


@dataclass(frozen=True, kw_only=True)
class DoctorOptions:
    """Say what works on this machine, and the fix for what does not.

    The exit status is 0 when `dgl demo` can run here, and 1 when it cannot.

    Example: dgl doctor --json
    """

    json: bool = False
    """Write the result as JSON."""
    only: tuple[str, ...] = ()
    """Run only these checks, by name; all of them when none is named."""


def run(options: DoctorOptions) -> int:
    """Run the checks, write their results, and return 1 if a needed one fails."""
    with console.progress("checking this machine", len(options.only or doctor.CHECKS)) as bar:
        results = doctor.run_checks(
            only=options.only, on_result=lambda check: bar.advance(note=check.name)
        )
    is_able = all(check.state != "fail" for check in results)
    if options.json:
        console.out_json({"ok": is_able, "checks": [check.to_dict() for check in results]})
        return 0 if is_able else 1
    width = max(len(check.name) for check in results)
    for check in results:
        console.out(f"{_MARKS[check.state]}  {check.name:<{width}}  {check.detail}")
        if check.fix:
            console.out(f"{'':8}  {'':<{width}}  fix: {check.fix}")
    if not options.only:
        console.out("")
        console.out("`dgl demo` can run here." if is_able else "`dgl demo` cannot run here yet.")
    return 0 if is_able else 1
