"""Checks of settings, seeds, options and actions that callers pass to an environment."""

import logging
import operator
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import torch

from dgl_files.fields import check_value, show
from dgl_tasks.cameras import WRIST_CAMERAS
from dgl_tasks.declaration import Task

logger = logging.getLogger(__name__)

ControlMode = Literal["pd_joint_pos", "pd_hand_poses", "pd_ee_pose"]
"""Joint targets, joint targets of the arms with weights of hand poses, and end-effector poses."""
JointControlMode = Literal["pd_joint_pos", "pd_hand_poses"]
"""Control modes whose actions are joint targets, or stand for them."""
SETTINGS: Mapping[str, Any] = {
    "sim_backend": Literal["auto", "cpu", "physx_cpu"],
    "reward_mode": Literal["normalized_dense", "dense", "sparse", "none"] | None,
    "control_mode": ControlMode | None,
    "render_mode": Literal["human", "rgb_array", "sensors", "all"] | None,
}
"""ManiSkill's settings with fewer choices here, or without a clear error there."""
RESET_OPTIONS: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "garment": (lambda value: True, ""),  # checked when it is loaded
    "reconfigure": (lambda value: isinstance(value, bool | np.bool_), "a bool"),
    "env_idx": (lambda value: np.array_equal(value, [0]), "[0], the only environment"),
    "reset_to_env_states": (
        lambda value: isinstance(value, dict) and "env_states" in value,
        'a dict with "env_states"',
    ),
}
"""Options of `reset`, with the check and the description of each; all but the first ManiSkill's."""
TOLD_BEYOND = 1e-3
"""Clipping by more than this is logged [rad]."""
LARGEST_SEED = 2**32 - 1
"""NumPy's bound of seeds."""


def check_settings(settings: Mapping[str, Any]) -> None:
    """Check those of ManiSkill's settings that are in `SETTINGS`.

    Raises:
        ValueError: If one is not among its choices.
    """
    for name in SETTINGS.keys() & settings.keys():
        check_value(name, settings[name], SETTINGS[name])


def check_cameras(cameras: Sequence[str], task: Task) -> None:
    """Check the names of cameras.

    Raises:
        ValueError: If the task has no such camera, and it is no wrist camera.
    """
    known = [*task.cameras, *WRIST_CAMERAS]
    unknown = [name for name in cameras if name not in known]
    if isinstance(cameras, str) or unknown:
        raise ValueError(f"cameras must be among {known}; got {show(unknown or cameras)}")


def read_seed(seed: Any) -> int | None:
    """Read the seed of an episode.

    Args:
        seed: None, an integer in [0, 2^32), or a sequence of one such integer, as ManiSkill allows.

    Raises:
        ValueError: If it is anything else.
    """
    if seed is None:
        return None
    try:
        (number,) = map(operator.index, np.ravel(seed))
    except (TypeError, ValueError):
        number = -1
    if not 0 <= number <= LARGEST_SEED:
        raise ValueError(
            f"seed must be None, an integer in [0, {LARGEST_SEED}], or a list of one; "
            f"got {show(seed)}"
        )
    return number


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
    for name, value in options.items():
        is_right, expected = RESET_OPTIONS[name]
        if not is_right(value):
            raise ValueError(f'option "{name}" must be {expected}; got {show(value)}')


def read_action(action: Any, shape: tuple[int, ...]) -> torch.Tensor:
    """Read an action of one environment.

    Args:
        action: Finite numbers, shape `shape` or (1, *shape).
        shape: Of the action space.

    Returns:
        The same numbers, shape (1, *shape), in the type in which they came.

    Raises:
        ValueError: If they are of another shape, no numbers, or not finite as float32.
    """
    try:
        read = torch.as_tensor(action)
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
