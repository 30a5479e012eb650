"""Trials of parameter values: one episode each, to the first retry, without film and files."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dgl_assets.garments.catalogue import Split
from dgl_collect.actors import Expert
from dgl_collect.attempt import draw_garment
from dgl_collect.attempt_jobs import AttemptRequest
from dgl_collect.demonstration import (
    FOLDER,
    check_demonstration,
    find_file,
    parse_demonstration,
)
from dgl_collect.errors import DemonstrationError
from dgl_collect.options import RunOptions
from dgl_collect.results import AttemptResult
from dgl_collect.setup import Setup, make_setup
from dgl_collect.steps import Demonstration
from dgl_collect.video import save_png
from dgl_files.fields import decode_json
from dgl_physics import PhysicsError
from dgl_tasks import TaskError, load_task
from dgl_tasks.declaration import Task
from dgl_tasks.evaluation import run_episode
from dgl_tasks.messages import BeginsAgain, Command, Mark
from dgl_tasks.sensing import Sensed
from dgl_tasks.success import Criterion, Verdict

__all__ = ["TrialRequest", "Trials", "compute_score", "make_trials", "read_content", "set_values"]

_WORST, _BEST = -0.4, 0.1
"""Distances from the threshold, as shares of it, between which the score rises."""


@dataclass(frozen=True, kw_only=True)
class TrialRequest(AttemptRequest):
    """One trial."""

    values: Mapping[str, float]
    """Value of each parameter."""
    start: int
    """Number of the start, from which garment and placement follow."""
    split: Split
    """Split of the garment."""
    has_picture: bool = False
    """Take a picture of the end."""


def make_trials(task: str, options: RunOptions) -> Trials:
    """Build the trials of a search; see `dgl_collect.CollectConfig.attempt_factory`."""
    return Trials(make_setup(task, options), read_content(load_task(task), options.demonstration))


class Trials:
    """Makes trials in one environment; implements `dgl_collect.workers.JobRunner`."""

    def __init__(self, setup: Setup, content: Mapping[str, Any]) -> None:
        """Take over an environment, and the demonstration's JSON object."""
        self._setup, self._content = setup, content

    def close(self) -> None:
        """Release the environment."""
        self._setup.env.close()

    def run(self, request: TrialRequest, out_dir: Path) -> AttemptResult:
        """Make one trial."""
        setup, task = self._setup, self._setup.env.task
        demonstration = _make_demonstration(self._content, request.values, task)
        garment = draw_garment(task, request.split, request.seed)
        verdict: Verdict | None = None
        reason, detail = None, ""
        try:
            runner = setup.make_runner(Expert(), rounds=1, demonstration=demonstration)
            ended = run_episode(
                setup.env,
                setup.motion,
                runner,
                seed=request.seed,
                garment=garment,
                listener=_FirstTry(setup.env.judge),
            )
            verdict, reason, detail = ended.verdict, ended.reason, ended.detail
        except _TriedAgainError as err:
            verdict = err.verdict
            reason, detail = "retry", err.verdict.describe_shortfalls()
        except (TaskError, PhysicsError) as err:
            reason, detail = type(err).__name__, str(err)
        success = verdict is not None and verdict.success
        files = {}
        if request.has_picture:
            files["picture"] = f"{request.episode_id}.png"
            picture = setup.env.take_picture(task.picture_camera).rgb
            save_png(out_dir / files["picture"], picture)
        return AttemptResult(
            index=request.index,
            seed=request.seed,
            success=success,
            first_try=success,
            value=None if verdict is None else verdict.value,
            reason=None if success else reason,
            detail="" if success else detail,
            criteria=() if verdict is None else verdict.criteria,
            garment_id=garment,
            files=files,
            randomisation={
                "start": request.start,
                "split": request.split,
                "values": dict(request.values),
            },
        )


class _TriedAgainError(Exception):
    """A retry begins."""

    def __init__(self, verdict: Verdict) -> None:
        super().__init__()
        self.verdict = verdict


class _FirstTry:
    """Ends an episode at its first retry; implements `dgl_tasks.driver.Listener`."""

    def __init__(self, judge: Callable[[], Verdict]) -> None:
        self._judge = judge

    def before_step(self, command: Command, look: Callable[..., Sensed]) -> None:
        """Let the episode go on."""

    def note(self, mark: Mark, sensed: Sensed) -> None:
        """End the episode where a retry begins."""
        if isinstance(mark, BeginsAgain):
            raise _TriedAgainError(self._judge())


def read_content(task: Task, path: Path | None) -> dict[str, Any]:
    """Read the JSON object of a task's demonstration, which must name parameters.

    Raises:
        DemonstrationError: If it cannot be read, does not fit the task, or has no parameters.
    """
    file = path or find_file(task)
    try:
        content = decode_json(file.read_text(encoding="utf-8"))
    except (ValueError, OSError) as err:
        raise DemonstrationError(f"{file.name}: {err}") from err
    demonstration = parse_demonstration(content, source=file.name)
    check_demonstration(demonstration, task, source=file.name)
    if not demonstration.parameters:
        raise DemonstrationError(
            f"{file.name}: a search needs parameters with their ranges; this file names none, "
            f"those of {', '.join(list_tunable())} do"
        )
    if demonstration.recordings is not None:
        content["recordings"] = str(file.absolute().parent / demonstration.recordings)
    return content


def list_tunable() -> list[str]:
    """List the tasks of this package whose demonstrations name parameters."""
    contents = [decode_json(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.json")]
    return sorted(content["task"] for content in contents if content.get("parameters"))


def set_values(content: Mapping[str, Any], values: Mapping[str, float]) -> dict[str, Any]:
    """Set the values of parameters in a demonstration's JSON object."""
    changed = copy.deepcopy(dict(content))
    for name, value in values.items():
        changed["parameters"][name]["value"] = value
    return changed


def _make_demonstration(
    content: Mapping[str, Any], values: Mapping[str, float], task: Task
) -> Demonstration:
    demonstration = parse_demonstration(set_values(content, values), source="tuned")
    check_demonstration(demonstration, task, source="tuned")
    return demonstration


def compute_score(result: AttemptResult) -> float:
    """Compute a score in [0, 1] that rises smoothly with what a trial has reached.

    The rule's worst criterion decides: the score is 0 where it falls short by 40 % of its threshold
    or more, 0.8 at the threshold, and 1 where it exceeds it by 10 %. A trial that was not judged
    has the score 0.
    """
    if not result.criteria:
        return 0.0
    worst = min(map(_measure_margin, result.criteria))
    return float(min(max((worst - _WORST) / (_BEST - _WORST), 0.0), 1.0))


def _measure_margin(criterion: Criterion) -> float:
    """Measure how far a criterion is on the good side of its threshold, as a share of it.

    A threshold of 0, as of links that touch the garment, has no better side.
    """
    if criterion.threshold == 0:
        return _BEST if criterion.is_met else _WORST
    difference = criterion.value - criterion.threshold
    if criterion.comparison in ("<", "<="):
        difference = -difference
    return difference / abs(criterion.threshold)
