"""Checks of seeds, options and actions that callers pass to an environment."""

import logging
import operator
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import torch

from dgl_files.fields import show

logger = logging.getLogger(__name__)

RESET_OPTIONS = ("garment", "reconfigure", "env_idx", "reset_to_env_states")
"""Options of `reset`; all but the first are ManiSkill's."""
TOLD_BEYOND = 1e-3
"""Clipping by more than this is logged [rad]."""
LARGEST_SEED = 2**32 - 1
"""NumPy's bound of seeds."""


def check_choice(name: str, value: object, choices: Sequence[str]) -> None:
    """Check that a setting is one of the choices.

    Raises:
        ValueError: Otherwise.
    """
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {list(choices)}; got {show(value)}")


def read_seed(seed: Any) -> int | list[int] | None:
    """Read the seed of an episode.

    Args:
        seed: None, an integer in [0, 2^32), or a sequence of one such integer, as ManiSkill allows.

    Raises:
        ValueError: If it is anything else.
    """
    if seed is None:
        return None
    try:
        if isinstance(seed, str):
            raise TypeError
        is_list = isinstance(seed, Iterable) and np.ndim(seed) > 0  # pyright: ignore[reportArgumentType]
        given: Any = seed if is_list else [seed]
        numbers = [operator.index(number) for number in given]
    except (TypeError, ValueError):
        numbers = []
        is_list = False
    if len(numbers) != 1 or not 0 <= numbers[0] <= LARGEST_SEED:
        raise ValueError(
            f"seed must be None, an integer in [0, {LARGEST_SEED}], or a list of one; "
            f"got {show(seed)}"
        )
    return numbers if is_list else numbers[0]


def check_reset_options(options: Any) -> None:
    """Check the options of `reset`, except for the garment.

    Raises:
        ValueError: If they are no dictionary, or one is unknown or of another form.
    """
    if options is None:
        return
    if not isinstance(options, dict):
        raise ValueError(f"options must be a dict; got {show(options)}")
    unknown = [name for name in options if name not in RESET_OPTIONS]
    if unknown:
        raise ValueError(f"options must be among {list(RESET_OPTIONS)}; got {unknown}")
    if not isinstance(options.get("reconfigure", False), (bool, np.bool_)):
        raise ValueError(f'option "reconfigure" must be a bool; got {show(options["reconfigure"])}')
    if "env_idx" in options and not _is_first_alone(options["env_idx"]):
        raise ValueError(
            f'option "env_idx" must be [0], the only environment; got {show(options["env_idx"])}'
        )
    states = options.get("reset_to_env_states", {"env_states": None})
    if not isinstance(states, dict) or "env_states" not in states:
        raise ValueError(
            f'option "reset_to_env_states" must be a dict with "env_states"; got {show(states)}'
        )


def read_action(
    action: Any, shape: tuple[int, ...], *, device: torch.device | None = None
) -> torch.Tensor:
    """Read an action of one environment.

    Args:
        action: Finite numbers, shape `shape` or (1, *shape).
        shape: Of the action space.
        device: Where it goes; the CPU when None.

    Returns:
        The same numbers, shape (1, *shape), in the type in which they came.

    Raises:
        ValueError: If they are of another shape, no numbers, or not finite as float32.
    """
    try:
        read = torch.as_tensor(action, device=device)
    except (TypeError, ValueError, RuntimeError, OverflowError) as err:
        raise ValueError(f"action must be {shape[0]} numbers; got {show(action)}") from err
    if read.dtype == torch.bool or read.is_complex():
        raise ValueError(f"action must be real numbers; got {read.dtype}")
    if read.shape not in (shape, (1, *shape)):
        raise ValueError(f"action must have shape {shape} or (1, *); got {tuple(read.shape)}")
    read = read.reshape(1, *shape)
    wrong = (~torch.isfinite(read.to(torch.float32))[0]).nonzero()
    if len(wrong):
        first = int(wrong[0])
        raise ValueError(f"action must be finite; got {read[0, first].item()} at index {first}")
    return read


class ActionBounds:
    """Bounds of an action space, which actions are clipped to; the first clipped one is logged."""

    def __init__(self, low: np.ndarray, high: np.ndarray) -> None:
        """Take the bounds [rad], shape (D,)."""
        self._low, self._high, self._has_told = low, high, False

    def clip(self, action: np.ndarray) -> np.ndarray:
        """Clip actions [rad], shape (..., D); those within the bounds keep every bit."""
        kind = action.dtype if np.issubdtype(action.dtype, np.floating) else np.float32
        clipped = np.clip(action, self._low.astype(kind), self._high.astype(kind))
        beyond = np.abs(clipped - action).reshape(-1, len(self._low))
        if not self._has_told and beyond.max(initial=0.0) > TOLD_BEYOND:
            self._has_told = True
            row, k = np.unravel_index(beyond.argmax(), beyond.shape)
            logger.warning(
                "actions are clipped to the action space: number %d was %g, outside of [%g, %g]",
                k, action.reshape(beyond.shape)[row, k], self._low[k], self._high[k],
            )  # fmt: skip
        return clipped


def _is_first_alone(index: Any) -> bool:
    try:
        return np.ndim(index) == 1 and [operator.index(i) for i in index] == [0]
    except (TypeError, ValueError):
        return False
