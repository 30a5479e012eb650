"""Skills learnt from recordings, as a demonstration follows them."""

from collections.abc import Mapping
from dataclasses import replace
from importlib.metadata import entry_points
from typing import Protocol

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.errors import DemonstrationError
from dgl_collect.options import RunOptions
from dgl_collect.steps import Demonstration, Follow, Stage
from dgl_tasks.declaration import Task

__all__ = ["GROUP", "HandWay", "Skill", "Way", "change_way", "follow_recordings", "load_skill"]

GROUP = "dgl_collect.skills"
"""Entry points whose first one learns a demonstration's recordings; see `load_skill`."""


class HandWay(Protocol):
    """Way of one hand."""

    @property
    def points(self) -> np.ndarray:
        """Grasp point [m], shape (N, 3), world frame."""
        ...

    @property
    def turns(self) -> np.ndarray:
        """Rotation vector from the first orientation, in the hand's frame [rad], shape (N, 3)."""
        ...

    @property
    def poses(self) -> np.ndarray:
        """Coordinates of the hand, shape (N, P); see `dgl_tasks.hand_span`."""
        ...


class Way(Protocol):
    """Ways of the working hands."""

    @property
    def hands(self) -> Mapping[str, HandWay]:
        """The ways by hand."""
        ...

    @property
    def spread(self) -> float:
        """Standard deviation of their ends, as far as the recordings tell [m]."""
        ...


class Skill(Protocol):
    """Gives the ways of the hands in each stage."""

    def plan(
        self,
        stage: str,
        starts: Mapping[Side, np.ndarray],
        anchors: Mapping[str, np.ndarray],
    ) -> Way:
        """Plan a stage, one sample a control step.

        Args:
            stage: Its name.
            starts: Grasp point of each working hand [m], shape (3,), world frame.
            anchors: Positions by name [m], shape (3,); see `dgl_collect.names.list_anchors`.

        Raises:
            DemonstrationError: If the skill has no such stage, other hands, or lacks an anchor.
        """
        ...


def follow_recordings(demonstration: Demonstration) -> Demonstration:
    """Replace the recorded steps of each stage by one that follows recordings."""
    return replace(demonstration, stages=tuple(map(_follow_stage, demonstration.stages)))


def _follow_stage(stage: Stage) -> Stage:
    if not stage.is_learned:
        return stage
    first = next(k for k, step in enumerate(stage.steps) if step.recorded)
    scripted = [step for step in stage.steps if not step.recorded]
    return replace(stage, steps=(*scripted[:first], Follow(), *scripted[first:]))


def load_skill(task: Task, demonstration: Demonstration, options: RunOptions) -> Skill:
    """Load the skill of a demonstration's recordings, or the task's own one where it has none.

    The entry point of the group `dgl_collect.skills` does it, a function with the same arguments.
    This package has none, the package `dexgarmentlab` has one.

    Raises:
        DemonstrationError: If nothing installed can do it, there is no skill, or it does not fit.
    """
    found = list(entry_points(group=GROUP))
    if not found:
        raise DemonstrationError("to follow recordings needs the package dexgarmentlab")
    return found[0].load()(task, demonstration, options)


def change_way(
    way: HandWay, start: np.ndarray, side: Side, step: Follow
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Change the way of a hand by the numbers of a step.

    Args:
        way: The way, one sample a control step.
        start: Grasp point at its start [m], shape (3,), world frame.
        side: The hand.
        step: Its speed, lift and shift.

    Returns:
        Points (M, 3), turns (M, 3) and poses (M, P), as in `HandWay`.
    """
    count = len(way.points)
    share = (np.arange(1, count + 1) / count)[:, None]
    outward = np.array([-1.0 if side == "left" else 1.0, 1.0, 1.0])
    points = start + (way.points - start) * [1.0, 1.0, step.lift]
    points += share * outward * step.shift
    wanted = max(1, round(count / step.speed))
    at = np.linspace(0, count - 1, wanted) if wanted != count else np.arange(count)
    return tuple(
        np.stack([np.interp(at, np.arange(count), column) for column in array.T], axis=1)
        for array in (points, way.turns, way.poses)
    )  # pyright: ignore[reportReturnType] - three arrays
