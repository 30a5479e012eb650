"""The search: generations of candidates on common starts, then a paired judgement."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from dgl_collect.attempt_jobs import make_attempt_seed, read_outcome
from dgl_collect.demonstration import compute_own_checksums
from dgl_collect.evaluation.comparison import compute_mcnemar
from dgl_collect.options import RunOptions
from dgl_collect.results import package_versions
from dgl_collect.run_folder import RunFolder, RunRecord, opened_run
from dgl_collect.tuning.regression import LEAST_TRIALS, Response, fit_response
from dgl_collect.tuning.trials import TrialRequest, compute_score, read_content, set_values
from dgl_collect.workers import Dispatcher, Job, Limits, Work, Workers, check_workers, stop_signals
from dgl_files.whole import write_json
from dgl_tasks import load_task
from dgl_tasks.declaration import Task

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = [
    "TUNED_FILE",
    "Generation",
    "Interrupted",
    "TuneConfig",
    "TuneProgress",
    "Tuning",
    "tune",
]

TUNED_FILE = "tuned.json"
"""The demonstration with the values that the search has found."""
FACTORY = "dgl_collect.tuning.trials:make_trials"
_SPREAD = 0.12
"""First standard deviation of the candidates, as a share of each range."""
_FIRST_STARTS = 2
"""Starts after which the worse half of the candidates is dropped."""
_JUDGED_FROM = 1_000_000
"""Number of the first start of the judgement; no generation gets there."""


@dataclass(frozen=True, kw_only=True)
class TuneConfig:
    """A search to make.

    Raises:
        ValueError: If a number is out of its range.
    """

    task: str
    """Environment id, or a task of your own; see `dgl_tasks.load_task`."""
    out: Path
    """Output folder; empty or missing, unless `resume`."""
    options: RunOptions = field(default_factory=RunOptions)
    """Options of the trials; `demonstration` is the one whose parameters are searched."""
    generations: int = 9
    candidates: int = 12
    """Candidates in a generation, beside the values of the demonstration."""
    starts: int = 3
    """New starts in a generation, the same for all of its candidates."""
    judged: int = 40
    """Further starts on which the winner is compared with the demonstration."""
    seed: int = 0
    workers: Workers = field(default_factory=Workers)
    resume: bool = False
    command: str = ""
    """Command line, recorded in `run.json`."""

    def __post_init__(self) -> None:
        for name in ("generations", "candidates", "starts", "judged", "seed"):
            least = {"generations": 1, "candidates": 4, "starts": 1}.get(name, 0)
            if getattr(self, name) < least:
                raise ValueError(f"{name} must be at least {least}; got {getattr(self, name)}")
        searched = _count_trials(self) - 2 * self.judged
        if searched < LEAST_TRIALS:
            raise ValueError(f"a search needs {LEAST_TRIALS} trials or more; got {searched}")


@dataclass(frozen=True, kw_only=True)
class Generation:
    """Scores of one generation on its first starts, which all candidates have in common."""

    baseline: float
    """Mean score of the demonstration's values."""
    mean: float
    """Mean score of the candidates."""
    best: float
    """Highest mean score of a candidate."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Tuning:
    """Outcome of a search."""

    names: tuple[str, ...]
    """The parameters."""
    before: Mapping[str, float]
    """Their values in the demonstration."""
    after: Mapping[str, float]
    """Their values of the winner."""
    chosen: Literal["mean", "regression"]
    """The winner: the mean of the last generation, or the optimum of the regression."""
    generations: Sequence[Generation]
    response: Response
    """The regression over all trials of the generations."""
    trials: int
    """Number of trials of the generations."""
    judged: int
    """Number of starts of the judgement."""
    succeeded_before: int
    """Successes of the demonstration's values at the first try."""
    succeeded_after: int
    """Successes of the winner."""
    only_before: int
    """Starts at which the demonstration's values succeeded alone."""
    only_after: int
    """Starts at which the winner succeeded alone."""
    p_value: float
    """Two-sided p of the exact test of McNemar."""

    @property
    def is_better(self) -> bool:
        """The judgement shows the winner to be better, at p < 0.05."""
        return self.p_value < 0.05 and self.only_after > self.only_before


@dataclass(frozen=True, kw_only=True)
class TuneProgress:
    """Progress of a search."""

    made: int
    """Trials made, earlier runs included."""
    wanted: int
    """Trials in all."""
    resumed: int
    """Trials made by an earlier run."""
    seconds: float
    """Wall-clock time of this run [s]."""
    note: str
    """The present part of the search."""


class Interrupted(Exception):  # noqa: N818 - no fault
    """A signal has ended the search; what it has done is kept."""


def tune(
    config: TuneConfig, *, on_progress: Callable[[TuneProgress], None] | None = None
) -> Tuning:
    """Search for values of a demonstration's parameters that succeed more often at the first try.

    CMA-ES proposes candidates. Every generation has new starts, the same for all candidates and for
    the demonstration's own values; the worse half is dropped after two of them. A regression on all
    trials proposes values of its own; what it holds better, these or the mean of CMA-ES, is the
    winner, which is compared with the demonstration on further starts, half of them with garments
    of the testing split. The winner is in `tuned.json` of the output folder.

    Args:
        config: The search.
        on_progress: Called after every trial.

    Raises:
        Interrupted: After SIGINT, SIGTERM or SIGHUP in the main thread.
        DemonstrationError: If the demonstration is damaged, does not fit, or has no parameters.
        OutputFolderError: If the output folder cannot be used.
        WorkerError, MachineError, EngineError: As `dgl_collect.collect`.

    Source:
        Hansen, "The CMA evolution strategy: a tutorial", 2016.
    """
    from cmaes import CMA

    task = load_task(config.task)
    content = read_content(task, config.options.demonstration)
    space = _Space(content["parameters"])
    check_workers(config.workers)
    with _opened(config, task, space, on_progress) as trials:
        start = space.to_shares(space.before)
        cma = CMA(
            mean=start,
            sigma=_SPREAD,
            bounds=np.tile([0.0, 1.0], (len(space.names), 1)),
            population_size=config.candidates,
            seed=config.seed,
        )
        generations = [
            _breed(cma, trials, start, config, number) for number in range(config.generations)
        ]
        response = fit_response(
            np.array([t.shares for t in trials.done]),
            [t.start for t in trials.done],
            np.array([t.score for t in trials.done]),
            reference=start,
        )
        searched = len(trials.done)
        mean = np.clip(cma._mean, 0.0, 1.0)  # noqa: SLF001 - the distribution has no other access
        expected = [response.predict(shares) for shares in (mean, response.best)]
        winner = (mean, response.best)[int(np.argmax(expected))]
        after = space.to_values(winner)
        write_json(config.out / TUNED_FILE, set_values(content, after))
        numbers = range(_JUDGED_FROM, _JUDGED_FROM + config.judged)
        pairs = trials.run(
            [_Trial(shares=shares, start=n) for n in numbers for shares in (start, winner)],
            note="judgement",
        )
        was, now = ([t.result.success for t in pairs[k::2]] for k in (0, 1))
    only_before = sum(a and not b for a, b in zip(was, now, strict=True))
    only_after = sum(b and not a for a, b in zip(was, now, strict=True))
    return Tuning(
        names=space.names,
        before=space.before,
        after=after,
        chosen=("mean", "regression")[int(np.argmax(expected))],
        generations=generations,
        response=response,
        trials=searched,
        judged=config.judged,
        succeeded_before=sum(was),
        succeeded_after=sum(now),
        only_before=only_before,
        only_after=only_after,
        p_value=compute_mcnemar(only_before, only_after),
    )


class _Space:
    """Parameters as shares of their ranges."""

    def __init__(self, parameters: Mapping[str, Mapping[str, Any]]) -> None:
        self.names = tuple(parameters)
        self.before = {name: float(each["value"]) for name, each in parameters.items()}
        self._low, self._high = np.array([each["range"] for each in parameters.values()]).T

    def to_shares(self, values: Mapping[str, float]) -> np.ndarray:
        row = np.array([values[name] for name in self.names])
        return (row - self._low) / (self._high - self._low)

    def to_values(self, shares: np.ndarray) -> dict[str, float]:
        row = self._low + shares * (self._high - self._low)
        row = np.clip([float(f"{value:.4g}") for value in row], self._low, self._high)
        return dict(zip(self.names, map(float, row), strict=True))


@dataclass(kw_only=True, eq=False)
class _Trial:
    shares: np.ndarray
    start: int
    result: Any = None

    @property
    def score(self) -> float:
        return compute_score(self.result)


class _TrialRunner:
    """Makes trials by the workers of a run; those of an earlier run are taken from its folder."""

    def __init__(
        self,
        folder: RunFolder,
        dispatcher: Dispatcher,
        outcomes: Iterator[Any],
        *,
        space: _Space,
        config: TuneConfig,
        stop: Any,
        on_progress: Callable[[TuneProgress], None] | None,
    ) -> None:
        self.done: list[_Trial] = []
        """Trials in the order of their requests."""
        self._folder, self._dispatcher, self._outcomes = folder, dispatcher, outcomes
        self._space, self._config, self._stop = space, config, stop
        self._on_progress = on_progress
        self._known = {result.index: result for result in folder.results}
        self._began = time.monotonic()

    def run(self, trials: Sequence[_Trial], *, note: str) -> Sequence[_Trial]:
        """Make trials, and give them their results."""
        first = len(self.done)
        missing: dict[int, _Trial] = {}
        jobs = []
        for index, trial in enumerate(trials, start=first):
            if index in self._known:
                trial.result = self._known[index]
            else:
                missing[index] = trial
                jobs.append(self._make_job(index, trial))
        self.done += trials
        self._dispatcher.add(jobs)
        self._tell(note)
        while missing:
            outcome = next(self._outcomes, None)
            if outcome is None or self._stop.is_set():
                raise Interrupted
            result = read_outcome(outcome, has_episodes=False)
            self._folder.commit(result, outcome.folder)
            missing.pop(result.index).result = result
            self._tell(note)
        return trials

    def _make_job(self, index: int, trial: _Trial) -> Job:
        is_judged = trial.start >= _JUDGED_FROM
        name = f"trial-{index:05d}"
        request = TrialRequest(
            index=index,
            seed=make_attempt_seed(self._config.seed, trial.start),
            episode_id=name,
            values=self._space.to_values(trial.shares),
            start=trial.start,
            split="test" if is_judged and trial.start % 2 else "train",
            has_picture=is_judged,
        )
        return Job(name=name, request=request)

    def _tell(self, note: str) -> None:
        if self._on_progress is not None:
            self._on_progress(
                TuneProgress(
                    made=len(self._folder.results),
                    wanted=_count_trials(self._config),
                    resumed=len(self._known),
                    seconds=time.monotonic() - self._began,
                    note=note,
                )
            )


@contextmanager
def _opened(
    config: TuneConfig,
    task: Task,
    space: _Space,
    on_progress: Callable[[TuneProgress], None] | None,
) -> Iterator[_TrialRunner]:
    """Open the folder and start the workers of a search."""
    numbers = {n: getattr(config, n) for n in ("generations", "candidates", "starts", "judged")}
    record = RunRecord(
        run_format=1,
        task=task.id,
        seed=config.seed,
        attempt_factory=FACTORY,
        options={**config.options.to_plain(), **numbers, "before": space.before},
        versions=package_versions(),
        commands=(config.command,),
        **compute_own_checksums(task, config.options.demonstration),
    )
    with opened_run(config.out, record, resume=config.resume) as folder, stop_signals() as stop:
        dispatcher = Dispatcher(
            (),
            work=Work(factory=FACTORY, arguments={"task": config.task, "options": config.options}),
            workers=config.workers,
            folder=config.out,
            stop=stop,
            limits=Limits(),
        )
        with closing(dispatcher.run()) as outcomes:
            yield _TrialRunner(
                folder,
                dispatcher,
                outcomes,
                space=space,
                config=config,
                stop=stop,
                on_progress=on_progress,
            )


def _breed(
    cma: Any, trials: _TrialRunner, baseline: np.ndarray, config: TuneConfig, number: int
) -> Generation:
    """Make the trials of one generation, and tell CMA-ES their scores."""
    note = f"generation {number + 1} of {config.generations}"
    candidates = [cma.ask() for _ in range(config.candidates)]
    starts = range(number * config.starts, (number + 1) * config.starts)
    alive: Iterable[int] = range(config.candidates)
    scores: dict[int, list[float]] = {k: [] for k in (-1, *alive)}  # -1 is the baseline
    shared: dict[int, float] = {}
    for part in (starts[:_FIRST_STARTS], starts[_FIRST_STARTS:]):
        asked = [
            (k, _Trial(shares=baseline if k < 0 else candidates[k], start=start))
            for start in part
            for k in (-1, *alive)
        ]
        trials.run([trial for _, trial in asked], note=note)
        for k, trial in asked:
            scores[k].append(trial.score)
        if not shared:
            shared = {k: float(np.mean(each)) for k, each in scores.items()}
            ranked = sorted(alive, key=lambda k: -shared[k])
            alive = ranked[: config.candidates // 2]
    kept = set(alive)
    cma.tell(
        [
            (candidates[k], -float(np.mean(scores[k])) + (k not in kept))  # dropped ones come last
            for k in range(config.candidates)
        ]
    )
    means = [shared[k] for k in range(config.candidates)]
    return Generation(baseline=shared[-1], mean=float(np.mean(means)), best=max(means))


def _count_trials(config: TuneConfig) -> int:
    first = min(config.starts, _FIRST_STARTS)
    later = config.starts - first
    in_generation = first * (config.candidates + 1) + later * (config.candidates // 2 + 1)
    return config.generations * in_generation + 2 * config.judged
