"""Attempts as jobs of workers; the protocols of the code that makes them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from dgl_collect.options import RunOptions
from dgl_collect.results import AttemptResult
from dgl_collect.workers import load_callable


class AttemptRunner(Protocol):
    """Makes attempts, one after the other, in an environment that it builds once.

    An attempt must depend on its seed alone, not on the attempts before it: then a run gives the
    same episodes with any number of workers.
    """

    def run(
        self, *, attempt_index: int, seed: int, out_dir: Path, episode_id: str
    ) -> AttemptResult:
        """Make one attempt.

        Args:
            attempt_index: Number of the attempt in the run, from 0.
            seed: The attempt's own seed, in [0, 2**32).
            out_dir: An empty folder for this attempt's files, `<episode_id>.h5`, `.mp4` and `.png`.
                The run moves them afterwards, so files left by a crash are never taken for whole.
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

    def __call__(self, task: str, options: Any, /) -> AttemptRunner:
        """Build it for a task with the options of the run: `RunOptions`, or others of its own."""
        ...


@dataclass(frozen=True, kw_only=True)
class AttemptRequest:
    """One attempt to make."""

    index: int
    """Number of the attempt in the run, from 0."""
    seed: int
    """Its own seed."""
    episode_id: str
    """Stem of its files' names."""


class AttemptJobs:
    """Makes attempts as jobs of a worker, and checks that each outcome is what was asked for."""

    def __init__(
        self,
        *,
        task: str,
        attempt_factory: str,
        options: RunOptions | Mapping[str, object],
        has_episodes: bool,
    ) -> None:
        """Build the attempt runner.

        Args:
            task: Environment id.
            attempt_factory: `module:name` of an `AttemptFactory`.
            options: Its options.
            has_episodes: A success must leave an episode file.
        """
        self._runner: AttemptRunner = load_callable(attempt_factory)(task, options)
        self._has_episodes = has_episodes

    def run(self, request: AttemptRequest, out_dir: Path) -> AttemptResult:
        """Make one attempt; see `dgl_collect.workers.JobRunner`."""
        result = self._runner.run(
            attempt_index=request.index,
            seed=request.seed,
            out_dir=out_dir,
            episode_id=request.episode_id,
        )
        if (result.index, result.seed) != (request.index, request.seed):
            raise ValueError(
                f"result must be of attempt {request.index}, seed {request.seed}; "
                f"got {result.index}, seed {result.seed}"
            )
        if self._has_episodes and result.success and "episode" not in result.files:
            raise ValueError(f"a success must have an episode file; got {sorted(result.files)}")
        for kind, name in result.files.items():
            path = out_dir / name
            if path.parent != out_dir or path.stem != request.episode_id:
                raise ValueError(
                    f"{kind} file must be {request.episode_id}.* in its folder; got {name!r}"
                )
            if not path.is_file():
                raise ValueError(f"{kind} file must exist; {name!r} does not")
        return result

    def close(self) -> None:
        """Release the environment."""
        self._runner.close()
