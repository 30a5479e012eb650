"""States of an environment as ManiSkill's dictionaries of tensors and flat vectors."""

import torch

from dgl_files.fields import show
from dgl_physics.sapien_bridge import SapienCloth

__all__ = ["batch_state", "check_state", "read_cloth", "split_state", "write_cloth"]


def read_cloth(cloth: SapienCloth) -> dict[str, torch.Tensor]:
    """Give the state of a garment: particles, contacts and forces, each of shape (1, D)."""
    return {
        "positions": torch.from_numpy(cloth.state.get_positions()).flatten(1),
        "velocities": torch.from_numpy(cloth.state.get_velocities()).flatten(1),
        "is_stuck": torch.from_numpy(cloth.state.get_is_stuck()).float(),
        "memory": torch.from_numpy(cloth.state.get_memory())[None],
        "forces": torch.from_numpy(cloth.get_forces().copy()).flatten(1),
    }


def write_cloth(cloth: SapienCloth, state: dict[str, torch.Tensor]) -> None:
    """Restore the state of a garment, as of `read_cloth`, after that of the rigid bodies.

    Raises:
        ValueError: If it is of another garment.
    """
    shape = cloth.state.get_positions().shape
    if state["positions"].shape[1] != shape[1] * 3:
        raise ValueError(
            f"the state must be of this garment, with {shape[1]} particles; "
            f"got {state['positions'].shape[1] // 3}"
        )
    cloth.state.set_particles(
        state["positions"].cpu().numpy().reshape(shape),
        state["velocities"].cpu().numpy().reshape(shape),
        state["is_stuck"].cpu().numpy().reshape(shape[:2]) > 0.5,
    )
    cloth.state.set_memory(state["memory"].cpu().numpy().reshape(-1))
    cloth.set_forces(state["forces"].cpu().numpy().reshape(1, -1, 6))
    cloth.sync_bodies(is_jump=True)


def batch_state(state: dict) -> dict:
    """Make tensors of shape (1, D) of a state's arrays or vectors."""
    batched = {}
    for name, value in state.items():
        if isinstance(value, dict):
            batched[name] = batch_state(value)
        else:
            value = torch.as_tensor(value)
            batched[name] = value[None] if value.ndim == 1 else value
    return batched


def check_state(state: dict, template: dict, where: str = "") -> None:
    """Check that a batched state has all parts of a present one, with finite numbers.

    Raises:
        ValueError: Naming the first part that is missing or not finite.
    """
    for name, present in template.items():
        path = f"{where}{name}"
        if name not in state:
            raise ValueError(f"the state must have {path!r}; it has {sorted(map(str, state))}")
        if isinstance(present, dict):
            if not isinstance(state[name], dict):
                raise ValueError(f"state {path!r} must be a dict; got {show(state[name])}")
            check_state(state[name], present, f"{path}.")
        elif isinstance(state[name], dict) or not torch.isfinite(state[name]).all():
            raise ValueError(f"state {path!r} must be finite numbers")


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
