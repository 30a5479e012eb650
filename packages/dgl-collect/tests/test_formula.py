"""Formulas of demonstrations: what they compute, and what they refuse."""

import numpy as np
import pytest

from dgl_collect.formula import evaluate_formula

NAMES = {
    "cuff": np.array([1.0, 2.0, 3.0]),
    "chest": np.array([4.0, 6.0, -1.0]),
    "lift": 0.3,
    "count": 2,
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


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("cuf.x", "unknown name 'cuf'; known: chest, count, cuff, lift"),
        ("cuff", "must give a number; 'cuff' gives a point"),
        ("lift.x", "only points have a coordinate 'x'"),
        ("cuff + 1", "arithmetic is for numbers; name a coordinate"),
        ("cuff - chest", "arithmetic is for numbers"),
        ("1 / 0", "formula '1 / 0' cannot be evaluated: .*division by zero"),
        ("1 / (lift - 0.3)", "division by zero"),
        ("sqrt(2)", "unknown function 'sqrt'; known: abs, distance_xy, max, min"),
        ("distance_xy(cuff)", "missing 1 required positional argument"),
        pytest.param(
            "distance_xy(1, 2)",
            "cannot be evaluated",
        ),
        ("1 +", "must be an arithmetic expression; got '1 \\+'"),
        ("", "must be an arithmetic expression; got ''"),
        ("x = 1", "must be an arithmetic expression"),
        ("2 ** 3", "'2 \\*\\* 3' is not allowed"),
        ("7 // 2", "is not allowed"),
        ("7 % 2", "is not allowed"),
        ("+lift", "is not allowed"),
        ("cuff[0]", "is not allowed"),
        ("1 < 2", "is not allowed"),
        ("1 if lift else 2", "is not allowed"),
        ("min(*cuff)", "is not allowed"),
        ("max(1, 2, key=abs)", "is not allowed"),
        ("'text'", "is not allowed"),
        ("[1, 2]", "is not allowed"),
        (None, "is not allowed"),
        ([1], "is not allowed"),
    ],
)
def test_what_is_no_formula_is_refused_with_the_reason(text, message):
    with pytest.raises(ValueError, match=message):
        evaluate_formula(text, NAMES)


@pytest.mark.parametrize(
    "text",
    [
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
    ],
)
def test_nothing_but_arithmetic_is_ever_run(text):
    with pytest.raises(ValueError, match=r"not allowed|unknown (function|name)"):
        evaluate_formula(text, NAMES)


def test_the_names_are_not_changed():
    names = {key: np.copy(value) for key, value in NAMES.items()}
    evaluate_formula("max(abs(-cuff.x), distance_xy(cuff, chest))", NAMES)
    for key, value in names.items():
        np.testing.assert_array_equal(NAMES[key], value)


@pytest.mark.parametrize("text", ["1e999", "1e308 * 10", "1e999 - 1e999"])
def test_a_value_that_is_not_finite_is_refused(text):
    with pytest.raises(ValueError, match="finite"):
        evaluate_formula(text, NAMES)
