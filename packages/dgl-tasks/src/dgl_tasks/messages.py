"""Messages between what acts in an episode and the loop that steps the environment.

What acts is a generator, a `Part` of an episode. It yields a `Command` for every control step, a
request for pictures, and marks, which take no time; it is sent what is sensed then. So one loop can
step one environment or many, whatever acts.
"""

from collections.abc import Generator, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dgl_assets.robots import Side
from dgl_tasks.sensing import Sensed


@dataclass(frozen=True, slots=True)
class Command:
    """Joint targets of the next control step."""

    target: np.ndarray
    """[rad], shape (D,)."""
    recorded: Literal["approach", "stage"] | None = None
    """Part of a stage's record that the step belongs to."""
    is_passage: bool = False
    """The arms just come and go."""


@dataclass(frozen=True, slots=True)
class TakePictures:
    """Asks for pictures of the scene as it is; takes no time."""

    cameras: tuple[str, ...]
    """Names of the task's cameras."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StageBegins:
    """A stage has been looked at and is about to be carried out."""

    name: str
    garment_point_cloud: np.ndarray
    """Visible points of the garment [m], shape (2048, 3), float32, world frame."""
    points_affordance_feature: np.ndarray
    """Affordance of the left and the right hand, in [0, 1], shape (2048, 2), float32."""
    object_point_cloud: np.ndarray | None = None
    """Visible points of the objects [m], shape (2048, 3), float32; None in tasks without any."""
    points: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Believed positions of named points [m], shape (3,), world frame."""
    seen_at: int
    """Control steps from the reset to the look."""


@dataclass(frozen=True, kw_only=True)
class StageEnds:
    """A stage is over."""

    name: str
    counts: bool
    """False where the stage is about to be begun again, or given up."""


@dataclass(frozen=True, kw_only=True)
class Carrying:
    """Hands should hold the garment now; the driver compares that with the truth."""

    stage: str
    hands: tuple[Side, ...]
    is_first: bool
    """They have just lifted it."""
    where: str
    """The step of the stage, for people."""


@dataclass(frozen=True, kw_only=True)
class BeginsAgain:
    """A stage or a round is seen to have failed and is about to be done again."""

    what: Literal["try", "round"]
    """A stage, or several."""
    stages: tuple[str, ...]
    """Names of the stages that are done again."""


@dataclass(frozen=True, kw_only=True)
class Believes:
    """The method's estimates, kept beside the truth."""

    values: Mapping[str, float]
    """Numbers by name."""


Mark = StageBegins | StageEnds | Carrying | BeginsAgain | Believes
Message = Command | TakePictures | Mark

Part = Generator[Message, Sensed, None]
"""A part of an episode."""
