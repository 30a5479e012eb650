"""Formulas of demonstrations: what they compute, and what they refuse."""

import re

import numpy as np
import pytest

from dgl_collect.formula import check_formula, evaluate_formula, find_names

NAMES = {
    "cuff": np.array([1.0, 2.0, 3.0]),
    "chest": np.array([4.0, 6.0, -1.0]),
    "lift": 0.3,
    "count": 2,
    "hanger": {"target": np.array([0.1, 0.2, 1.5]), "width": 0.4},
}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1 + 2", 3.0),
        ("1 - 2 - 3", -4.0),
        ("2 * 3", 6.0),
        ("7 / 2", 3.5),
        ("1 + 2 * 3", 7.0),
        ("(1 + 2) * 3", 9.0),
        ("-lift", -0.3),
        ("--2", 2.0),
        ("2 - -3", 5.0),
        ("1e-2", 0.01),
        ("lift", 0.3),
        ("count / 4", 0.5),
        ("cuff.x", 1.0),
        ("cuff.y", 2.0),
        ("cuff.z", 3.0),
        ("min(cuff.x, lift)", 0.3),
        ("max(cuff.x, lift, 5)", 5.0),
        ("abs(cuff.x - chest.x)", 3.0),
        ("distance_xy(cuff, chest)", 5.0),
        ("min(distance_xy(cuff, chest), 0.3) / 2", 0.15),
        ("heading(cuff, chest)", np.degrees(np.arctan2(4, 3))),
        ("heading(chest, cuff)", np.degrees(np.arctan2(-4, -3))),
        ("hanger.target.z", 1.5),
        ("hanger.width / 2 - hanger.target.x", 0.1),
        ("distance_xy(hanger.target, cuff)", np.hypot(0.9, 1.8)),
        ("1 < 2", 1.0),
        ("2 < 2", 0.0),
        ("2 <= 2", 1.0),
        ("2 > 2", 0.0),
        ("cuff.z >= count", 1.0),
        ("lift == 0.3", 1.0),
        ("lift == 0.31", 0.0),
        ("not lift", 0.0),
        ("not 0", 1.0),
        ("lift > 1 or count == 2", 1.0),
        ("lift > 1 or count == 3", 0.0),
        ("lift < 1 and count == 2", 1.0),
        ("lift < 1 and count == 3", 0.0),
        ("0 or 1 and 0", 0.0),
        ("not (lift > 1) and lift < 1", 1.0),
        (0.08, 0.08),
        (2, 2.0),
    ],
)
def test_formulas_have_the_value_of_their_arithmetic(text, value):
    result = evaluate_formula(text, NAMES)
    assert isinstance(result, float)
    assert result == pytest.approx(value, abs=1e-12)


def test_the_horizontal_distance_ignores_the_height():
    a, b = np.array([0.0, 0.0, 0.0]), np.array([0.0, 0.0, 9.0])
    assert evaluate_formula("distance_xy(a, b)", {"a": a, "b": b}) == 0.0


def find_wrong(compute, table):
    """Rows that are not refused with their message."""
    wrong = []
    for text, message in table:
        try:
            found = f"taken, {compute(text, NAMES)}"
        except ValueError as err:
            found = str(err)
        if not re.search(message, found):
            wrong.append((str(text)[:50], found))
    return wrong


REFUSED = (
    ("cuf.x", "unknown name 'cuf'; known: chest, count, cuff, hanger, lift"),
    ("cuff", "must give a number; 'cuff' gives a point"),
    ("hanger", "must give a number; 'hanger' gives several things"),
    ("hanger.target", "must give a number; 'hanger.target' gives a point"),
    ("hanger.nowhere.x", "unknown name 'nowhere'; known: target, width"),
    ("hanger.x", "unknown name 'x'; known: target, width"),
    ("lift.x", "'lift.x' is neither a coordinate nor a known name"),
    ("cuff.w", "'cuff.w' is neither a coordinate nor a known name"),
    ("cuff + 1", "arithmetic is for numbers; 'cuff' is none"),
    ("cuff - chest", "arithmetic is for numbers; 'cuff' is none"),
    ("-hanger", "arithmetic is for numbers; 'hanger' is none"),
    ("cuff < chest", "arithmetic is for numbers; 'cuff' is none"),
    ("not cuff", "arithmetic is for numbers; 'cuff' is none"),
    ("lift or cuff", "arithmetic is for numbers; 'cuff' is none"),
    ("1 / 0", "formula '1 / 0' cannot be evaluated: .*division by zero"),
    ("1 / (lift - 0.3)", "division by zero"),
    (
        "tan(2)",
        "unknown function .tan.; known: abs, cos, distance_xy, heading, max, min, sin, sqrt",
    ),
    ("min(cuff, 1)", "arithmetic is for numbers; 'cuff' is none"),
    ("-" * 10**5 + "1", "must have at most 1000 characters; got 100001"),
    ("-" * 999 + "1", "cannot be evaluated|must be an arithmetic expression"),
    ("(" * 500 + "1", "must be an arithmetic expression"),
    ("1" + "0" * 400, "cannot be evaluated: int too large"),
    ("distance_xy(cuff)", "missing 1 required positional argument"),
    ("distance_xy(1, 2)", "distance_xy and heading take two points"),
    ("heading(cuff, hanger)", "distance_xy and heading take two points"),
    ("1 +", "must be an arithmetic expression; got '1 \\+'"),
    ("", "must be an arithmetic expression; got ''"),
    ("x = 1", "must be an arithmetic expression"),
    ("2 ** 3", "'2 \\*\\* 3' is not allowed"),
    ("7 // 2", "is not allowed"),
    ("7 % 2", "is not allowed"),
    ("+lift", "is not allowed"),
    ("cuff[0]", "is not allowed"),
    ("1 < 2 < 3", "is not allowed"),
    ("1 != 2", "is not allowed"),
    ("cuff is chest", "is not allowed"),
    ("1 in cuff", "is not allowed"),
    ("1 if lift else 2", "is not allowed"),
    ("min(*cuff)", "is not allowed"),
    ("max(1, 2, key=abs)", "is not allowed"),
    ("'text'", "is not allowed"),
    ("[1, 2]", "is not allowed"),
    (None, "is not allowed"),
    ([1], "is not allowed"),
)


def test_what_is_no_formula_is_refused_with_the_reason():
    assert find_wrong(evaluate_formula, REFUSED) == []


CODE = (
    "__import__('os').system('true')",
    "().__class__.__bases__[0].__subclasses__()",
    "cuff.__class__",
    "cuff.tofile",
    "cuff.dump('/tmp/x')",
    "min.__globals__",
    "(lambda: 1)()",
    "open('/etc/passwd')",
    "eval('1')",
    "[x for x in cuff]",
    "(y := 1)",
    "f'{lift}'",
    "min(1, __import__('os'))",
    "lift.real",
    "hanger.keys()",
    "hanger.__class__",
    "hanger.target.__class__",
)


def test_nothing_but_arithmetic_is_ever_run():
    message = r"not allowed|unknown (function|name)|neither a coordinate"
    assert find_wrong(evaluate_formula, [(text, message) for text in CODE]) == []


def test_the_names_are_not_changed():
    before = repr(NAMES)
    evaluate_formula("max(abs(-cuff.x), distance_xy(cuff, hanger.target))", NAMES)
    check_formula("hanger.target.x", NAMES)
    assert repr(NAMES) == before


@pytest.mark.parametrize("text", ["1e999", "1e308 * 10", "1e999 - 1e999"])
def test_a_value_that_is_not_finite_is_refused(text):
    with pytest.raises(ValueError, match="finite"):
        evaluate_formula(text, NAMES)


@pytest.mark.parametrize("text", ["1 / (lift - 0.3)", "1e308 * count * 10", "lift > 0 or 1 / lift"])
def test_whether_a_formula_can_be_evaluated_does_not_depend_on_the_values(text):
    check_formula(text, NAMES)


NEVER = (
    ("cuf.x", "unknown name 'cuf'"),
    ("hanger.nowhere.x", "unknown name 'nowhere'"),
    ("cuff", "gives a point"),
    ("lift + cuff", "arithmetic is for numbers"),
    ("tan(lift)", "unknown function 'tan'"),
    ("lift > 0 or nothing", "unknown name 'nothing'"),  # whatever comes before it
    ("lift +", "must be an arithmetic expression"),
)


def test_what_could_never_be_evaluated_is_refused_before():
    assert find_wrong(check_formula, NEVER) == []


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("held or value >= 0.65", {"held", "value"}),
        ("hanger.target.x + lift", {"hanger", "lift"}),
        ("not 1", set()),
        (0.5, set()),
    ],
)
def test_the_names_of_a_formula_are_found(text, names):
    assert find_names(text) == names


def test_what_is_no_expression_has_no_names():
    with pytest.raises(ValueError, match="must be an arithmetic expression"):
        find_names("held or")
