"""Types and ranges of fields: stated once, as annotations, and checked wherever the values come from."""

import dataclasses
import json
import math
import types
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    cast,
    get_args,
    get_origin,
    get_type_hints,
)

__all__ = [
    "Bound",
    "Count",
    "check_fields",
    "check_value",
    "decode_json",
    "from_plain",
    "show",
    "tell",
]

C = TypeVar("C")

MAX_JSON_CHARACTERS = 16 * 2**20
MAX_JSON_DEPTH = 32
MAX_JSON_DIGITS = 18
"""Of whole numbers: as many as always fit into 64 bits."""


@dataclass(frozen=True)
class Bound:
    """Smallest and largest value of a number."""

    low: float
    high: float

    def check(self, name: str, value: Any) -> None:
        """Raise a `ValueError` that names the field if the value lies outside."""
        if not self.low <= value <= self.high:
            raise ValueError(f"{name} must lie in {self.low} ... {self.high}; got {show(value)}")


@dataclass(frozen=True)
class Count:
    """Smallest and largest number of entries, or of characters of a text."""

    low: int
    high: int

    def check(self, name: str, value: Any) -> None:
        """Raise a `ValueError` that names the field if there are fewer or more."""
        if not self.low <= len(value) <= self.high:
            raise ValueError(
                f"{name} must have {self.low} ... {self.high} entries; got {len(value)}"
            )


def check_fields(config: Any) -> None:
    """Check type and range of every field of a dataclass; meant for `__post_init__`.

    Raises:
        ValueError: If a field is of another type or out of range: its name, what it must be, and what came.
    """
    for name, hint in _get_hints(type(config)).items():
        check_value(name, getattr(config, name), hint)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check a value against a type, annotated with `Bound` and `Count`.

    Known are bool, int, float (finite; whole numbers too), str, `Literal`, tuples, lists, dictionaries with keys of text,
    dataclasses, unions of one of these with None, and `Any`.

    Raises:
        ValueError: If it does not fit: the name, what it must be, and what came.
    """
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        check_value(name, value, inner[0])
        for limit in inner[1:]:
            limit.check(name, value)
    elif origin in (Union, types.UnionType):
        if value is not None:
            (only,) = (each for each in inner if each is not type(None))
            check_value(name, value, only)
    elif origin is Literal:
        if not isinstance(value, str) or value not in inner:
            raise ValueError(f"{name} must be one of {list(inner)}; got {show(value)}")
    elif origin in (tuple, list):
        _check_entries(name, value, origin, inner)
    elif origin is dict:
        _check_kind(name, value, "an object", is_right=isinstance(value, dict))
        for key, each in value.items():
            _check_kind(name, key, "an object with names as keys", is_right=isinstance(key, str))
            check_value(f"{name}.{tell(key)}", each, inner[1])
    elif hint is not Any:
        is_of, kind = _KINDS.get(
            hint, (lambda given: isinstance(given, hint), f"a {getattr(hint, '__name__', hint)}")
        )
        _check_kind(name, value, kind, is_right=is_of(value))


def from_plain(cls: type[C], values: Any) -> C:
    """Build a configuration from plain values, as JSON holds them.

    Raises:
        ValueError: If the values are no object, or a field is missing, unknown, of a wrong type or out of range.
    """
    if not isinstance(values, dict):
        raise ValueError(f"{cls.__name__} must be an object; got {show(values)}")
    fields = {field.name: field for field in dataclasses.fields(cast(Any, cls))}
    unknown = sorted(set(values) - set(fields))
    if unknown:
        raise ValueError(f"{cls.__name__} has no field {show(unknown[0])}; it has {list(fields)}")
    missing = [
        name
        for name, field in fields.items()
        if name not in values and field.default is field.default_factory
    ]
    if missing:
        raise ValueError(f"{cls.__name__} must have {missing[0]}; got {show(list(values))}")
    hints = get_type_hints(cls)
    built = {}
    for name, value in values.items():
        try:
            built[name] = _build(hints[name], value)
        except ValueError as err:
            raise ValueError(f"{name}: {err}") from err
    return cls(**built)


def decode_json(text: str) -> Any:
    """Decode JSON whose numbers are finite and fit into 64 bits.

    Raises:
        ValueError: If it is none, too long or too deep, or a number is too large or not finite; then it names the field.
    """
    if len(text) > MAX_JSON_CHARACTERS:
        raise ValueError(
            f"JSON must have at most {MAX_JSON_CHARACTERS} characters; got {len(text)}"
        )
    try:
        value = json.loads(
            text, parse_int=_parse_int, parse_float=_parse_float, parse_constant=_parse_float
        )
    except RecursionError:
        raise ValueError(f"JSON must be at most {MAX_JSON_DEPTH} deep") from None
    level, depth = [("", value)], 0
    while level:
        if depth > MAX_JSON_DEPTH:
            raise ValueError(f"JSON must be at most {MAX_JSON_DEPTH} deep")
        depth += 1
        following: list[tuple[str, Any]] = []
        for where, part in level:
            if isinstance(part, _Refused):
                raise ValueError(f"{where or 'the number'} {part.reason}")
            if isinstance(part, dict):
                dot = "." if where else ""
                following += [(f"{where}{dot}{tell(key)}", each) for key, each in part.items()]
            elif isinstance(part, list):
                following += [(f"{where}[{number}]", each) for number, each in enumerate(part)]
        level = following
    return value


def show(value: Any) -> str:
    """Write a value of any kind for a message, in one line of at most about 80 characters."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"a whole number of {value.bit_length()} bits"
    text = " ".join(repr(value)[:400].split())
    return text if len(text) <= 80 else f"{text[:79]}…"


def tell(name: str) -> str:
    """Write a name that came from a file, for a message: as it is, unless it is long or would break the line."""
    return name if name.isprintable() and len(name) <= 80 else show(name)


def _build(hint: Any, value: Any) -> Any:
    """Make tuples of lists and configurations of objects; all else is left for `check_fields`."""
    kinds = get_args(hint)
    if type(None) in kinds and value is not None:
        return _build(kinds[0], value)
    if get_origin(hint) is tuple and isinstance(value, (list, tuple)):
        return tuple(_build(kinds[0], each) for each in value)
    if dataclasses.is_dataclass(hint) and isinstance(value, dict):
        return from_plain(cast(type, hint), value)
    return value


def _is_int(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_float(value: Any) -> bool:
    if _is_int(value):
        return value.bit_length() <= 64
    return isinstance(value, float) and math.isfinite(value)


_KINDS: Mapping[Any, tuple[Any, str]] = {
    bool: (lambda given: isinstance(given, bool), "true or false"),
    int: (_is_int, "a whole number"),
    float: (_is_float, "a finite number"),
    str: (lambda given: isinstance(given, str), "a text"),
}


def _check_kind(name: str, value: Any, kind: str, *, is_right: bool) -> None:
    if not is_right:
        raise ValueError(f"{name} must be {kind}; got {show(value)}")


def _check_entries(name: str, value: Any, kind: type, inner: tuple[Any, ...]) -> None:
    _check_kind(name, value, "a list of values", is_right=isinstance(value, kind))
    if kind is list or inner[-1] is Ellipsis:
        if inner[0] in _KINDS and all(map(_KINDS[inner[0]][0], value)):
            return  # The usual case, without a name for each entry.
        hints = [inner[0]] * len(value)
    else:
        hints = list(inner)
        if len(value) != len(hints):
            raise ValueError(f"{name} must have {len(hints)} entries; got {len(value)}")
    for number, (each, hint) in enumerate(zip(value, hints, strict=True)):
        check_value(f"{name}[{number}]", each, hint)


@cache
def _get_hints(kind: type) -> dict[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}


@dataclass(frozen=True)
class _Refused:
    """Stands for a number that is not to be used, until it is known in which field."""

    reason: str


def _parse_int(text: str) -> "int | _Refused":
    digits = len(text.lstrip("-"))
    if digits > MAX_JSON_DIGITS:
        return _Refused(f"must have at most {MAX_JSON_DIGITS} digits; got {digits}")
    return int(text)


def _parse_float(text: str) -> "float | _Refused":
    value = float(text)
    return value if math.isfinite(value) else _Refused(f"must be finite; got {text[:20]}")
