"""Attempts as jobs of a run: their requests, and checks of their results."""

from dataclasses import dataclass, replace

import numpy as np

from dgl_collect.results import AttemptResult
from dgl_collect.workers import Failure, Job, JobOutcome


@dataclass(frozen=True, kw_only=True)
class AttemptRequest:
    """One attempt to make."""

    index: int
    """Number of the attempt in the run, from 0."""
    seed: int
    """The attempt's own seed, in [0, 2**32)."""
    episode_id: str
    """Stem of its files' names, `<episode_id>.h5`, `.mp4` and `.png`."""


def make_attempt_seed(seed: int, index: int) -> int:
    """Derive an attempt's own seed from the run's seed and the attempt's number.

    Args:
        seed: Seed of the run, at least 0.
        index: Number of the attempt, from 0.

    Returns:
        A seed in [0, 2**32).
    """
    return int(np.random.SeedSequence(seed, spawn_key=(index,)).generate_state(1, np.uint32)[0])


def make_episode_id(task: str, seed: int, index: int) -> str:
    """Name an episode; episodes of several runs can share a folder."""
    return f"{task}-s{seed}-{index:05d}"


def make_job(task: str, seed: int, index: int) -> Job:
    """Make the job of an attempt; `seed` is that of the run."""
    episode_id = make_episode_id(task, seed, index)
    seed = make_attempt_seed(seed, index)
    request = AttemptRequest(index=index, seed=seed, episode_id=episode_id)
    return Job(name=episode_id, request=request)


def read_outcome(outcome: JobOutcome, *, has_episodes: bool) -> AttemptResult:
    """Return the result of an attempt; an attempt without a valid result is a failure.

    Args:
        outcome: Outcome of a job of `make_job`.
        has_episodes: A success must have an episode file.
    """
    request, failure = outcome.job.request, outcome.failure
    assert isinstance(request, AttemptRequest)
    if failure is None:
        try:
            result = _check_result(outcome, request, has_episodes=has_episodes)
            return replace(result, seconds=outcome.seconds)
        except ValueError as err:
            failure = Failure(reason="invalid result", detail=str(err))
    return AttemptResult(
        index=request.index,
        seed=request.seed,
        success=False,
        reason=failure.reason,
        detail=failure.detail,
        seconds=outcome.seconds,
    )


def _check_result(
    outcome: JobOutcome, request: AttemptRequest, *, has_episodes: bool
) -> AttemptResult:
    """Check that a result is of the attempt, and that its files are there."""
    result = outcome.result
    if not isinstance(result, AttemptResult):
        raise ValueError(f"result must be an AttemptResult; got {type(result).__name__}")
    if (result.index, result.seed) != (request.index, request.seed):
        raise ValueError(
            f"result must be of attempt {request.index}, seed {request.seed}; "
            f"got {result.index}, seed {result.seed}"
        )
    if has_episodes and result.success and "episode" not in result.files:
        raise ValueError(f"a success must have an episode file; got {sorted(result.files)}")
    for kind, name in result.files.items():
        path = outcome.folder / name
        if path.parent != outcome.folder or path.stem != request.episode_id:
            raise ValueError(
                f"{kind} file must be {request.episode_id}.* in its folder; got {name!r}"
            )
        if not path.is_file():
            raise ValueError(f"{kind} file must exist; {name!r} does not")
    return result
