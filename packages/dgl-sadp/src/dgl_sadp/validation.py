"""Validation on episodes outside of the training set."""

from dataclasses import dataclass

import numpy as np
import torch

from dgl_sadp._random import VALIDATION, draw_seed
from dgl_sadp.dataset import EpisodeDataset
from dgl_sadp.policy import DiffusionPolicy

__all__ = ["Validation", "compute_validation"]


@dataclass(frozen=True, kw_only=True)
class Validation:
    """Errors of the averaged policy on validation episodes."""

    epoch: int
    """Epochs done."""
    loss: float
    """Diffusion loss."""
    error: float
    """Mean distance of generated to commanded targets [rad], over joints and executed steps."""
    largest_error: float
    """The same of the worst joint; most joints rest, which hides it in the mean."""


@torch.no_grad()
def compute_validation(
    policy: DiffusionPolicy, dataset: EpisodeDataset, *, epoch: int, windows: int, seed: int
) -> Validation:
    """Measure a policy on windows of a dataset, evenly spread.

    Args:
        policy: In evaluation mode.
        dataset: Episodes that were not trained on.
        epoch: To be noted.
        windows: Most windows; generation is measured on a quarter of them.
        seed: Of noise and points; the same in all validations of a run, so that they can be
            compared.
    """
    if policy.training:
        raise ValueError("the policy must be in evaluation mode")
    chosen = np.unique(np.linspace(0, len(dataset) - 1, min(windows, len(dataset))).astype(int))
    losses, errors = [], []
    size = 64
    for number, start in enumerate(range(0, len(chosen), size)):
        part = chosen[start : start + size]
        generator = torch.Generator().manual_seed(draw_seed(seed, VALIDATION, number))
        collated = torch.utils.data.default_collate([dataset[int(i)] for i in part])
        batch = {key: tensor.to(policy.device) for key, tensor in collated.items()}
        losses.append((policy(batch, generator).item(), len(part)))
        batch = {key: values[::4] for key, values in batch.items()}
        actions = policy.predict(batch, policy.encode_stage(batch, generator), generator)
        executed = policy.config.executed
        errors.append((actions - batch["action"])[:, executed].abs().flatten(0, 1).cpu())
    by_joint = torch.cat(errors).mean(dim=0)
    return Validation(
        epoch=epoch,
        loss=sum(loss * count for loss, count in losses) / len(chosen),
        error=by_joint.mean().item(),
        largest_error=by_joint.max().item(),
    )
