"""Types and ranges of fields, stated as annotations and checked wherever values come from."""

import dataclasses
import json
from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar, get_type_hints

import pydantic_core
from pydantic import ConfigDict, TypeAdapter, ValidationError

__all__ = ["STRICT", "check_fields", "check_value", "decode_json", "from_plain", "show", "tell"]

C = TypeVar("C")

STRICT = ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""`__pydantic_config__` of configurations: no conversion, no unknown field, finite numbers."""
MAX_JSON_CHARACTERS = 16 * 2**20


def check_fields(config: Any) -> None:
    """Check type and range of every field of a dataclass; meant for `__post_init__`.

    Raises:
        ValueError: If a field is of another type or out of range. The message names the field, the
            expected type or range, and the value.
    """
    for name, hint in _get_hints(type(config)).items():
        check_value(name, getattr(config, name), hint)


def check_value(name: str, value: Any, hint: Any) -> None:
    """Check a value against a type, annotated with what `annotated_types` has.

    Raises:
        ValueError: With the name, the expected type or range, and the value.
    """
    try:
        _get_adapter(hint).validate_python(value, strict=True)
    except ValidationError as err:
        raise ValueError(_describe(err, name)) from None


def from_plain(cls: type[C], values: Any) -> C:
    """Build a configuration from plain values, as JSON holds them.

    Raises:
        ValueError: If the values are no object, or a field is missing, unknown, of a wrong type
            or out of range.
    """
    if not isinstance(values, dict):
        raise ValueError(f"{cls.__name__} must be an object; got {show(values)}")
    try:
        return _get_adapter(cls).validate_json(
            pydantic_core.to_json(values, inf_nan_mode="constants"), strict=True
        )
    except ValidationError as err:
        raise ValueError(_describe(err)) from None


def decode_json(text: str) -> Any:
    """Decode JSON whose numbers are finite.

    Raises:
        ValueError: If it is none, too long, nested too deep, or a number is not finite.
    """
    if len(text) > MAX_JSON_CHARACTERS:
        raise ValueError(
            f"JSON must have at most {MAX_JSON_CHARACTERS} characters; got {len(text)}"
        )
    value = pydantic_core.from_json(text)
    try:
        json.dumps(value, allow_nan=False)
    except ValueError:
        raise ValueError("a number must be finite; got one that is not") from None
    return value


def show(value: Any) -> str:
    """Write any value for a message, in one line of about 80 characters."""
    if isinstance(value, int) and value.bit_length() > 64:
        return f"a whole number of {value.bit_length()} bits"
    text = " ".join(repr(value)[:400].split())
    return text if len(text) <= 80 else f"{text[:79]}…"


def tell(name: str) -> str:
    """Write a name from a file for a message; quote it if it is long or not printable."""
    return name if name.isprintable() and len(name) <= 80 else show(name)


def _describe(err: ValidationError, name: str = "") -> str:
    """Describe the first error: its place, the expected value and the received one."""
    first = err.errors(include_url=False)[0]
    where = name
    for part in first["loc"]:
        where += f"[{part}]" if isinstance(part, int) else f".{tell(part)}" if where else tell(part)
    text = first["msg"].removeprefix("Value error, ")
    if first["type"] == "value_error":  # of a configuration's own check, which names its fields
        return f"{where}: {text}" if where else text
    got = "" if first["type"] == "missing" else f"; got {show(first['input'])}"
    if text.startswith("Input "):
        return f"{where} {text.removeprefix('Input ')}{got}"
    return f"{where}: {text[0].lower()}{text[1:]}{got}"


@cache
def _get_adapter(hint: Any) -> TypeAdapter:
    return TypeAdapter(hint, config=None if dataclasses.is_dataclass(hint) else STRICT)


@cache
def _get_hints(kind: type) -> Mapping[str, Any]:
    hints = get_type_hints(kind, include_extras=True)
    return {field.name: hints[field.name] for field in dataclasses.fields(kind)}
