"""Formulas of demonstrations: arithmetic and conditions over points and numbers, without `eval`."""

import ast
import operator
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np

Value: TypeAlias = "float | np.ndarray | Mapping[str, Value]"
"""A number, a point [m] of shape (3,), or values by name."""

MAX_CHARACTERS = 1000
"""Longest formula."""
_OPERATORS: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
}
_AXES = {"x": 0, "y": 1, "z": 2}


def _subtract_xy(a: Value, b: Value) -> np.ndarray:
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        raise ValueError("distance_xy and heading take two points")
    return (b - a)[:2]


def _heading(a: Value, b: Value) -> float:
    x, y = _subtract_xy(a, b)
    return float(np.degrees(np.arctan2(y, x)))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "min": min,
    "max": max,
    "abs": abs,
    "sin": lambda angle: float(np.sin(np.radians(angle))),
    "cos": lambda angle: float(np.cos(np.radians(angle))),
    "sqrt": lambda number: float(np.sqrt(max(number, 0.0))),
    "distance_xy": lambda a, b: float(np.linalg.norm(_subtract_xy(a, b))),
    "heading": _heading,
}
"""Functions that formulas may call, by name."""
_OF_POINTS = ("distance_xy", "heading")


def evaluate_formula(text: str | float, names: Mapping[str, Value]) -> float:
    """Evaluate a formula of a demonstration.

    A formula consists of numbers, `+ - * /`, names, names of a group (`hanger.target`), coordinates
    of points (`left_cuff.x`) and the functions `min`, `max`, `abs`, `sin` and `cos` of degrees,
    `sqrt` (0 for what is less than 0), `distance_xy(point, point)`, the horizontal distance, and
    `heading(point, point)`, the direction from the first to the second, counter-clockwise from x
    [degrees]. Conditions add comparisons, `and`, `or` and `not`; true is 1.

    Args:
        text: The formula, or a number.
        names: Numbers, points [m] of shape (3,), and groups of either, by name.

    Returns:
        The value, in metres where its parts are.

    Raises:
        ValueError: If the text is no such formula, or uses an unknown name.
    """
    value = _compute(text, names)
    if not np.isfinite(value):
        raise ValueError(f"formula must be finite; {text!r} gives {value}")
    return value


def check_formula(text: str | float, names: Mapping[str, Value]) -> None:
    """Check that a formula can be evaluated with such names, for any of their values.

    Raises:
        ValueError: As `evaluate_formula`.
    """
    _compute(text, _forget(names))


def find_names(text: str | float) -> set[str]:
    """List the names in a formula; of `hanger.target` the first, `hanger`.

    Raises:
        ValueError: If the text is no expression.
    """
    return {node.id for node in ast.walk(_parse(text)) if isinstance(node, ast.Name)}


def _forget(names: Mapping[str, Value]) -> dict[str, Value]:
    """Replace every number by NaN, which no division or comparison refuses."""
    forgotten: dict[str, Value] = {}
    for name, value in names.items():
        if isinstance(value, Mapping):
            forgotten[name] = _forget(value)
        else:
            forgotten[name] = np.full(3, np.nan) if isinstance(value, np.ndarray) else np.nan
    return forgotten


def _parse(text: str | float) -> ast.expr:
    text = str(text)
    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"formula must have at most {MAX_CHARACTERS} characters; got {len(text)}")
    try:
        return ast.parse(text, mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError) as err:
        raise ValueError(f"formula must be an arithmetic expression; got {text!r}") from err


def _compute(text: str | float, names: Mapping[str, Value]) -> float:
    tree = _parse(text)
    try:
        value = _evaluate(tree, names)
    except (ValueError, ArithmeticError, TypeError, RecursionError) as err:
        raise ValueError(f"formula {text!r} cannot be evaluated: {err}") from err
    if not isinstance(value, float):
        kind = "a point" if isinstance(value, np.ndarray) else "several things"
        raise ValueError(f"formula must give a number; {text!r} gives {kind}")
    return value


def _evaluate(node: ast.expr, names: Mapping[str, Value]) -> Value:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name):
            return _get(name, names)
        case ast.Attribute(value=inner, attr=name):
            owner = _evaluate(inner, names)
            if isinstance(owner, Mapping):
                return _get(name, owner)
            if not isinstance(owner, np.ndarray) or name not in _AXES:
                raise ValueError(f"{ast.unparse(node)!r} is neither a coordinate nor a known name")
            return float(owner[_AXES[name]])
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return -_number(inner, names)
        case ast.UnaryOp(op=ast.Not(), operand=inner):
            return float(not _number(inner, names))
        case (
            ast.BinOp(left=left, op=op, right=right)
            | ast.Compare(left=left, ops=[op], comparators=[right])
        ) if type(op) in _OPERATORS:
            return float(_OPERATORS[type(op)](_number(left, names), _number(right, names)))
        case ast.BoolOp(op=op, values=parts):
            truths = [bool(_number(part, names)) for part in parts]
            return float(all(truths) if isinstance(op, ast.And) else any(truths))
        case ast.Call(func=ast.Name(id=name), args=parts, keywords=[]):
            if name not in FUNCTIONS:
                known = ", ".join(sorted(FUNCTIONS))
                raise ValueError(f"unknown function {name!r}; known: {known}")
            take = _evaluate if name in _OF_POINTS else _number
            return float(FUNCTIONS[name](*(take(part, names) for part in parts)))
    raise ValueError(f"{ast.unparse(node)!r} is not allowed")


def _get(name: str, names: Mapping[str, Value]) -> Value:
    if name not in names:
        raise ValueError(f"unknown name {name!r}; known: {', '.join(sorted(names))}")
    value = names[name]
    return value if isinstance(value, np.ndarray | Mapping) else float(value)


def _number(node: ast.expr, names: Mapping[str, Value]) -> float:
    value = _evaluate(node, names)
    if not isinstance(value, float):
        raise ValueError(f"arithmetic is for numbers; {ast.unparse(node)!r} is none")
    return value
