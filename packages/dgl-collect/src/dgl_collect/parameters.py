"""Named numbers of a demonstration, which formulas use and `dgl tune` searches."""

import copy
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

from annotated_types import Len

from dgl_collect.formula import Value, evaluate_formula, find_names
from dgl_files.fields import STRICT, check_fields, check_value, from_plain, show

__all__ = ["Parameter", "check_used", "fill_in"]

NUMBERS = frozenset(
    ("at_most", "back", "by", "come_from", "frames", "height", "lift", "moved_at_most", "pitch")
) | frozenset(("rise", "roll", "sag", "shift", "short_by", "spacing", "speed", "up", "wait", "yaw"))
"""Fields of stages and steps that hold numbers; they may be formulas of parameters."""
_WHOLE = ("frames", "wait")


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number.

    Raises:
        ValueError: If the range is empty, or the value is not within it.
    """

    __pydantic_config__: ClassVar = STRICT

    value: float
    range: tuple[float, float]
    """Least and largest value that a search may take."""
    meaning: Annotated[str, Len(1, 200)]
    """The quantity, and its unit."""

    def __post_init__(self) -> None:
        check_fields(self)
        low, high = self.range
        if not low < high:
            raise ValueError(f"range must be [low, high] with low < high; got [{low}, {high}]")
        if not low <= self.value <= high:
            raise ValueError(f"value must be in the range [{low}, {high}]; got {self.value}")


def fill_in(content: Mapping[str, Any]) -> dict[str, Any]:
    """Compute the numbers of a demonstration's JSON object that are formulas of parameters.

    They are the fields of numbers and the coordinates of points. Formulas of places and conditions
    stay: they take the parameters by name.

    Raises:
        ValueError: If a parameter is damaged, or a formula of parameters cannot be evaluated.
    """
    whole = copy.deepcopy(dict(content))
    named = whole.get("parameters", {})
    check_value("parameters", named, dict[str, dict[str, Any]])
    values: dict[str, Value] = {}
    for name, fields in named.items():
        try:
            values[name] = from_plain(Parameter, fields).value
        except ValueError as err:
            raise ValueError(f"parameters.{show(name)}: {err}") from err
    if not values:
        return whole
    points = whole.get("points")
    if isinstance(points, dict):
        places: dict[str, Value] = dict(values)
        for name, place in points.items():
            if isinstance(place, list):
                points[name] = [_compute(each, places) for each in place]
                if all(isinstance(each, int | float) for each in points[name]):
                    places[name] = dict(zip("xyz", points[name], strict=False))
    _fill_in_numbers(whole.get("stages"), values)
    return whole


def check_used(content: Mapping[str, Any]) -> None:
    """Check that each parameter of a demonstration's JSON object is in a formula.

    Raises:
        ValueError: If one is in none.
    """
    used = set(_list_names([content.get(key) for key in ("points", "stages")]))
    if unused := sorted(set(content.get("parameters", ())) - used):
        raise ValueError(f"parameters must be in formulas; {unused} are in none")


def _list_names(tree: Any) -> Iterator[str]:
    """List the names in all texts that are formulas."""
    if isinstance(tree, str):
        with suppress(ValueError):  # some other text
            yield from find_names(tree)
    elif isinstance(tree, list | dict):
        for each in tree.values() if isinstance(tree, dict) else tree:
            yield from _list_names(each)


def _fill_in_numbers(tree: Any, values: Mapping[str, Value]) -> None:
    """Replace formulas in fields of numbers."""
    if isinstance(tree, list):
        for each in tree:
            _fill_in_numbers(each, values)
    elif isinstance(tree, dict):
        for key, value in tree.items():
            if key in NUMBERS and isinstance(value, list):
                tree[key] = [_compute(each, values) for each in value]
            elif key in NUMBERS and isinstance(value, str):
                number = _compute(value, values)
                tree[key] = round(number) if key in _WHOLE else number
            elif key not in ("definitions", "grasp"):  # names of one's own
                _fill_in_numbers(value, values)


def _compute(value: Any, names: Mapping[str, Value]) -> Any:
    return evaluate_formula(value, names) if isinstance(value, str) else value
