"""Which hands a policy has told to let go."""

from collections.abc import Iterable

import numpy as np

from dgl_assets.robots import SIDES, Side, joint_slice

__all__ = ["FingerCommands"]

CLOSED = 1.0
"""How far the targets of a hand's joints have to have gone for it to be closed, as a Euclidean distance [rad]; 3.3 in demonstrations."""


class FingerCommands:
    """Follows the targets of the fingers through a stage, from open over closed to open again."""

    def __init__(self, open_state: np.ndarray) -> None:
        """Begin a stage with open hands: the joint state [rad], shape (60,)."""
        self._open = np.asarray(open_state, dtype=float)
        self._now: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._most: dict[Side, float] = dict.fromkeys(SIDES, 0.0)

    def add(self, target: np.ndarray) -> None:
        """Note joint targets that are executed [rad], shape (60,)."""
        for side in SIDES:
            part = joint_slice(side, "hand")
            self._now[side] = float(np.linalg.norm(np.asarray(target)[part] - self._open[part]))
            self._most[side] = max(self._most[side], self._now[side])

    def find_opened(self, sides: Iterable[Side]) -> set[Side]:
        """Say which hands have been told to close, and are on their way back by more than a half."""
        return {
            side
            for side in sides
            if self._most[side] > CLOSED and self._now[side] < 0.5 * self._most[side]
        }
