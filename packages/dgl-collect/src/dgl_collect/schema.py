"""JSON from outside, checked by type where it is read."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import pydantic
import pydantic_core

__all__ = ["STRICT", "STRICT_PART", "decode_json", "read_json", "read_json_file"]

T = TypeVar("T")

STRICT = pydantic.ConfigDict(strict=True, extra="forbid", allow_inf_nan=False)
"""For dataclasses that are read, as `__pydantic_config__`: no value is converted, none is unknown, numbers are finite."""
STRICT_PART = pydantic.ConfigDict(strict=True, extra="ignore", allow_inf_nan=False)
"""The same for a part of what a file has: what is not declared is passed over."""


def decode_json(text: str | bytes) -> Any:
    """Decode JSON of any form.

    Raises:
        ValueError: If it is none, nested too deep, or has a number that is not finite.
    """
    return pydantic_core.from_json(text, allow_inf_nan=False)


def read_json(kind: type[T], text: str | bytes) -> T:
    """Decode JSON as a dataclass, checking every value's type.

    Args:
        kind: A dataclass, with `STRICT` as its `__pydantic_config__`.
        text: The JSON.

    Raises:
        ValueError: In one line, naming the first field that is not as it should be.
    """
    try:
        return _adapter(kind).validate_json(text)
    except pydantic.ValidationError as err:
        raise ValueError(_describe(err)) from err


def read_json_file(kind: type[T], path: Path) -> T:
    """Read a file of JSON as a dataclass; as `read_json`.

    Raises:
        ValueError: In one line that begins with the file.
        OSError: If it cannot be read.
    """
    try:
        return read_json(kind, path.read_bytes())
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


@cache
def _adapter(kind: type) -> pydantic.TypeAdapter:
    return pydantic.TypeAdapter(kind)


def _describe(err: pydantic.ValidationError) -> str:
    """Say what the first error is, where, and what came."""
    first = err.errors(include_url=False)[0]
    where = _shorten(".".join(_tell(part) for part in first["loc"]), 80)
    text = _shorten(first["msg"].removeprefix("Value error, "), 200)
    came = _shorten(repr(first["input"]), 80)
    if first["type"] in ("missing", "value_error", "json_invalid"):
        return f"{where}: {text}" if where else text
    told = f"{text}; got {came}"
    return f"{where}: {told}" if where else told


def _tell(part: str | int) -> str:
    """Write a step of the way to a value: a name in a file may hold anything, line ends too."""
    return str(part) if str(part).isprintable() else repr(part)


def _shorten(text: str, length: int) -> str:
    line = " ".join(text.split())
    return line if len(line) <= length else line[:length] + "…"
