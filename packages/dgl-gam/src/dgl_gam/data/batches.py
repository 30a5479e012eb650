"""Batches for training: augmented views with corresponding and other points."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from dgl_gam._sampling import gather_points
from dgl_gam._yaw import rotate_yaw
from dgl_gam.augment import drop_points, warp_clouds
from dgl_gam.data.correspondence import compute_places, find_vertices, mirror_places
from dgl_gam.data.folder import GarmentFolder
from dgl_gam.data.garment_file import FACING, VIEW_POINTS, GarmentData
from dgl_gam.errors import DataError
from dgl_gam.network import center_clouds

__all__ = ["Batch", "BatchConfig", "BatchMaker", "choose_negatives", "fit_yaw"]

_FACING_STRENGTH = 0.5  # of the yaw of what hangs: front and back look alike


@dataclass(frozen=True, kw_only=True)
class BatchConfig:
    """Contents of a batch."""

    groups: int = 4
    """Groups of views; a group is of one category, and its views are compared with each other."""
    group_size: int = 4
    """Views in a group; every two of them are a pair."""
    points: int = VIEW_POINTS
    """Points of a view that are used, drawn anew each time."""
    positives: int = 20
    """Pairs of corresponding points, for each pair of views. Source: paper."""
    negatives: int = 150
    """Points of the target that do not correspond, for each positive. Source: paper."""
    near_share: float = 0.4
    """Share of the negatives that are taken from near the positive."""
    traced_share: float = 0.25
    """Share of the groups that are views of one garment in its states."""
    flat_share: float = 0.4
    """Share of the views that show a garment lying flat."""
    max_distance: float = 0.02
    """Farthest that a positive may be from the true place, as a share of the diagonal."""
    margin: float = 0.04
    """Nearest that a negative may be to the true place, as a share of the diagonal."""
    near: float = 0.25
    """Radius of "near the positive", as a share of the diagonal."""
    yaw: float = math.radians(15.0)
    """Largest random turn of a view in the garment frame [rad]: the error of the yaw to be
    tolerated."""
    bend: float = 0.06
    """Size of the smooth bending, in normalised units."""
    stretch: float = 0.2
    """Largest relative change of size along a direction."""
    noise: float = 0.01
    """Largest standard deviation of the noise, in normalised units."""
    missing: float = 0.5
    """Largest share of the points that is missing."""
    state_weights: tuple[tuple[str, float], ...] = ()
    """Weights of kinds of states in views of any state, such as (("crumpled", 2.0),); 1 for all
    others. The flat state is not among them."""
    mirrored_share: float = 0.0
    """Share of the clouds for the yaw that are mirrored; a mirrored garment is turned the other
    way."""
    least_yaw_weight: float = 0.0
    """Smallest weight of a cloud in the loss of the yaw, where no turn explains it well."""

    def __post_init__(self) -> None:
        for name in ("groups", "positives", "negatives"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1; got {getattr(self, name)}")
        if self.group_size < 2:
            raise ValueError(f"group_size must be at least 2; got {self.group_size}")
        if not 64 <= self.points <= VIEW_POINTS:
            raise ValueError(f"points must be in [64, {VIEW_POINTS}]; got {self.points}")
        for name in (
            "near_share", "traced_share", "flat_share", "mirrored_share", "least_yaw_weight"
        ):  # fmt: skip
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} must be in [0, 1]; got {getattr(self, name)}")
        if not 0 <= self.missing < 0.9:
            raise ValueError(f"missing must be in [0, 0.9); got {self.missing}")
        object.__setattr__(
            self, "state_weights", tuple((k, float(w)) for k, w in self.state_weights)
        )
        if any(weight <= 0 for _, weight in self.state_weights):
            raise ValueError(f"state_weights must be positive; got {self.state_weights}")
        if not 0 < self.max_distance <= self.margin < self.near:
            raise ValueError(
                "max_distance, margin and near must be positive and grow; got "
                f"{self.max_distance}, {self.margin}, {self.near}"
            )


class _Member(NamedTuple):
    """A view in a group."""

    garment: GarmentData
    points: np.ndarray
    vertices: np.ndarray
    is_facing: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class Batch:
    """C clouds of N points, and P pairs of clouds with S pairs of points each."""

    points: Tensor
    """Clouds in the normalised frame, turned roughly into the garments' own, shape (C, N, 3)."""
    category: Tensor
    """Index of each cloud's category, shape (C,), int64."""
    turned: Tensor
    """The same clouds turned anyhow, for the yaw, shape (C, N, 3)."""
    yaw: Tensor
    """Yaw of each cloud [rad], shape (C,)."""
    yaw_weight: Tensor
    """Weight of each yaw, shape (C,), in [0, 1]: 1 for a flat garment, near 0 for a crumpled
    one."""
    clouds: Tensor
    """Source and target cloud of each pair, shape (P, 2), int64."""
    source: Tensor
    """Points of the source, shape (P, S), int64."""
    positive: Tensor
    """The corresponding points of the target, shape (P, S), int64."""
    negative: Tensor
    """Points of the target that do not correspond, shape (P, S, negatives), int64."""
    is_used: Tensor
    """Mask of the pairs of points that count, shape (P, S), bool."""
    is_negative: Tensor
    """Mask of the negatives that count, shape (P, S, negatives), bool."""

    def to(self, device: torch.device) -> "Batch":
        """Move to a device."""
        return Batch(**{name: value.to(device) for name, value in vars(self).items()})


class BatchMaker:
    """Batches by step; the same seed and step give the same batch."""

    def __init__(self, folder: GarmentFolder, config: BatchConfig, *, seed: int) -> None:
        """Prepare.

        Args:
            folder: Garments to draw from.
            config: What a batch holds.
            seed: Of everything drawn.

        Raises:
            DataError: If a category has one garment only, so that nothing could be compared across
                garments.
        """
        self._folder = folder
        self._config = config
        self._seed = seed
        self._categories = folder.categories
        self._deformed: dict[str, tuple[int, ...]] = {}
        for category in self._categories:
            indices = folder.get_indices(category)
            if len(indices) < 2:
                raise DataError(
                    f"there must be at least 2 garments of {category} to train on; got 1"
                )
            deformed = tuple(i for i in indices if len(folder.headers[i].state_names) > 1)
            self._deformed[category] = deformed or indices

    def make(self, step: int, *, has_pairs: bool = True) -> Batch:
        """Make the batch of a step; for the yaw alone without pairs of points."""
        rng = np.random.default_rng([self._seed, step])
        config = self._config
        members: list[_Member] = []
        categories: list[int] = []
        for _ in range(config.groups):
            number = int(rng.integers(len(self._categories)))
            categories += [number] * config.group_size
            members += self._draw_group(self._categories[number], rng)
        points, kept, turned, yaw, weight = self._augment(members, rng)
        places = [compute_places(member.garment) for member in members]
        seen = [m.vertices[k] for m, k in zip(members, kept, strict=True)]  # of each point kept
        rows: list[dict[str, np.ndarray]] = []
        for group in range(config.groups if has_pairs else 0):
            start = group * config.group_size
            for a in range(start, start + config.group_size):
                for b in range(a + 1, start + config.group_size):
                    first, second = (a, b) if rng.random() < 0.5 else (b, a)
                    row = self._pair(
                        members[first].garment, seen[first], members[second].garment, seen[second],
                        places[second], rng,
                    )  # fmt: skip
                    rows.append({"clouds": np.array([first, second]), **row})
        stacked = _stack_pairs(rows, config)
        return Batch(
            points=points,
            category=torch.tensor(categories),
            turned=turned,
            yaw=yaw,
            yaw_weight=weight,
            **stacked,
        )

    def _draw_group(self, category: str, rng: np.random.Generator) -> list["_Member"]:
        """Draw the views of one category."""
        config, every = self._config, self._folder.get_indices(category)
        deformed = self._deformed[category]
        is_traced = rng.random() < config.traced_share
        is_flat = rng.random(config.group_size) < config.flat_share
        # Where many garments have the flat state only, the others are drawn for their deformed ones
        # all the same.
        first = self._folder.load(
            int(rng.choice(deformed if is_traced or not is_flat[0] else every))
        )
        is_traced = is_traced or not first.has_canonical
        drawn = []
        for number in range(config.group_size):
            garment = first
            if number and not is_traced:
                other = rng.choice(every if is_flat[number] else deformed)
                garment = self._folder.load(int(other))
                garment = garment if garment.has_canonical else first
            views = garment.get_views("flat") if is_flat[number] else np.zeros(0, np.int64)
            view = int(rng.choice(views)) if len(views) else self._draw_view(garment, rng)
            points, vertices = garment.view_points[view], garment.view_vertices[view]
            if config.points < VIEW_POINTS:
                some = rng.permutation(VIEW_POINTS)[: config.points]
                points, vertices = points[some], vertices[some]
            is_facing = garment.header.state_kinds[garment.view_state[view]] in FACING
            drawn.append(_Member(garment, points, vertices, is_facing))
        return drawn

    def _draw_view(self, garment: GarmentData, rng: np.random.Generator) -> int:
        """Draw a view of a garment by the weights of its states."""
        if not self._config.state_weights:
            return int(rng.choice(len(garment.view_state)))
        weights, kinds = dict(self._config.state_weights), garment.header.state_kinds
        share = np.array([weights.get(kinds[state], 1.0) for state in garment.view_state])
        return int(rng.choice(len(share), p=share / share.sum()))

    def _augment(
        self,
        members: list["_Member"],
        rng: np.random.Generator,
    ) -> tuple[Tensor, np.ndarray, Tensor, Tensor, Tensor]:
        """Augment clouds: network input, kept points, and turned clouds with their yaw."""
        config = self._config
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        flat = torch.from_numpy(np.stack([m.garment.states[0][m.vertices] for m in members]))
        points = center_clouds(torch.from_numpy(np.stack([m.points for m in members])))[0]
        facing = torch.tensor([m.is_facing for m in members])
        # What hangs has the file's frame: turned upside down, its left would be on the other side.
        yaw = fit_yaw(flat, points)[0].masked_fill(facing, 0.0)
        own = rotate_yaw(points, -yaw)
        points = warp_clouds(
            own,
            generator,
            yaw=config.yaw,
            bend=config.bend,
            stretch=config.stretch,
            noise=float(rng.uniform(0, config.noise)),
        )
        share = 0.0 if rng.random() < 0.3 else float(rng.uniform(0, config.missing))
        kept = drop_points(points, generator, share=share)
        points = center_clouds(gather_points(points, kept))[0]
        angle, strength = fit_yaw(gather_points(flat, kept), points)
        hung = fit_yaw(gather_points(own, kept), points)[0]
        angle = torch.where(facing, hung, angle)
        strength = torch.where(facing, _FACING_STRENGTH, strength).clamp(
            min=config.least_yaw_weight
        )
        turned = points
        if config.mirrored_share:
            flip = torch.from_numpy(
                np.where(rng.random(len(members)) < config.mirrored_share, -1, 1)
            )
            turned = torch.cat([points[..., :1] * flip[:, None, None], points[..., 1:]], dim=2)
            angle = angle * flip
        spin = torch.from_numpy(rng.uniform(-math.pi, math.pi, len(members)).astype(np.float32))
        return points, kept.numpy(), rotate_yaw(turned, spin), angle + spin, strength

    def _pair(
        self,
        source: GarmentData,
        source_seen: np.ndarray,
        target: GarmentData,
        target_seen: np.ndarray,
        places: np.ndarray,
        rng: np.random.Generator,
    ) -> dict[str, np.ndarray]:
        """Corresponding points of two views, and points that do not correspond."""
        config = self._config
        candidates = rng.choice(
            len(source_seen), min(4 * config.positives, len(source_seen)), False
        )
        vertices = find_vertices(source, source_seen[candidates], target)
        wanted, there = places[vertices], places[target_seen]  # (n, 4), (N, 4)
        distance = _compute_distances(wanted, there)
        nearest = distance.argmin(axis=1)
        is_there = distance[np.arange(len(nearest)), nearest] <= config.max_distance
        # Those that correspond first; what fills up does not count.
        order = np.argsort(~(is_there & (vertices >= 0)), kind="stable")[: config.positives]
        order = np.resize(order, config.positives)
        is_used = (is_there & (vertices >= 0))[order]
        mirrored = _compute_distances(mirror_places(wanted[order]), there).argmin(axis=1)
        negative, is_negative = choose_negatives(distance[order], mirrored, config, rng)
        return {
            "source": candidates[order],
            "positive": nearest[order],
            "negative": negative,
            "is_used": is_used,
            "is_negative": is_negative,
        }


def _stack_pairs(rows: list[dict[str, np.ndarray]], config: BatchConfig) -> dict[str, torch.Tensor]:
    """Pairs one after another; without any, arrays of no pairs."""
    if rows:
        return {name: torch.from_numpy(np.stack([row[name] for row in rows])) for name in rows[0]}
    few, many = (0, config.positives), (0, config.positives, config.negatives)
    return {
        "clouds": torch.zeros((0, 2), dtype=torch.int64),
        "source": torch.zeros(few, dtype=torch.int64),
        "positive": torch.zeros(few, dtype=torch.int64),
        "negative": torch.zeros(many, dtype=torch.int64),
        "is_used": torch.zeros(few, dtype=torch.bool),
        "is_negative": torch.zeros(many, dtype=torch.bool),
    }


def choose_negatives(
    distance: np.ndarray, mirrored: np.ndarray, config: BatchConfig, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Choose points of the target that do not correspond: near, anywhere, and mirrored.

    Args:
        distance: Of each point of the target to the true place, as a share of the diagonal, shape
            (S, N).
        mirrored: The point nearest to the true place with left and right swapped, shape (S,).
        config: How many, and what is near.
        rng: Source of randomness.

    Returns:
        Indices, shape (S, negatives), int64, and which of them count, shape (S, negatives), bool:
        all but where the target has too few points, or the mirrored place is the place itself.
    """
    rows = np.arange(len(distance))
    is_far = distance > config.near
    is_near = (distance > config.margin) & ~is_far
    weight = (
        config.near_share * is_near / np.maximum(is_near.sum(axis=1, keepdims=True), 1)
        + (1 - config.near_share) * is_far / np.maximum(is_far.sum(axis=1, keepdims=True), 1)
        + 1e-9 * (is_near | is_far)
    )
    with np.errstate(divide="ignore"):
        # Smallest of exponential variables: drawn without replacement with these weights.
        keys = rng.exponential(size=distance.shape) / weight
    count = min(config.negatives, distance.shape[1])
    chosen = np.argpartition(keys, count - 1, axis=1)[:, :count]
    is_valid = np.isfinite(np.take_along_axis(keys, chosen, axis=1))
    if count < config.negatives:
        missing = config.negatives - count
        chosen = np.pad(chosen, ((0, 0), (0, missing)))
        is_valid = np.pad(is_valid, ((0, 0), (0, missing)))
    is_other = distance[rows, mirrored] > config.margin
    chosen[is_other, 0] = mirrored[is_other]
    is_valid[is_other, 0] = True
    return chosen, is_valid


def fit_yaw(flat: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Find the turn about the vertical that carries garments lying flat best onto clouds.

    Args:
        flat: Positions of the points' places on the flat garment, shape (B, N, 3).
        points: Clouds, shape (B, N, 3).

    Returns:
        Angles [rad], shape (B,), and how much of the clouds they explain, shape (B,), in [0, 1].
    """
    a = flat[..., :2] - flat[..., :2].mean(dim=1, keepdim=True)
    b = points[..., :2] - points[..., :2].mean(dim=1, keepdim=True)
    cross = (a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]).sum(dim=1)
    dot = (a * b).sum(dim=(1, 2))
    size = (a.square().sum(dim=(1, 2)) * b.square().sum(dim=(1, 2))).sqrt()
    return torch.atan2(cross, dot), torch.hypot(cross, dot) / size.clamp(min=1e-12)


def _compute_distances(wanted: np.ndarray, there: np.ndarray) -> np.ndarray:
    squared = (wanted**2).sum(axis=1)[:, None] - 2 * wanted @ there.T + (there**2).sum(axis=1)[None]
    return np.sqrt(np.maximum(squared, 0))
