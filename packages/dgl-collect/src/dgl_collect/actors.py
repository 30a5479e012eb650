"""Actors: they carry out the recorded steps of a stage."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.stage_work import StageWork
from dgl_tasks.handling import RELEASE_FRAMES
from dgl_tasks.messages import Part

LIFT_HEIGHT = 0.3
"""Height to which `LiftAndDrop` lifts the garment [m]."""


class Actor(Protocol):
    """Carries out the recorded steps of a stage."""

    @property
    def is_sent(self) -> bool:
        """True if the hands start at matched grasp points, false if at the parked arms."""
        ...

    @property
    def follows_steps(self) -> bool:
        """True if all steps must be within reach; else the hands grasp as near as they can."""
        ...

    def act(self, work: StageWork) -> Part:
        """Carry out the stage, from the grasp points on.

        Raises:
            HoldLost: If the hands have lost the garment, and that ends the stage.
            UnreachableError: If a target is out of reach.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class Expert:
    """Follows the demonstration."""

    is_sent: bool = True
    follows_steps: bool = True

    def act(self, work: StageWork) -> Part:
        """Carry out the recorded steps."""
        for step in work.stage.steps:
            if step.recorded:
                yield from work.perform(step)


@dataclass(frozen=True, kw_only=True)
class LiftAndDrop:
    """Lifts the garment straight up and drops it.

    A control: it handles the garment without doing the task, so no success rule must accept it.
    """

    is_sent: bool = True
    follows_steps: bool = False

    def act(self, work: StageWork) -> Part:
        """Grasp, lift and release."""
        hands, motion = work.hands, work.hands.motion
        up = np.array([0.0, 0.0, LIFT_HEIGHT])
        lifted: dict[Side, np.ndarray] = {side: point + up for side, point in work.grasp.items()}
        yield from hands.send(motion.set_hands(dict.fromkeys(lifted, work.stage.grasp_pose)))
        yield from hands.send(motion.move(lifted, work.orientations))
        yield from hands.send(motion.set_hands(dict.fromkeys(lifted, "open")))
        yield from hands.send(motion.hold(RELEASE_FRAMES))
        yield from hands.park()
