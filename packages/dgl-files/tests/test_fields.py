import dataclasses
import json
import re
from typing import Annotated, Literal

import numpy as np
import pytest
from annotated_types import Interval

from dgl_files.fields import (
    MAX_JSON_BYTES,
    STRICT,
    STRICT_PART,
    check_fields,
    check_value,
    decode_json,
    from_plain,
    read_json,
    read_json_file,
    show,
    tell,
)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Part:
    __pydantic_config__ = STRICT_PART

    size: Annotated[int, Interval(ge=1, le=9)] = 1


@dataclasses.dataclass(frozen=True, kw_only=True)
class Whole:
    __pydantic_config__ = STRICT

    name: str
    rate: float = 0.5
    parts: tuple[Part, ...] = ()
    mode: Literal["fast", "slow"] = "fast"

    def __post_init__(self):
        check_fields(self)
        if self.name == "no":
            raise ValueError("name must not be 'no'; got 'no'")


def test_a_dataclass_comes_back_from_json():
    whole = Whole(name="a", rate=2, parts=(Part(size=3),))
    assert from_plain(Whole, dataclasses.asdict(whole)) == whole
    assert read_json(Whole, json.dumps(dataclasses.asdict(whole))) == whole
    assert read_json(Part, '{"size": 3, "later": 1}') == Part(size=3)


def refusal_of(call):
    try:
        call()
    except ValueError as err:
        return str(err)
    return "nothing was raised"


def test_an_error_names_the_field_the_limit_and_the_value():
    told = {
        '{"name": "a", "rate": "1"}': "rate should be a valid number; got '1'",
        '{"name": "a", "rate": NaN}': "rate should be a finite number; got nan",
        '{"name": "a", "rate": true}': "rate should be a valid number; got True",
        '{"name": "a", "parts": [{"size": 0}]}': (
            "parts[0].size should be greater than or equal to 1; got 0"
        ),
        '{"name": "a", "mode": "x"}': "mode should be 'fast' or 'slow'; got 'x'",
        '{"name": "a", "other": 1}': "other: unexpected keyword argument; got 1",
        '{"name": "a", "\\n": 1}': "'\\n': unexpected keyword argument; got 1",
        '{"rate": 1}': "name: field required",
        '{"name": "no"}': "name must not be 'no'; got 'no'",
        '{"name": ': "Invalid JSON: EOF while parsing a value at line 1 column 9",
        "[]": "should be an object; got []",
    }
    found = {text: refusal_of(lambda text=text: read_json(Whole, text)) for text in told}
    assert found == told
    assert refusal_of(lambda: from_plain(Whole, [])) == "Whole must be an object; got []"
    assert refusal_of(lambda: Whole(name=3)) == "name should be a valid string; got 3"  # pyright: ignore[reportArgumentType]


def test_an_error_of_a_file_begins_with_the_file(tmp_path):
    path = tmp_path / "whole.json"
    path.write_text('{"name": 1}')
    with pytest.raises(ValueError, match=re.escape(f"{path}: name should be a valid string")):
        read_json_file(Whole, path)
    path.write_bytes(b'{"name": "\xff"}')
    with pytest.raises(ValueError, match=re.escape(f"{path}: Invalid JSON")):
        read_json_file(Whole, path)
    with pytest.raises(FileNotFoundError):
        read_json_file(Whole, tmp_path / "none.json")


def test_an_error_is_one_short_line_whatever_came():
    nested = {"name": "a", **{"\n" * 3000: "x" * 3000}}
    for call in (
        lambda: from_plain(Whole, nested),
        lambda: check_value("field", 2**5000, Annotated[int, Interval(le=9)]),
        lambda: check_value("field", "y" * 9000, Literal["x"]),
    ):
        message = refusal_of(call)
        assert "\n" not in message
        assert len(message) < 400


def test_a_value_of_any_class_can_be_checked():
    check_value("points", np.zeros(3), np.ndarray)
    check_value("points", {"a": (1.0, 2)}, dict[str, tuple[float, float]])
    with pytest.raises(ValueError, match=r"points should be an instance of ndarray; got \[1\]"):
        check_value("points", [1], np.ndarray)


def test_json_is_decoded_only_if_its_numbers_are_finite_and_it_is_not_too_long():
    assert decode_json('{"a": [1, 2.5, null, "b"]}') == {"a": [1, 2.5, None, "b"]}
    for text in ("NaN", "[1e400]", "-Infinity", "", "{", b"\xff", "[" * 9999, "1" * 9999):
        assert "nothing" not in refusal_of(lambda text=text: decode_json(text)), text
    assert "at most" in refusal_of(lambda: decode_json(" " * (MAX_JSON_BYTES + 1)))


def test_names_and_values_are_shown_in_one_short_line():
    assert tell("cuff left") == "cuff left"
    assert tell("a\nb") == r"'a\nb'"
    assert show(2**64) == "a whole number of 65 bits"
    assert len(show("x" * 999)) == 80
