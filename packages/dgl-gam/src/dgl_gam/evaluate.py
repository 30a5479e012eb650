"""Errors of a model on unseen garments, by category and condition."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dgl_gam.confidence import Calibration, compute_auroc, fit_calibration
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.symmetry import SYMMETRY
from dgl_gam.errors import DataError
from dgl_gam.model import GarmentAffordanceModel
from dgl_gam.trials import EvalConfig, Trial, get_kind, list_conditions, run_trial

__all__ = ["EvalConfig", "Row", "calibrate", "evaluate", "format_markdown"]

_ALL = "all"


@dataclass(frozen=True, kw_only=True)
class Row:
    """Measures of one category in one condition. NaN where there is nothing to measure."""

    category: str
    """Category of the garments; "all" for the mean of all categories."""
    symmetry: str = ""
    """Symmetry by which errors are judged, see `dgl_gam.data.symmetry`: the error of the best
    equivalent rotation; empty if none."""
    condition: str
    """Condition of the target, see `list_conditions`; "all" for every condition together."""
    pairs: int
    """Pairs of garments."""
    points: int
    """Visible points."""
    mean_error: float
    """Mean error of the visible points, as a share of the diagonal."""
    pck05: float
    """Share of them that are found within 5 % of the diagonal."""
    pck10: float
    """Share of them that are found within 10 %."""
    landmark_pck05: float
    """The same for landmarks alone, 5 %."""
    landmark_pck10: float
    """The same for landmarks alone, 10 %."""
    swap_rate: float
    """Share of the visible lateral points that are found on the wrong side."""
    hidden: int
    """Hidden points."""
    hidden_auroc: float
    """Area under the ROC curve of the confidence as a test for visible points."""
    milliseconds: float
    """Median time of a pair, both clouds computed anew [ms]."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values; NaN becomes None, as JSON needs it."""
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(self).items()
        }


def evaluate(
    models: Mapping[str, GarmentAffordanceModel],
    folder: GarmentFolder,
    config: EvalConfig | None = None,
    *,
    on_progress: Callable[[str, str], None] | None = None,
) -> list[Row]:
    """Measure models on a folder of garments, each against others of its category.

    Args:
        models: Model of each category of the folder.
        folder: Garments, best of the split "test".
        config: What is measured; the defaults when None.
        on_progress: Called with category and condition before each is measured.

    Returns:
        For each category a row for each condition, and one for all together, where there are enough
        hidden points for a meaningful AUROC; these once more by its symmetry, where it has one;
        then the means over the categories where there are several.

    Raises:
        DataError: If a category has a single garment, or a model is missing.
    """
    config = config or EvalConfig()
    rows: list[Row] = []
    for category in folder.categories:
        if category not in models:
            raise DataError(f"there must be a model for each category; none for {category}")
        symmetries = ("", SYMMETRY[category]) if category in SYMMETRY else ("",)
        every: dict[str, list[Trial]] = {symmetry: [] for symmetry in symmetries}
        for condition in list_conditions(folder, category):
            if on_progress is not None:
                on_progress(category, condition)
            for symmetry, found in every.items():
                trials = _run_trials(
                    models[category], folder, category, condition, config, symmetry=symmetry
                )
                if trials:
                    rows.append(_summarize(category, condition, trials, symmetry=symmetry))
                    found += trials
        rows += [
            _summarize(category, _ALL, found, symmetry=symmetry)
            for symmetry, found in every.items()
            if found
        ]
    if len(folder.categories) > 1:
        conditions = dict.fromkeys(row.condition for row in rows)
        judged = [r for r in rows if r.symmetry or r.category not in SYMMETRY]
        rows += [_average(c, [r for r in judged if r.condition == c]) for c in conditions]
    return rows


def calibrate(
    models: Mapping[str, GarmentAffordanceModel],
    folder: GarmentFolder,
    config: EvalConfig | None = None,
) -> Calibration:
    """Fit the confidence on garments, best on the training split, so that the others stay unseen.

    Raises:
        DataError: If all true points are visible, or all hidden.
    """
    config = config or EvalConfig()
    evidence, is_visible = [], []
    for category in folder.categories:
        symmetry = SYMMETRY.get(category, "")
        for condition in list_conditions(folder, category):
            for trial in _run_trials(
                models[category], folder, category, condition, config, symmetry=symmetry
            ):
                used = trial.is_visible | trial.is_hidden
                evidence.append(trial.evidence[used])
                is_visible.append(trial.is_visible[used])
    labels = np.concatenate(is_visible) if is_visible else np.zeros(0, bool)
    if not 0 < labels.sum() < len(labels):
        raise DataError(
            "a calibration needs visible and hidden points; the data have one kind only"
        )
    return fit_calibration(np.concatenate(evidence), labels)


def format_markdown(rows: Sequence[Row], *, is_timed: bool = True) -> str:
    """Format rows as a Markdown table: errors and shares [%], times [ms] if wanted."""
    lines = [
        "| category | condition | pairs | mean error | PCK@.05 | PCK@.10 | landmarks PCK@.05 | "
        "PCK@.10 "
        "| swapped | hidden | AUROC |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    if is_timed:
        lines = [lines[0] + " ms |", lines[1] + "--:|"]
    for row in rows:
        shares = [
            _format(value, 100, 1, " %")
            for value in (
                row.mean_error,
                row.pck05,
                row.pck10,
                row.landmark_pck05,
                row.landmark_pck10,
                row.swap_rate,
            )
        ]
        name = f"{row.category}, by its {row.symmetry}" if row.symmetry else row.category
        cells = [name, row.condition, str(row.pairs), *shares]
        cells += [str(row.hidden), _format(row.hidden_auroc, 1, 2, "")]
        if is_timed:
            cells.append(_format(row.milliseconds, 1, 0, ""))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _format(value: float, factor: float, digits: int, unit: str) -> str:
    return "" if math.isnan(value) else f"{value * factor:.{digits}f}{unit}"


def _run_trials(
    model: GarmentAffordanceModel,
    folder: GarmentFolder,
    category: str,
    condition: str,
    config: EvalConfig,
    *,
    symmetry: str = "",
) -> list[Trial]:
    indices = folder.get_indices(category)
    if len(indices) < 2:
        raise DataError(f"there must be at least 2 garments of {category} to compare; got 1")
    # The same pairs whatever else is measured, and whichever model.
    rng = np.random.default_rng([config.seed, *(category + condition).encode()])
    kind = get_kind(condition)
    targets = [i for i in indices if kind in folder.headers[i].state_kinds]
    trials = []
    for _ in range(config.pairs):
        target = rng.choice(targets)
        source = rng.choice([i for i in indices if i != target])
        pair = folder.load(int(source)), folder.load(int(target))
        trial = run_trial(model, *pair, condition, config, rng, symmetry=symmetry)
        if trial is not None:
            trials.append(trial)
    return trials


def _summarize(
    category: str, condition: str, trials: Sequence[Trial], *, symmetry: str = ""
) -> Row:
    def join(name: str) -> np.ndarray:
        return np.concatenate([getattr(trial, name) for trial in trials])

    visible, hidden = join("is_visible"), join("is_hidden")
    error = join("error")
    marks = visible & join("is_landmark")
    lateral = visible & join("is_lateral")
    decided = visible | hidden
    return Row(
        category=category,
        symmetry=symmetry,
        condition=condition,
        pairs=len(trials),
        points=int(visible.sum()),
        mean_error=_mean(error[visible]),
        pck05=_mean(error[visible] <= 0.05),
        pck10=_mean(error[visible] <= 0.10),
        landmark_pck05=_mean(error[marks] <= 0.05),
        landmark_pck10=_mean(error[marks] <= 0.10),
        swap_rate=_mean(join("is_swapped")[lateral]),
        hidden=int(hidden.sum()),
        hidden_auroc=compute_auroc(join("confidence")[decided], visible[decided]),
        milliseconds=1e3 * float(np.median([trial.seconds for trial in trials])),
    )


def _average(condition: str, rows: Sequence[Row]) -> Row:
    def mean(name: str) -> float:
        values = [getattr(row, name) for row in rows]
        return _mean(np.array([v for v in values if not math.isnan(v)]))

    measures = ("mean_error", "pck05", "pck10", "landmark_pck05", "landmark_pck10", "swap_rate")
    return Row(
        category=_ALL,
        symmetry="",
        condition=condition,
        pairs=sum(row.pairs for row in rows),
        points=sum(row.points for row in rows),
        hidden=sum(row.hidden for row in rows),
        **{name: mean(name) for name in (*measures, "hidden_auroc", "milliseconds")},
    )


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if len(values) else float("nan")
