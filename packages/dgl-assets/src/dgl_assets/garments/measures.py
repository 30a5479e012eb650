"""Measures of garments as plain dictionaries."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any


def flatten_measures(measures: Any, prefix: str = "") -> dict[str, float | str]:
    """Flatten nested dataclasses, names joined by underscores; fields of None are omitted."""
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
