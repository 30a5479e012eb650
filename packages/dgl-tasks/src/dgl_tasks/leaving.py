"""The ways in which an opened hand leaves the cloth."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

LeaveName = Literal["slide", "shed"]
"""How an opened hand leaves the cloth."""


@dataclass(frozen=True, kw_only=True)
class Leave:
    """The way of an opened hand out of the cloth. Its palm looks down, so its thumb is under the cloth."""

    roll: float
    """How far the hand rolls for its thumb to point down [rad]."""
    rise: float
    """How far it rises while it rolls [m]."""
    frames: int
    """Frames for the cloth to slide off the thumb then."""
    draw_backs: tuple[float, ...]
    """How far it draws back along its fingers, level [m]: the first of these that the arm can reach."""


LEAVES: Mapping[LeaveName, Leave] = {
    # low and level: what was laid down flat stays where it lies
    "slide": Leave(roll=np.radians(30), rise=0.0, frames=0, draw_backs=(0.12, 0.08, 0.04, 0.0)),
    # where cloth runs back under the hand it would be taken along: it is let fall off the thumb instead
    "shed": Leave(roll=np.radians(60), rise=0.04, frames=15, draw_backs=(0.04, 0.02, 0.0)),
}
