"""Content of figures, as data: experiments make it, `drawing` draws it."""

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Literal

import numpy as np

__all__ = ["Bars", "Chart", "ClothView", "Figure", "Limit", "Plot", "Series", "ShownSolid"]

CurveKind = Literal["theory", "measured", "line", "faint"]


@dataclass(frozen=True)
class Series:
    """One curve of a chart."""

    x: Sequence[float] | np.ndarray
    y: Sequence[float] | np.ndarray
    label: str = ""
    _: KW_ONLY
    kind: CurveKind = "line"
    """"theory" is dashed and quiet, "measured" are points, "line" is a measurement over time and
    "faint" one of many of which none matters by itself."""
    tone: int = 0
    """Colour, counted from 0; what has the same colour belongs together."""


@dataclass(frozen=True)
class Limit:
    """A bar: the number that a value is compared with."""

    value: float
    label: str = "bar"
    _: KW_ONLY
    is_vertical: bool = False
    is_quiet: bool = False
    """It only says where something is, and asks nothing."""


@dataclass(frozen=True)
class Chart:
    """Curves over a common axis."""

    title: str
    x_label: str
    y_label: str
    curves: Sequence[Series]
    _: KW_ONLY
    limits: Sequence[Limit] = ()
    is_log_x: bool = False
    is_log_y: bool = False
    y_range: tuple[float, float] | None = None
    x_range: tuple[float, float] | None = None


@dataclass(frozen=True)
class Bars:
    """Named values side by side."""

    title: str
    labels: Sequence[str]
    values: Sequence[float]
    value_label: str
    _: KW_ONLY
    limits: Sequence[Limit] = ()
    is_log: bool = False
    expected: Sequence[float] = ()
    """Theoretical value of each bar, marked across it; none when empty."""


@dataclass(frozen=True)
class ShownSolid:
    """A rigid body in a picture."""

    vertices: np.ndarray
    """[m], shape (V, 3), world frame."""
    faces: np.ndarray
    """Shape (F, 3), seen from outside counter-clockwise."""


@dataclass(frozen=True)
class ClothView:
    """Cloth as it lies or hangs, seen from far away."""

    title: str
    vertices: np.ndarray
    """[m], shape (V, 3), world frame."""
    faces: np.ndarray
    """Shape (F, 3)."""
    _: KW_ONLY
    azimuth: float = -60.0
    """Direction from which it is seen [deg], from +x towards +y."""
    elevation: float = 30.0
    """Height from which it is seen [deg]; 90 is from above."""
    values: np.ndarray | None = None
    """A number for each face, shape (F,), shown as colour; the cloth's own colour when None."""
    value_label: str = ""
    value_limit: float | None = None
    """Largest value of the colour scale; the values' 99.9th percentile when None."""
    solids: Sequence[ShownSolid] = ()
    marks: np.ndarray | None = None
    """Places [m], shape (N, 3), marked by rings."""


Plot = Chart | Bars | ClothView


@dataclass(frozen=True)
class Figure:
    """Panels side by side, saved as one file."""

    name: str
    """Name of the file without its ending."""
    caption: str
    panels: Sequence[Plot] = ()
