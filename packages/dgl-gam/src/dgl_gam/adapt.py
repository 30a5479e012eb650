"""Few-shot adaptation: a trained network learns a handful of pairs that somebody has annotated."""

import copy
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from dgl_gam._arrays import check_cloud
from dgl_gam.augment import warp_clouds
from dgl_gam.confidence import Calibration
from dgl_gam.model import MIN_POINTS, NETWORK_POINTS, GarmentAffordanceModel
from dgl_gam.network import center_clouds

__all__ = ["AdaptConfig", "AnnotatedPair", "adapt"]


@dataclass(frozen=True, kw_only=True, eq=False)
class AnnotatedPair:
    """Two clouds with points that correspond."""

    source_cloud: np.ndarray
    """Shape (N, 3) [m]."""
    source_points: np.ndarray
    """Points on it, shape (K, 3) [m]."""
    target_cloud: np.ndarray
    """Shape (M, 3) [m]."""
    target_points: np.ndarray
    """The same places on the other, shape (K, 3) [m]."""


@dataclass(frozen=True, kw_only=True)
class AdaptConfig:
    """Settings of an adaptation."""

    steps: int = 60
    """Steps; in each, all pairs, bent anew."""
    lr: float = 2e-4
    """Learning rate of Adam; falls to zero as a cosine."""
    temperature: float = 0.07
    """Of InfoNCE, whose negatives are all points beyond `margin`."""
    margin: float = 0.08
    """Least distance of a negative from the annotated point, in normalised units; a garment about
    fills [-1, 1]."""
    keep: float = 1.0
    """Weight of staying with the features that the network had, on all points of the clouds."""
    seed: int = 0
    """Of the bending."""

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.lr > 0 or not self.temperature > 0:
            raise ValueError(
                "steps, lr and temperature must be positive; got "
                f"{self.steps}, {self.lr}, {self.temperature}"
            )


def adapt(
    model: GarmentAffordanceModel,
    pairs: Sequence[AnnotatedPair],
    config: AdaptConfig | None = None,
    *,
    on_progress: Callable[[int, float], None] | None = None,
) -> GarmentAffordanceModel:
    """Teach a model a few annotated pairs, without forgetting what it knew.

    Args:
        model: The model; it is left as it is.
        pairs: What is annotated. Clouds have 16 to 2,048 points.
        config: How; the defaults when None.
        on_progress: Called after each step with its number and loss.

    Returns:
        A model of its own; its confidence is no longer calibrated.

    Raises:
        ValueError: If there is no pair, a cloud is wrong, or the numbers of points of a pair
            differ.
    """
    config = config or AdaptConfig()
    if not pairs:
        raise ValueError("pairs must not be empty")
    prepared = [_prepare(model, number, pair) for number, pair in enumerate(pairs)]
    network = copy.deepcopy(model.checkpoint.network).to(model.device)
    adapted = GarmentAffordanceModel(
        replace(model.checkpoint, network=network, calibration=Calibration()),
        category=model.category,
        device=model.device,
        source_views=model.source_views,
    )
    # The yaw is left alone: points on clouds say little about it.
    learned = [p for name, p in network.named_parameters() if not name.startswith("yaw.")]
    optimizer = torch.optim.Adam(learned, lr=config.lr, foreach=False)
    generator = torch.Generator().manual_seed(config.seed)
    for step in range(config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.lr * 0.5 * (1 + math.cos(math.pi * step / config.steps))
        total = torch.zeros((), device=model.device)
        for clouds, indices, kept in prepared:
            features = []
            for cloud, before in zip(clouds, kept, strict=True):
                bent = warp_clouds(cloud.cpu()[None], generator, yaw=math.radians(15.0))
                found = adapted.compute_features(center_clouds(bent.to(model.device))[0])[0]
                total = total + config.keep * (1 - (found * before).sum(dim=1)).mean() / 2
                features.append(found)
            total = total + _compute_loss(features, indices, clouds[1], config)
        loss = total / len(prepared)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(learned, 1.0)
        optimizer.step()
        if on_progress is not None:
            on_progress(step + 1, loss.item())
    network.eval()
    return adapted


def _prepare(
    model: GarmentAffordanceModel, number: int, pair: AnnotatedPair
) -> tuple[list[Tensor], list[Tensor], list[Tensor]]:
    """Both clouds in the garment frame, annotated indices, and features before adapting."""
    clouds, indices, kept = [], [], []
    count = len(pair.source_points)
    if count == 0 or len(pair.target_points) != count:
        raise ValueError(
            f"pairs[{number}] must have as many points on both clouds, at least one; got {count} "
            f"and {len(pair.target_points)}"
        )
    for side in ("source", "target"):
        name = f"pairs[{number}].{side}_cloud"
        cloud = check_cloud(getattr(pair, f"{side}_cloud"), name, min_points=MIN_POINTS)
        if len(cloud) > NETWORK_POINTS:
            raise ValueError(f"{name} must have at most {NETWORK_POINTS} points; got {len(cloud)}")
        points = check_cloud(getattr(pair, f"{side}_points"), f"pairs[{number}].{side}_points")
        encoded = model.encode([cloud])[0]
        distance = np.linalg.norm(cloud[None] - points[:, None], axis=2)
        clouds.append(encoded.frame.clone())
        indices.append(torch.from_numpy(distance.argmin(axis=1)).to(model.device))
        kept.append(encoded.features.clone())
    return clouds, indices, kept


def _compute_loss(
    features: list[Tensor], indices: list[Tensor], target: Tensor, config: AdaptConfig
) -> Tensor:
    """InfoNCE of each annotated point against all points of the target that are elsewhere."""
    similarity = features[0][indices[0]] @ features[1].T / config.temperature  # (K, M)
    away = torch.cdist(target[indices[1]], target)
    is_near = away < config.margin
    is_near[torch.arange(len(is_near), device=is_near.device), indices[1]] = False
    return functional.cross_entropy(similarity.masked_fill(is_near, -torch.inf), indices[1])
