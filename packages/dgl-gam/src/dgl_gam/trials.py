"""Trials: one source matched with one target in a condition."""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch

from dgl_gam.augment import drop_points
from dgl_gam.data.batches import fit_yaw
from dgl_gam.data.correspondence import compute_places, find_vertices, mirror_places
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.garment_file import FACING, GarmentData
from dgl_gam.data.symmetry import find_turned
from dgl_gam.model import GarmentAffordanceModel, Matches

__all__ = ["EvalConfig", "Trial", "get_kind", "list_conditions", "run_trial"]

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
    """Settings of an evaluation; lengths are shares of the flat target's diagonal."""

    pairs: int = 40
    """Pairs of garments for each category and condition."""
    points: int = 40
    """Random points for each pair, beside the landmarks."""
    visible: float = 0.03
    """A true place counts as visible if an observed point is as near to it on the flat garment."""
    hidden: float = 0.06
    """It counts as hidden if none is nearer than this. Places in between count as neither."""
    noise: float = 0.005
    """Standard deviation of the noise, in the condition with noise."""
    is_yaw_known: bool = False
    """Give the model the true yaw, which measures the cost of estimating it."""
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
    """Evidence behind the confidence, shape (K, 4)."""
    is_visible: np.ndarray
    """Visible, bool."""
    is_hidden: np.ndarray
    """Certainly hidden, bool."""
    is_landmark: np.ndarray
    """Landmark rather than random point, bool."""
    is_lateral: np.ndarray
    """Left and right differ for the point, bool."""
    is_swapped: np.ndarray
    """Match nearer to the mirrored place than to the true one, bool."""
    seconds: float
    """Time that the model took, nothing cached [s]."""


def list_conditions(folder: GarmentFolder, category: str) -> tuple[str, ...]:
    """Conditions that a category's garments can be measured in.

    "flat_30": lying flat, turned by at most 30°; "flat_any": by any angle; "noise_half": as the
    first, with noise and half of the points missing here and there; "noise_cut": the same, but the
    missing points are a round hole or all beyond a line; "noise_any": any of the three; and each
    other kind of state in the files. What lies is turned by any angle. What hangs by at most 30°:
    its front and its back look alike, and only the turn tells on which side the camera is. A
    kind followed by "_any" is turned by any angle all the same.
    """
    kinds = {
        folder.headers[i].state_kinds[s]
        for i in folder.get_indices(category)
        for s in range(len(folder.headers[i].state_names))
    }
    hanging = {kind + _ANYHOW for kind in kinds & set(_HANGING)}
    return ("flat_30", "flat_any", *_SENSOR, *sorted((kinds | hanging) - {"flat"}))


def get_kind(condition: str) -> str:
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
        What was found; None if the files have no such view of the target or no flat one of the
        source, or if the two share no place.
    """
    kind = get_kind(condition)
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
    look = _look(target, view, condition, config, rng)

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
        yaw = look.angle if kind in FACING else _fit_yaw(target, look.seen, look.cloud)
    began = time.perf_counter()
    matches = fresh.locate(source_cloud, source_cloud[index], look.observed, yaw=yaw)
    seconds = time.perf_counter() - began
    return _judge(target, look, vertices, is_landmark, matches, seconds, config, symmetry)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Look:
    """The target as it lies before the model, turned by the trial's angle."""

    angle: float
    """Yaw [rad]."""
    state: np.ndarray
    """Positions of all vertices [m], shape (V, 3)."""
    seen: np.ndarray
    """Vertices that the points of the cloud belong to, shape (N,)."""
    cloud: np.ndarray
    """Positions of the visible points [m], shape (N, 3)."""
    observed: np.ndarray
    """The same with noise and missing points [m], shape (N, 3)."""


def _look(
    target: GarmentData, view: int, condition: str, config: EvalConfig, rng: np.random.Generator
) -> _Look:
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
    return _Look(angle=angle, state=state, seen=seen, cloud=cloud, observed=observed)


def _judge(
    target: GarmentData,
    look: _Look,
    vertices: np.ndarray,
    is_landmark: np.ndarray,
    matches: Matches,
    seconds: float,
    config: EvalConfig,
    symmetry: str,
) -> Trial:
    """Compare matches with where the target's vertices, shape (K,), truly are."""
    places = compute_places(target)
    truth, wanted = look.state[vertices], places[vertices]
    if symmetry:
        found = look.cloud[matches.indices]
        truth, wanted = _turn_best(target, look.state, vertices, found)
    seen_places = places[look.seen]
    nearest = np.linalg.norm(seen_places[None] - wanted[:, None], axis=2).min(axis=1)
    mirrored = mirror_places(wanted)
    found_places = seen_places[matches.indices]
    to_true = np.linalg.norm(found_places - wanted, axis=1)
    to_mirrored = np.linalg.norm(found_places - mirrored, axis=1)
    is_lateral = np.linalg.norm(mirrored - wanted, axis=1) > _LATERAL
    return Trial(
        error=np.linalg.norm(look.cloud[matches.indices] - truth, axis=1) / target.diagonal,
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
    """Find the yaw that best carries the flat garment onto a cloud of known vertices [rad]."""
    flat = torch.from_numpy(target.states[0][seen].astype(np.float32))[None]
    return float(fit_yaw(flat, torch.from_numpy(cloud.astype(np.float32))[None])[0])


def _turn_best(
    target: GarmentData, state: np.ndarray, vertices: np.ndarray, found: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Turn the true places of a round garment together until they are nearest to the matches.

    Returns:
        Their positions in the state, shape (K, 3), and the places, shape (K, 4).
    """
    angles = np.arange(_TURNS) * (2 * math.pi / _TURNS)
    corners, weights = find_turned(target, vertices, angles)
    truth = (state[corners] * weights[..., None]).sum(axis=2)  # (A, K, 3)
    best = int(np.linalg.norm(truth - found, axis=2).mean(axis=1).argmin())
    places = compute_places(target)[corners[best]]
    return truth[best], (places * weights[best][..., None]).sum(axis=1).astype(np.float32)


def _choose_points(
    source: GarmentData, seen: np.ndarray, config: EvalConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Choose source points, landmarks first: indices, and a mask of landmarks."""
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
