"""States of an environment as ManiSkill's dictionaries of tensors and flat vectors."""

import torch

from dgl_files.fields import show
from dgl_physics.sapien_bridge import SapienCloth

__all__ = ["read_cloth", "read_state", "split_state", "write_cloth"]


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
        state["positions"].numpy().reshape(shape),
        state["velocities"].numpy().reshape(shape),
        state["is_stuck"].numpy().reshape(shape[:2]) > 0.5,
    )
    cloth.state.set_memory(state["memory"].numpy().reshape(-1))
    cloth.set_forces(state["forces"].numpy().reshape(1, -1, 6))
    cloth.sync_bodies(is_jump=True)


def read_state(state: dict, template: dict, where: str = "") -> dict:
    """Read the parts that a present state has, as tensors of shape (1, D).

    Args:
        state: Dictionary of dictionaries, arrays and tensors, of shape (1, D) or (D,).
        template: The present state.
        where: Path of both in the whole state.

    Raises:
        ValueError: Naming the first part that is missing or not finite.
    """
    read = {}
    for name, present in template.items():
        path = f"{where}{name}"
        if name not in state:
            raise ValueError(f"the state must have {path!r}; it has {sorted(map(str, state))}")
        value = state[name]
        if isinstance(present, dict):
            if not isinstance(value, dict):
                raise ValueError(f"state {path!r} must be a dict; got {show(value)}")
            read[name] = read_state(value, present, f"{path}.")
        else:
            if isinstance(value, dict) or not torch.isfinite(torch.as_tensor(value)).all():
                raise ValueError(f"state {path!r} must be finite numbers")
            read[name] = torch.atleast_2d(torch.as_tensor(value))
    return read


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
