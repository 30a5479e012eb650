"""How well a model finds places again: errors on unseen garments, by category and by how they lie."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import torch

from dgl_gam.augment import drop_points
from dgl_gam.confidence import Calibration, compute_auroc, fit_calibration
from dgl_gam.data.batches import fit_yaw
from dgl_gam.data.correspondence import compute_places, find_vertices, mirror_places
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.garment_file import FACING, GarmentData
from dgl_gam.data.symmetry import SYMMETRY, find_turned
from dgl_gam.errors import DataError
from dgl_gam.model import GarmentAffordanceModel

__all__ = [
    "EvalConfig",
    "Row",
    "Trial",
    "calibrate",
    "evaluate",
    "format_markdown",
    "list_conditions",
    "run_trial",
]

_ALL = "all"
_SENSOR: Mapping[str, tuple[Literal["hole", "line", "thin"], ...]] = {
    "noise_half": ("thin",),
    "noise_cut": ("hole", "line"),
    "noise_any": ("hole", "line", "thin"),
}
_HANGING = ("hung_one", "hung_two", "over_bar")
_ANYHOW = "_any"  # ends a condition in which what hangs is turned by any angle
_TURNS = 180  # of a body of revolution that are tried
_LATERAL = 0.15  # a place and its mirror image are told apart from this distance on


@dataclass(frozen=True, kw_only=True)
class EvalConfig:
    """What is measured. Lengths are shares of the target's horizontal diagonal as it lies flat."""

    pairs: int = 40
    """Pairs of garments for each category and condition."""
    points: int = 40
    """Random points for each pair, beside the landmarks."""
    visible: float = 0.03
    """A true place counts as visible if one of the observed points is as near to it on the flat garment."""
    hidden: float = 0.06
    """It counts as hidden if none is nearer than this. Places in between count as neither."""
    noise: float = 0.005
    """Standard deviation of the noise, in the condition with noise."""
    is_yaw_known: bool = False
    """Whether the model is told how the target is turned, instead of finding it: what the yaw costs."""
    seed: int = 0
    """Of everything drawn."""

    def __post_init__(self) -> None:
        if self.pairs < 1 or self.points < 0:
            raise ValueError(
                f"pairs must be positive and points not negative; got {self.pairs}, {self.points}"
            )
        if not 0 < self.visible <= self.hidden or self.noise < 0:
            raise ValueError(
                "visible and hidden must be positive and grow, noise not negative; got "
                f"{self.visible}, {self.hidden}, {self.noise}"
            )


@dataclass(frozen=True, kw_only=True, eq=False)
class Trial:
    """One demonstration found on one target; arrays have one entry for each of its K points."""

    error: np.ndarray
    """Distance of the match to the true position, as a share of the diagonal."""
    confidence: np.ndarray
    """The model's probability that the true point is visible."""
    evidence: np.ndarray
    """What that was computed from, shape (K, 4)."""
    is_visible: np.ndarray
    """Whether it is."""
    is_hidden: np.ndarray
    """Whether it is certainly not."""
    is_landmark: np.ndarray
    """Whether the point is a landmark, or else random."""
    is_lateral: np.ndarray
    """Whether left and right differ for the point."""
    is_swapped: np.ndarray
    """Whether the match is nearer to the mirrored place than to the true one."""
    seconds: float
    """Time that the model took, nothing cached [s]."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Measures of one category in one condition. NaN where there is nothing to measure."""

    category: str
    """Category of the garments; "all": the mean of the others, each by its symmetry where it has one."""
    symmetry: str = ""
    """Symmetry by which it is judged, see `dgl_gam.data.symmetry`: of the turns that lead to places as good the best one for
    all points of a pair together. Empty: place by place."""
    condition: str
    """How the target lies, see `list_conditions`; "all": every condition together."""
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
    """How well the confidence tells visible from hidden points: area under the ROC curve."""
    milliseconds: float
    """Median time of a pair, both clouds computed anew [ms]."""

    def to_dict(self) -> dict[str, Any]:
        """Plain values; NaN becomes None, as JSON needs it."""
        return {
            name: None if isinstance(value, float) and math.isnan(value) else value
            for name, value in asdict(self).items()
        }


def list_conditions(folder: GarmentFolder, category: str) -> tuple[str, ...]:
    """Conditions that a category's garments can be measured in.

    "flat_30": lying flat, turned by at most 30°; "flat_any": by any angle; "noise_half": as the first, with noise and
    half of the points missing here and there; "noise_cut": the same, but the missing points are a round hole or all beyond
    a line; "noise_any": any of the three; and each other kind of state in the files. What lies is turned by any angle. What
    hangs by at most 30°: its front and its back look alike, and only the turn tells on which side the camera is. By any
    angle all the same with "_any" behind its kind.
    """
    kinds = {
        folder.headers[i].state_kinds[s]
        for i in folder.get_indices(category)
        for s in range(len(folder.headers[i].state_names))
    }
    hanging = {kind + _ANYHOW for kind in kinds & set(_HANGING)}
    return ("flat_30", "flat_any", *_SENSOR, *sorted((kinds | hanging) - {"flat"}))


def _get_kind(condition: str) -> str:
    """Kind of the states that a condition is measured in."""
    return (
        "flat"
        if condition in ("flat_30", "flat_any", *_SENSOR)
        else condition.removesuffix(_ANYHOW)
    )


def run_trial(
    model: GarmentAffordanceModel,
    source: GarmentData,
    target: GarmentData,
    condition: str,
    config: EvalConfig,
    rng: np.random.Generator,
    *,
    symmetry: str = "",
) -> Trial | None:
    """Let a model find points of a garment lying flat on another one.

    Args:
        model: The model.
        source: The demonstrated garment.
        target: The observed garment.
        condition: How it lies, see `list_conditions`.
        config: What is measured.
        rng: Source of randomness.
        symmetry: That it is judged by; empty for place by place.

    Returns:
        What was found; None if the files have no such view of the target or no flat one of the source, or if the two
        share no place.
    """
    kind = _get_kind(condition)
    flat_views, views = source.get_views("flat"), target.get_views(kind)
    if not len(flat_views) or not len(views):
        return None
    source_view, view = int(rng.choice(flat_views)), int(rng.choice(views))
    source_cloud = source.view_points[source_view].astype(np.float64)
    source_seen = source.view_vertices[source_view]
    index, is_landmark = _choose_points(source, source_seen, config, rng)
    vertices = find_vertices(source, source_seen[index], target)
    index, is_landmark = index[vertices >= 0], is_landmark[vertices >= 0]
    vertices = vertices[vertices >= 0]
    if not len(vertices):
        return None

    cloud = target.view_points[view].astype(np.float64)
    seen = target.view_vertices[view]
    state = target.states[target.view_state[view]].astype(np.float64)
    is_limited = condition in ("flat_30", *_SENSOR, *_HANGING)
    limit = math.radians(30) if is_limited else math.pi
    angle = float(rng.uniform(-limit, limit))
    turn = _make_turn(angle)
    centre = cloud.mean(axis=0)
    cloud, state = (cloud - centre) @ turn.T, (state - centre) @ turn.T
    observed = cloud
    if condition in _SENSOR:
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        every = torch.from_numpy(cloud)[None]
        kept = drop_points(every, generator, share=0.5, kinds=_SENSOR[condition])[0].numpy()
        cloud, seen = cloud[kept], seen[kept]
        observed = cloud + rng.normal(size=cloud.shape) * config.noise * target.diagonal

    fresh = (
        GarmentAffordanceModel(  # holds no demonstration yet, so that the time is that of a pair
            model.checkpoint,
            category=model.category,
            device=model.device,
            source_views=model.source_views,
        )
    )
    yaw = None
    if config.is_yaw_known:
        yaw = angle if kind in FACING else _fit_yaw(target, seen, cloud)
    began = time.perf_counter()
    matches = fresh.locate(source_cloud, source_cloud[index], observed, yaw=yaw)
    seconds = time.perf_counter() - began

    places = compute_places(target)
    truth, wanted = state[vertices], places[vertices]
    if symmetry:
        truth, wanted = _turn_best(target, state, vertices, cloud[matches.indices])
    nearest = np.linalg.norm(places[seen][None] - wanted[:, None], axis=2).min(axis=1)
    mirrored = mirror_places(wanted)
    found = places[seen[matches.indices]]
    to_true = np.linalg.norm(found - wanted, axis=1)
    to_mirrored = np.linalg.norm(found - mirrored, axis=1)
    is_lateral = np.linalg.norm(mirrored - wanted, axis=1) > _LATERAL
    return Trial(
        error=np.linalg.norm(cloud[matches.indices] - truth, axis=1) / target.diagonal,
        confidence=matches.confidence,
        evidence=matches.evidence,
        is_visible=nearest <= config.visible,
        is_hidden=nearest > config.hidden,
        is_landmark=is_landmark,
        is_lateral=is_lateral & (not symmetry),
        is_swapped=to_mirrored < to_true,
        seconds=seconds,
    )


def _fit_yaw(target: GarmentData, seen: np.ndarray, cloud: np.ndarray) -> float:
    """Find the turn that carries the flat garment best onto a cloud whose vertices are known [rad]."""
    flat = torch.from_numpy(target.states[0][seen].astype(np.float32))[None]
    return float(fit_yaw(flat, torch.from_numpy(cloud.astype(np.float32))[None])[0])


def _turn_best(
    target: GarmentData, state: np.ndarray, vertices: np.ndarray, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turn the true places of a body of revolution about its axis, all together, until they are nearest to the matches.

    Returns:
        Their positions in the state, shape (K, 3), and the places, shape (K, 4).
    """
    angles = np.arange(_TURNS) * (2 * math.pi / _TURNS)
    corners, weights = find_turned(target, vertices, angles)
    truth = (state[corners] * weights[..., None]).sum(axis=2)  # (A, K, 3)
    best = int(np.linalg.norm(truth - found, axis=2).mean(axis=1).argmin())
    places = compute_places(target)[corners[best]]
    return truth[best], (places * weights[best][..., None]).sum(axis=1).astype(np.float32)


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
        For each category a row for each condition, and one for all together, where there are enough hidden points for
        a meaningful AUROC; these once more by its symmetry, where it has one; then the means over the categories where there
        are several.

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
    """Fit the confidence on garments, best on those that the model was trained on, so that the others stay unseen.

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
    """Write rows as a table; errors and shares in percent, times in milliseconds unless they are left out."""
    lines = [
        "| category | condition | pairs | mean error | PCK@.05 | PCK@.10 | landmarks PCK@.05 | PCK@.10 "
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


def _choose_points(
    source: GarmentData, seen: np.ndarray, config: EvalConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Visible points of the source that are landmarks, then random ones: indices, and whether they are landmarks."""
    places = compute_places(source)
    distance = np.linalg.norm(places[source.landmarks][:, None] - places[seen][None], axis=2)
    nearest = distance.argmin(axis=1) if len(distance) else np.zeros(0, np.int64)
    nearest = nearest[distance.min(axis=1) <= config.visible] if len(distance) else nearest
    drawn = rng.choice(len(seen), min(config.points, len(seen)), replace=False)
    index = np.concatenate([nearest, drawn]).astype(np.int64)
    return index, np.arange(len(index)) < len(nearest)


def _make_turn(angle: float) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


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
    kind = _get_kind(condition)
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
