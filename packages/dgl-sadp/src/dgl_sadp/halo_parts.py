"""What HALO is made of: what it asks of a matcher, a policy and an environment, its stages, and its records."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

__all__ = [
    "EnvironmentDriver",
    "HaloStage",
    "Hold",
    "Matcher",
    "Observation",
    "StagePolicy",
    "StageRecord",
]

Observation = Mapping[str, np.ndarray]
"""Arrays by the keys of episode files."""

Hold = Literal["all", "some", "none"]
"""How many of the working hands are seen to hold, or may still hold, what they have to carry."""


class Matcher(Protocol):
    """Finds, on one garment, the points that correspond to given points of another."""

    def match(
        self, source_cloud: np.ndarray, source_points: np.ndarray, target_cloud: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the corresponding points.

        Args:
            source_cloud: Garment of the demonstration [m], shape (N, 3), world frame.
            source_points: Points on it [m], shape (K, 3), world frame.
            target_cloud: Observed garment [m], shape (M, 3), world frame.

        Returns:
            Indices into `target_cloud`, shape (K,), and similarities of each source point to every target point,
            shape (K, M).
        """
        ...


class StagePolicy(Protocol):
    """Gives chunks of joint targets. `PolicyRunner` is one."""

    def reset(self, observation: Observation, *, seed: int | None = None) -> None:
        """Begin a stage with what stays the same in it: the clouds and the affordance."""
        ...

    def observe(self, observation: Observation) -> None:
        """Take the observation that follows each executed target but the last of a chunk."""
        ...

    def act(self, observation: Observation) -> np.ndarray:
        """Take the observation that follows the last target and return the next ones [rad], shape (n, D)."""
        ...


class EnvironmentDriver(Protocol):
    """Moves the robot of one environment and says what is seen. Observations have the keys of episode files."""

    def begin_stage(self, stage: int) -> Observation:
        """Do what is scripted before a stage, such as opening the hands and placing props.

        Args:
            stage: Number of the stage, from 1.

        Returns:
            What is observed once a stage: `garment_point_cloud` [m], world frame, shape (N, 3), and, where there is an
            object, `object_point_cloud` [m], world frame, shape (M, 3).
        """
        ...

    def move_hands(self, left: np.ndarray | None, right: np.ndarray | None) -> None:
        """Bring the hands to grasp points with the environment's own controller, open and ready for the policy.

        Args:
            left: Point for the left hand [m], shape (3,), world frame; None leaves the hand where it is.
            right: The same for the right hand.

        Raises:
            StageError: If a hand cannot get there.
        """
        ...

    def observe(self) -> Observation:
        """Return what is observed at every frame now: `joint_state`, `env_point_cloud`, `image`."""
        ...

    def execute(self, target: np.ndarray) -> Observation:
        """Hold joint targets for the duration of one action, and return what is observed then.

        Args:
            target: Joint targets [rad], shape (D,).
        """
        ...

    def see_hold(self) -> Hold:
        """Say how many of the working hands hold what the stage has to carry, as far as the robot sees."""
        ...

    def end_stage(self, stage: int) -> None:
        """Do what is scripted after a stage, such as letting go and drawing back."""
        ...

    def is_done(self) -> bool:
        """Say whether the robot sees, after the last stage, that the task is done. Asked where a round may follow."""
        ...

    def is_nearly_done(self) -> bool:
        """Say whether the robot sees that the work of the stage that a round begins with is worth keeping.

        Asked where a hand has lost the garment in it, and before a further round.
        """
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class HaloStage:
    """One stage: what was demonstrated, and who carries it out."""

    policy: StagePolicy
    """The policy of this stage."""
    chunks: int
    """How many chunks it executes."""
    source_cloud: np.ndarray | None = None
    """Garment of the demonstration when the stage began [m], shape (N, 3), world frame."""
    left: np.ndarray | None = None
    """Where the left hand grasped it [m], shape (3,), world frame; None if it did not."""
    right: np.ndarray | None = None
    """The same of the right hand."""
    moved_at_most: float | None = None
    """How far the points may have moved since the first stage began [m]: they are looked for that near to where
    they were then; anywhere when None."""

    def __post_init__(self) -> None:
        if self.chunks < 1:
            raise ValueError(f"chunks must be at least 1; got {self.chunks}")
        for name, wanted in (("source_cloud", 2), ("left", 1), ("right", 1)):
            value = getattr(self, name)
            if value is not None and (value.ndim != wanted or value.shape[-1] != 3):
                shape = "(N, 3)" if wanted == 2 else "(3,)"
                raise ValueError(f"{name} must have shape {shape}; got {value.shape}")


@dataclass(frozen=True, kw_only=True, eq=False)
class StageRecord:
    """What happened in a stage."""

    stage: int
    """Its number, from 1."""
    round: int
    """The round that it belongs to, from 1."""
    left: np.ndarray | None
    """Where the left hand was sent [m], shape (3,), world frame; None if it stayed."""
    right: np.ndarray | None
    """The same of the right hand."""
    similarity: tuple[float, ...]
    """Similarity of each matched point (left, then right); low values are doubtful."""
    targets: int
    """How many joint targets were executed."""
    tries: int
    """How often the stage was begun in this round."""
