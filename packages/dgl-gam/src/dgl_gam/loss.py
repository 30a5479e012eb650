"""InfoNCE loss: a point's feature must be most similar to its counterpart's."""

import torch
from torch import Tensor
from torch.nn import functional

from dgl_gam._sampling import gather_points
from dgl_gam.data.batches import Batch

__all__ = ["compute_info_nce"]


def compute_info_nce(
    features: Tensor, batch: Batch, *, temperature: float
) -> tuple[Tensor, Tensor]:
    """Compute the loss of the batch's pairs.

    Args:
        features: Unit vectors of the batch's clouds, shape (C, N, D).
        batch: Which points correspond, and which do not.
        temperature: Divides the similarities.

    Returns:
        The mean over the pairs of points that count of -log(exp(s+ / t) / (exp(s+ / t) + sum exp(s-
        / t))), and the share of them whose counterpart is more similar than all negatives.

    Source:
        van den Oord et al. 2018, Representation Learning with Contrastive Predictive Coding, eq. 4.
    """
    first, second = features[batch.clouds[:, 0]], features[batch.clouds[:, 1]]  # (P, N, D)
    source = gather_points(first, batch.source)  # (P, S, D)
    positive = (source * gather_points(second, batch.positive)).sum(dim=2, keepdim=True)
    # All similarities by one product, then those of the negatives: cheaper than gathering features.
    every = torch.bmm(source, second.mT)  # (P, S, N)
    negative = every.gather(2, batch.negative).masked_fill(~batch.is_negative, -torch.inf)
    logits = torch.cat([positive, negative], dim=2) / temperature
    losses = functional.cross_entropy(
        logits.flatten(0, 1),
        torch.zeros(logits.shape[0] * logits.shape[1], dtype=torch.int64, device=logits.device),
        reduction="none",
    )
    used = batch.is_used.flatten()
    count = used.sum().clamp(min=1)
    is_right = (positive > negative.amax(dim=2, keepdim=True)).flatten()
    return (losses * used).sum() / count, (is_right & used).sum() / count
