"""Fields of dataclasses with accepted ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, field, fields
from functools import cache
from typing import Any


def measure(low: float, high: float, default: Any = MISSING) -> Any:
    """Declare a numeric field of `Measures`, which is held in [low, high]."""
    return field(default=default, metadata={"range": (low, high)})


@cache
def get_ranges(kind: type) -> Mapping[str, tuple[float, float]]:
    """Smallest and largest accepted value of each field that `measure` declares, by name."""
    return {f.name: f.metadata["range"] for f in fields(kind) if "range" in f.metadata}


class Measures:
    """Base of dataclasses whose fields `measure` declares; their ranges are checked.

    Raises:
        ValueError: If a value is no finite number or out of its range; the message names the field.
    """

    def __post_init__(self) -> None:
        for name, (low, high) in get_ranges(type(self)).items():
            check_range(name, getattr(self, name), low, high)


def check_range(name: str, value: object, low: float, high: float) -> None:
    """Check one number.

    Raises:
        ValueError: If it is not finite or not in [low, high].
    """
    if isinstance(value, bool) or not (isinstance(value, int | float) and math.isfinite(value)):
        raise ValueError(f"{name} must be a finite number; got {value!r}")
    if not low <= value <= high:
        raise ValueError(f"{name} must be in [{low}, {high}]; got {value}")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that a value is one of some names.

    Raises:
        ValueError: If it is not; the message lists them.
    """
    if value not in choices:
        raise ValueError(f"{name} must be one of {choices}; got {value!r}")


def check_limit(
    name: str, value: float, formula: str, *, least: float = -math.inf, most: float = math.inf
) -> None:
    """Check a number against a limit that other fields give.

    Args:
        name: Name of the field.
        value: Its value.
        formula: The limit in words or as a formula, for the message.
        least: Smallest accepted value.
        most: Largest accepted value.

    Raises:
        ValueError: If it is beyond the limit.
    """
    if value < least:
        raise ValueError(f"{name} must be at least {formula} ({least:.4g}); got {value:.4g}")
    if value > most:
        raise ValueError(f"{name} must be at most {formula} ({most:.4g}); got {value:.4g}")
