"""Check that measures are numbers within their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping


def check_ranges(values: Mapping[str, object], ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse the first value that is no finite number or out of its range.

    Args:
        values: Value of each measure.
        ranges: Smallest and largest accepted value of each of the measures to check.

    Raises:
        ValueError: Naming the measure, what was expected and what came.
    """
    for name, (low, high) in ranges.items():
        value = values[name]
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{name} must be a finite number; got {value!r}")
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number; got {value!r}")
        if not low <= value <= high:
            raise ValueError(f"{name} must be in [{low}, {high}]; got {value}")
