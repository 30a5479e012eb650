"""States of an environment as dictionaries of tensors and as one flat vector, as ManiSkill has them."""

import torch

__all__ = ["batch_state", "split_state"]


def batch_state(state: dict) -> dict:
    """Give a state with tensors of shape (1, D), where it may have arrays or vectors."""
    batched = {}
    for name, value in state.items():
        if isinstance(value, dict):
            batched[name] = batch_state(value)
        else:
            value = torch.as_tensor(value)
            batched[name] = value[None] if value.ndim == 1 else value
    return batched


def split_state(state: torch.Tensor, template: dict) -> dict:
    """Cut a flat state, shape (1, D), into the pieces of a dictionary of states."""
    pieces = {}
    for key, value in template.items():
        width = _count_values(value)
        piece, state = state[..., :width], state[..., width:]
        pieces[key] = split_state(piece, value) if isinstance(value, dict) else piece
    return pieces


def _count_values(state: dict | torch.Tensor) -> int:
    if isinstance(state, dict):
        return sum(map(_count_values, state.values()))
    return state.shape[-1]
