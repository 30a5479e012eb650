"""Watch over hands that carry out targets which tell nothing of their purpose."""

import numpy as np

from dgl_assets.robots import SIDES, Side
from dgl_tasks.handling import Handling
from dgl_tasks.holding import is_low

CLOSED = 1.0
"""Change of the joint targets of a hand that counts as closing, a Euclidean distance [rad]. It is
3.3 in demonstrations."""


class HoldWatch:
    """Watches for hands that have lost the garment.

    Only hands that have been down at the garment and are up again are checked. The far side of a
    hand may hide cloth from the camera, so two checks in a row must agree. A hand that its policy
    has opened is not checked any more.
    """

    def __init__(self, hands: Handling, working: tuple[Side, ...]) -> None:
        """Begin to watch.

        Args:
            hands: Both hands; the garment has been seen from above.
            working: The hands that are to hold the garment.
        """
        self._hands, self._working = hands, working
        self._were_down: set[Side] = set()
        self._empty: set[Side] = set()
        self._start = hands.sensed.joint_state.astype(float)
        self._now: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._most: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
        self._note_heights()

    def note(self, target: np.ndarray) -> None:
        """Note executed joint targets [rad], shape (D,)."""
        robot = self._hands.motion.robot
        for side in SIDES:
            part = robot.joint_slice(side, "hand")
            self._now[side] = float(np.linalg.norm(np.asarray(target)[part] - self._start[part]))
            self._most[side] = max(self._most[side], self._now[side])
        self._note_heights()

    def confirm(self, empty: set[Side]) -> set[Side]:
        """Confirm those of the hands seen empty that were so in the check before, too."""
        before = self._empty
        self._empty = (empty & self._were_down) - self._find_opened()
        return before & self._empty

    def _note_heights(self) -> None:
        sensed = self._hands.sensed
        self._were_down.update(side for side in self._working if is_low(sensed, side))

    def _find_opened(self) -> set[Side]:
        """Find the hands that have closed and are more than half open again."""
        return {
            side
            for side in SIDES
            if self._most[side] > CLOSED and self._now[side] < 0.5 * self._most[side]
        }
