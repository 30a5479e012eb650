"""The only module that writes to the terminal.

Results go to standard output, so that they can be piped; messages and progress go to standard
error.
"""

import contextlib
import io
import json
import os
import select
import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from contextvars import ContextVar
from datetime import timedelta
from typing import Any, TextIO, TypeVar

__all__ = [
    "ProgressBar",
    "drop_closed_pipes",
    "error",
    "flush",
    "info",
    "keep_results_alone",
    "out",
    "out_json",
    "out_table",
    "progress",
    "track",
    "write_utf8",
]

T = TypeVar("T")

LOG_SECONDS = 30.0
"""Time between two lines of progress in a log [s]."""


class ProgressBar(ABC):
    """A running progress bar."""

    steps = 0
    """Steps that are done."""

    def advance(self, steps: int = 1, *, note: str | None = None) -> None:
        """Advance by steps; replace the note where given."""
        self.reach(self.steps + steps, note=note)

    def reach(self, steps: int, *, note: str | None = None, total: int | None = None) -> None:
        """Show that so many steps are done in all; replace the note and the total where given."""
        self.steps = steps
        self._show(note, total)

    @abstractmethod
    def _show(self, note: str | None, total: int | None) -> None:
        """Show the steps, and what is given anew."""


# Where results go while all else that prints is sent elsewhere.
_results: ContextVar[TextIO | None] = ContextVar("results", default=None)


@contextmanager
def keep_results_alone() -> Iterator[None]:
    """Send what libraries print to standard error: Warp's greeting is no result."""
    token = _results.set(sys.stdout)
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _results.reset(token)


def write_utf8() -> None:
    """Write UTF-8 in every locale; a file name's bytes that are not UTF-8 go out as they came."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(encoding="utf-8", errors="surrogateescape")


def flush() -> None:
    """Write out what is left of the results."""
    if sys.stdout is not None:
        sys.stdout.flush()


def drop_closed_pipes() -> bool:
    """Discard what is left for an output that nobody reads, and tell whether there was one."""
    found = False
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(AttributeError, OSError):  # closed, or none of the system's
            poll = select.poll()
            poll.register(stream.fileno(), select.POLLOUT)
            if any(event & select.POLLERR for _, event in poll.poll(0)):
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
                found = True
    return found


def out(text: str) -> None:
    """Write a result."""
    print(text, file=_results.get())


def out_json(value: Any) -> None:
    """Write a result as JSON. NaN and infinity are refused: they are not JSON."""
    out(json.dumps(value, indent=2, allow_nan=False))


def out_table(columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write rows under headings, each column as wide as its widest entry."""
    lines = [[str(cell) for cell in row] for row in [columns, *rows]]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    for line in lines:
        out("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())


def info(text: str) -> None:
    """Write a message beside the result."""
    print(text, file=sys.stderr)


def error(text: str) -> None:
    """Write what went wrong."""
    print(f"dgl: {text}", file=sys.stderr)


@contextmanager
def progress(description: str, total: int | None = None) -> Iterator[ProgressBar]:
    """Show a progress bar on standard error while the block runs.

    Args:
        description: What is being done.
        total: Number of steps, or None when it is not known: then the bar only shows that work goes
            on.

    Yields:
        The bar. On something that is no terminal (a log file) it is a line every half minute, and
        one at the end.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )
    from rich.progress import Progress as RichProgress

    terminal = Console(stderr=True)
    if not terminal.is_terminal:
        lines = _LoggedProgress(description, total)
        try:
            yield lines
        finally:
            lines.end()
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with RichProgress(*columns, console=terminal) as bar:
        task = bar.add_task(description, total=total, note="")

        class _Bar(ProgressBar):
            def _show(self, note: str | None, total: int | None) -> None:
                noted: dict[str, Any] = {} if note is None else {"note": note}
                bar.update(task, completed=self.steps, total=total, **noted)

        yield _Bar()


class _LoggedProgress(ProgressBar):
    """Progress as lines: how far it has come, for how long it has run, and the note."""

    def __init__(
        self,
        description: str,
        total: int | None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._description, self._total, self._clock = description, total, clock
        self._note, self._is_written = "", False
        self._started = self._written = clock()

    def _show(self, note: str | None, total: int | None) -> None:
        self._note = self._note if note is None else note
        self._total = self._total if total is None else total
        self._is_written = False
        if self._clock() - self._written >= LOG_SECONDS:
            self._write()

    def end(self) -> None:
        """Write where it ended, where the last line does not say so."""
        if not self._is_written:
            self._write()

    def _write(self) -> None:
        self._written, self._is_written = self._clock(), True
        of = "" if self._total is None else f"/{self._total}"
        elapsed = timedelta(seconds=int(self._written - self._started))
        parts = (f"{self._description} {self.steps}{of}", str(elapsed), self._note)
        info(", ".join(part for part in parts if part))


def track(iterable: Iterable[T], description: str, total: int | None = None) -> Iterator[T]:
    """Iterate with a progress bar of one step an item."""
    if total is None and isinstance(iterable, Sequence):
        total = len(iterable)
    with progress(description, total) as bar:
        for item in iterable:
            yield item
            bar.advance()
