"""Who carries out what a stage records: the demonstration itself, or something that must never succeed."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.stage_work import StageWork
from dgl_tasks.handling import RELEASE_FRAMES
from dgl_tasks.messages import Part

LIFT_HEIGHT = 0.3
"""How high the garment is lifted before it is dropped [m]."""


class Actor(Protocol):
    """Carries out the recorded steps of stages, in its own way."""

    @property
    def is_sent(self) -> bool:
        """Whether points are matched and the hands sent there; otherwise it finds its way from the parked arms."""
        ...

    @property
    def follows_steps(self) -> bool:
        """Whether all of a stage's steps have to be within reach; otherwise the hands are sent as near as can be."""
        ...

    def act(self, work: StageWork) -> Part:
        """Act from the grasp points on.

        Raises:
            HoldLost: If hands are seen to hold nothing, and that ends the stage.
            UnreachableError: If a hand cannot go where it has to.
        """
        ...


class Expert:
    """Does what was demonstrated."""

    is_sent = True
    follows_steps = True

    def act(self, work: StageWork) -> Part:
        """Carry out the steps."""
        for step in work.stage.steps:
            if step.recorded:
                yield from work.perform(step)


@dataclass(frozen=True, kw_only=True)
class LiftAndDrop:
    """Lifts what it takes hold of straight up, and lets go.

    It handles the garment and does nothing of the task: what a success rule must not accept.
    """

    is_sent: bool = True
    follows_steps: bool = False

    def act(self, work: StageWork) -> Part:
        """Grasp, lift and let go."""
        hands, motion = work.hands, work.hands.motion
        up = np.array([0.0, 0.0, LIFT_HEIGHT])
        lifted: dict[Side, np.ndarray] = {side: point + up for side, point in work.grasp.items()}
        yield from hands.send(motion.set_hands(dict.fromkeys(lifted, work.stage.grasp_pose)))
        yield from hands.send(motion.move(lifted, work.orientations))
        yield from hands.send(motion.set_hands(dict.fromkeys(lifted, "open")))
        yield from hands.send(motion.hold(RELEASE_FRAMES))
        yield from hands.park()
