"""What acts in an episode yields, control step by control step, and is sent in return.

A course is a generator. It yields a `Command` for every control step, and marks between them, which take no time; it is
sent what is sensed then. So one loop can step one environment or many, whoever acts.
"""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from dgl_assets.robots import Side

if TYPE_CHECKING:
    from dgl_tasks.sensing import Sensed


@dataclass(frozen=True, slots=True)
class Command:
    """Joint targets of the next control step, and what the step belongs to."""

    target: np.ndarray
    """[rad], shape (D,)."""
    recorded: Literal["approach", "stage"] | None = None
    """Whether the step is part of what a stage's record shows."""
    is_passage: bool = False
    """Whether the arms just come and go."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StageBegins:
    """A stage has been looked at and is about to be carried out."""

    name: str
    garment_point_cloud: np.ndarray
    """What is seen of the garment [m], shape (2048, 3), float32, world frame."""
    points_affordance_feature: np.ndarray
    """Where the left and the right hand are to grasp, in [0, 1], shape (2048, 2), float32."""
    object_point_cloud: np.ndarray | None = None
    """What is seen of the objects [m], shape (2048, 3), float32; None in tasks without any."""
    points: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Named points where they are believed to be [m], shape (3,), world frame."""
    seen_at: int
    """Control steps from the reset to the look."""


@dataclass(frozen=True, kw_only=True)
class StageEnds:
    """A stage is over."""

    name: str
    counts: bool
    """Whether it has been carried out: otherwise it is about to be begun again, or given up."""


@dataclass(frozen=True, kw_only=True)
class Carrying:
    """Hands should hold the garment now; whoever knows the truth may take note if they do not."""

    stage: str
    hands: tuple[Side, ...]
    is_first: bool
    """Whether they have just lifted it."""
    where: str
    """The step of the stage, for people."""


@dataclass(frozen=True, kw_only=True)
class BeginsAgain:
    """What has been done is seen not to have worked, and is about to be done again."""

    what: Literal["try", "round"]
    """A stage, or several."""
    stages: tuple[str, ...]
    """Names of what is done again."""


@dataclass(frozen=True, kw_only=True)
class Believes:
    """What whoever acts makes of what it has seen; it is kept beside the truth."""

    values: Mapping[str, float]
    """Numbers by name."""


Mark = StageBegins | StageEnds | Carrying | BeginsAgain | Believes

Course = Generator["Command | Mark", "Sensed", None]
"""Yields commands and marks, and is sent what is sensed at the time."""
