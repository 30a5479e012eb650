"""Checks that all families make of their measures."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

Ranges = Mapping[str, tuple[float, float]]


def check_ranges(measures: object, ranges: Ranges) -> None:
    """Check every number of a dataclass against its range.

    Raises:
        ValueError: If a measure is no finite number or outside of its range; the message names it.
    """
    for name, (low, high) in ranges.items():
        value = getattr(measures, name)
        if not (isinstance(value, int | float) and math.isfinite(value)):
            raise ValueError(f"{name} must be a finite number; got {value!r}")
        if not low <= value <= high:
            raise ValueError(f"{name} must be in [{low}, {high}]; got {value}")


def check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    """Check that a style is one of those that exist.

    Raises:
        ValueError: If it is not; the message lists them.
    """
    if value not in choices:
        raise ValueError(f"{name} must be one of {choices}; got {value!r}")


def flatten_measures(measures: Any, prefix: str = "") -> dict[str, float | str]:
    """Put nested dataclasses of measures into one dictionary, names joined by underscores; None is left out."""
    flat: dict[str, float | str] = {}
    for field in fields(measures):
        value = getattr(measures, field.name)
        if is_dataclass(value):
            flat |= flatten_measures(value, f"{prefix}{field.name}_")
        elif isinstance(value, str):
            flat[prefix + field.name] = value
        elif value is not None:
            flat[prefix + field.name] = float(value)
    return flat
