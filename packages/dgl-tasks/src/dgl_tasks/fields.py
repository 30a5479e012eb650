"""Checks that the fields of a declaration have values of their declared types."""

import types
from collections.abc import Mapping
from dataclasses import fields
from functools import lru_cache
from numbers import Integral, Real
from reprlib import Repr
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

Range = Annotated[tuple[float, float], "(low, high), two finite numbers"]
"""An interval; in a declaration, its description is what a wrong value is told to be."""
Vector3 = Annotated[tuple[float, float, float], "(x, y, z), three finite numbers"]
Bound = Annotated[float, "a number, perhaps infinite"]
"""A side of a box that may be open."""

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = 80


def check_fields(declared: object) -> None:
    """Check the fields of a dataclass against their annotations.

    A list or an array where a tuple is declared is replaced by that tuple, so that declarations can be hashed. Numbers are
    finite; NumPy's are numbers, too, and booleans are none.

    Args:
        declared: An instance, frozen or not; fields that its constructor does not take are left out.

    Raises:
        ValueError: Naming the first field that is of another type, what it must be, and what came.
    """
    hints = _get_hints(type(declared))
    for item in fields(declared):  # pyright: ignore[reportArgumentType] - of any dataclass
        if not item.init:
            continue
        kind, value = hints[item.name], getattr(declared, item.name)
        if isinstance(value, (list, np.ndarray)) and get_origin(_bare(kind)) is tuple:
            value = tuple(value.tolist() if isinstance(value, np.ndarray) else value)
            object.__setattr__(declared, item.name, value)
        if not _fits(value, kind):
            raise ValueError(
                f"{type(declared).__name__}: {item.name} must be {_describe(kind)}; "
                f"got {shorten(value)}"
            )


def is_number(value: object) -> bool:
    """Say whether a value is a finite real number, and no boolean."""
    return (
        isinstance(value, Real) and not isinstance(value, (bool, np.bool_)) and np.isfinite(value)  # pyright: ignore[reportArgumentType, reportCallIssue]
    )


def shorten(value: object) -> str:
    """Write a value as Python does, the middle left out where it is long."""
    return _SHORT.repr(value)


@lru_cache
def _get_hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


def _bare(kind: Any) -> Any:
    return get_args(kind)[0] if get_origin(kind) is Annotated else kind


def _fits(value: object, kind: Any) -> bool:
    if kind == Bound:
        return is_number(value) or (isinstance(value, float) and bool(np.isinf(value)))
    kind = _bare(kind)
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return any(_fits(value, option) for option in inner)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if origin is tuple:
        if not isinstance(value, tuple):
            return False
        kinds = [inner[0]] * len(value) if inner[-1] is ... else inner
        return len(value) == len(kinds) and all(map(_fits, value, kinds))
    if origin is not None and issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            _fits(key, inner[0]) and _fits(item, inner[1]) for key, item in value.items()
        )
    if kind is float:
        return is_number(value)
    if kind is int:
        return isinstance(value, Integral) and is_number(value)
    return isinstance(value, kind)


def _describe(kind: Any) -> str:
    if get_origin(kind) is Annotated:
        return get_args(kind)[1]
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        return " or ".join(map(_describe, inner))
    if origin is Literal:
        return f"one of {inner}"
    if origin is tuple:
        if inner[-1] is ...:
            return f"a tuple, each item {_describe(inner[0])}"
        return f"a tuple of {len(inner)}, each {_describe(inner[0])}"
    if origin is not None:
        return f"a mapping from {_describe(inner[0])} to {_describe(inner[1])}"
    words = {float: "a finite number", int: "an integer", str: "a text", types.NoneType: "None"}
    return words.get(kind) or f"a {kind.__name__}"
