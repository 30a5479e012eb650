"""What the runner asks of the code that makes one attempt."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, cast

from dgl_collect.results import AttemptResult


class AttemptRunner(Protocol):
    """Makes attempts, one after the other, in an environment that it builds once.

    An attempt must depend on its seed alone, not on the attempts before it: then a run gives the same
    episodes with any number of workers.
    """

    def run(
        self, *, attempt_index: int, seed: int, out_dir: Path, episode_id: str
    ) -> AttemptResult:
        """Make one attempt.

        Args:
            attempt_index: Number of the attempt in the run, from 0.
            seed: The attempt's own seed, in [0, 2**32).
            out_dir: An empty folder for this attempt's files, `<episode_id>.h5`, `.mp4` and `.png`. The
                run takes them over afterwards, so whatever is left by a crash is never taken for whole.
            episode_id: Stem of the files' names.

        Returns:
            The outcome, with `files` relative to `out_dir`. A success must have an `episode` file.
        """
        ...

    def close(self) -> None:
        """Release the environment."""
        ...


class AttemptFactory(Protocol):
    """Builds an attempt runner inside a worker process."""

    def __call__(self, task: str, options: Mapping[str, object]) -> AttemptRunner:
        """Build it for a task, with JSON-ready options of its own."""
        ...


def load_factory(dotted_path: str) -> AttemptFactory:
    """Import an attempt factory.

    Args:
        dotted_path: `module:name`.

    Raises:
        ValueError: If the path is not of that form, or names nothing callable.
        ImportError: If the module cannot be imported.
    """
    module_name, _, name = dotted_path.partition(":")
    if not module_name or not name:
        raise ValueError(f"attempt_factory must be 'module:name'; got {dotted_path!r}")
    factory = getattr(importlib.import_module(module_name), name, None)
    if not callable(factory):
        raise ValueError(f"attempt_factory must name a callable; {dotted_path!r} is {factory!r}")
    return cast(AttemptFactory, factory)
