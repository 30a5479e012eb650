"""Dataclasses and JSON, checked against annotations; an error is one line with field and value."""

import dataclasses
import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import pydantic_core
from pydantic import ConfigDict, TypeAdapter, ValidationError

C = TypeVar("C")

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""For `__pydantic_config__` of dataclasses: no conversion, no unknown field, finite numbers."""
STRICT_PART = ConfigDict(strict=True, extra="ignore", allow_inf_nan=False)
"""The same, for a part of what a file holds: unknown fields are ignored."""
_STRICT_VALUE = ConfigDict(
    strict=True, extra="forbid", allow_inf_nan=False, arbitrary_types_allowed=True
)
MAX_JSON_BYTES = 16 * 2**20


def check_fields(config: Any) -> None:
    """Check type and range of every field of a dataclass; for use in `__post_init__`.

    Raises:
        ValueError: If a field does not fit: its name, the type or range, and the value.
    """
    for name, hint in _get_hints(type(config)).items():
        check_value(name, getattr(config, name), hint)


def adopt_fields(config: Any) -> None:
    """Check fields as `check_fields` does, where a value may be NumPy's, or a list for a tuple.

    Such values are replaced by plain ones, so that frozen dataclasses can be hashed. The message
    begins with the name of the class. Fields that the constructor does not take are left out.

    Raises:
        ValueError: As `check_fields`.
    """
    kind = type(config)
    hints = _get_hints(kind)
    for field in dataclasses.fields(config):
        if not field.init:
            continue
        value = getattr(config, field.name)
        plain = _make_plain(value)
        check_value(f"{kind.__name__}: {field.name}", plain, hints[field.name])
        if plain is not value:
            object.__setattr__(config, field.name, plain)


def _make_plain(value: Any) -> Any:
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, list):
        return tuple(map(_make_plain, value))
    if type(value) is tuple:
        plain = tuple(map(_make_plain, value))
        return value if all(a is b for a, b in zip(plain, value, strict=True)) else plain
    return value


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check a value against a type, which may be annotated with limits of `annotated_types`.

    Raises:
        ValueError: If it does not fit: the name, the type or range, and the value.
    """
    try:
        _get_adapter(hint).validate_python(value, strict=True)
    except ValidationError as err:
        raise ValueError(_describe(err, name)) from None


def from_plain(cls: type[C], values: Any) -> C:
    """Build a dataclass from plain values, as JSON holds them.

    Raises:
        ValueError: If the values are no object, or a field is missing, unknown or does not fit.
    """
    if not isinstance(values, dict):
        raise ValueError(f"{cls.__name__} must be an object; got {show(values)}")
    return read_json(cls, pydantic_core.to_json(values, inf_nan_mode="constants"))


def read_json(cls: type[C], text: str | bytes) -> C:
    """Decode JSON as a dataclass, and check type and range of every field.

    Raises:
        ValueError: If the text is no JSON, or a field is missing, unknown or does not fit.
    """
    try:
        return _get_adapter(cls).validate_json(text, strict=True)
    except ValidationError as err:
        raise ValueError(_describe(err)) from None


def read_json_file(cls: type[C], path: Path) -> C:
    """Read a file with `read_json`.

    Raises:
        ValueError: As `read_json`; the message begins with the file.
        OSError: If the file cannot be read.
    """
    try:
        return read_json(cls, path.read_bytes())
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def decode_json(text: str | bytes) -> Any:
    """Decode JSON whose numbers are finite.

    Raises:
        ValueError: If the text is no JSON, too long, nested too deep, or a number is not finite.
    """
    if len(text) > MAX_JSON_BYTES:
        raise ValueError(f"JSON must have at most {MAX_JSON_BYTES} characters; got {len(text)}")
    value = pydantic_core.from_json(text)
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError("a number must be finite; got one that is not") from None
    return value


def show(value: Any) -> str:
    """Write any value for a message, in one line of at most about 80 characters."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"a whole number of {value.bit_length()} bits"
    return _clip(repr(value)[:400], 80)


def tell(name: str) -> str:
    """Write a name from a file for a message; quoted only if it is long or not printable."""
    return name if name.isprintable() and len(name) <= 80 else show(name)


_EXPECTED = "Input should be "


def _describe(err: ValidationError, name: str = "") -> str:
    """Write the first error: the field, the type or range, and the value."""
    errors = err.errors(include_url=False)
    first, where = errors[0], name
    if first["loc"] and str(first["loc"][-1]).startswith("literal["):  # else an object is meant
        first = max(errors, key=lambda error: len(error["loc"]))
    place = first["loc"]
    options = [e["msg"] for e in errors if show(e["input"]) == show(first["input"])]
    if len(options) > 1 and all(msg.startswith(_EXPECTED) for msg in options):  # of a union's types
        wanted = dict.fromkeys(msg.removeprefix(_EXPECTED) for msg in options)
        first = {**first, "msg": _EXPECTED + " or ".join(wanted)}
        place = place[:-1]
    for part in place:
        where += f"[{part}]" if isinstance(part, int) else f".{tell(part)}" if where else tell(part)
    where = _clip(where, 160)
    text = _clip(first["msg"].removeprefix("Value error, "), 300)
    if first["type"] == "value_error":  # A dataclass's own check names its fields.
        return f"{where}: {text}" if where else text
    got = "" if first["type"] in ("missing", "json_invalid") else f"; got {show(first['input'])}"
    if text.startswith("Input "):
        return f"{where} {text.removeprefix('Input ')}{got}".strip()
    text = text if text.startswith("Invalid JSON") else f"{text[0].lower()}{text[1:]}"
    return f"{where}: {text}{got}" if where else text + got


def _clip(text: str, length: int) -> str:
    line = " ".join(text.split())
    return line if len(line) <= length else f"{line[: length - 1]}…"


@cache
def _get_adapter(hint: Any) -> TypeAdapter:
    # A dataclass has a configuration of its own.
    return TypeAdapter(hint, config=None if dataclasses.is_dataclass(hint) else _STRICT_VALUE)


@cache
def _get_hints(kind: type) -> Mapping[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}
