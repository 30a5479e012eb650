"""Optimizers of a training."""

import torch
from torch import nn

from dgl_sadp.train_config import TrainConfig

__all__ = ["make_optimizers"]


def make_optimizers(model: nn.Module, config: TrainConfig) -> list[torch.optim.Optimizer]:
    """Make AdamW for all parameters, or Muon for matrices and AdamW for the rest.

    AdamW also has the matrices of FiLM: wide as they are, they would take half of Muon's time.
    """
    matrices, others = [], []
    for name, parameter in model.named_parameters():
        is_muons = config.muon_learning_rate is not None and parameter.ndim == 2
        (matrices if is_muons and ".film" not in name else others).append(parameter)
    optimizers: list[torch.optim.Optimizer] = [
        torch.optim.AdamW(
            others,
            lr=config.learning_rate,
            betas=config.betas,
            eps=1e-8,
            weight_decay=config.weight_decay,
            fused=True,
        )
    ]
    if config.muon_learning_rate is not None:
        optimizers.append(
            torch.optim.Muon(
                matrices,
                lr=config.muon_learning_rate,
                weight_decay=config.weight_decay,
                adjust_lr_fn="original",
            )
        )
    return optimizers
