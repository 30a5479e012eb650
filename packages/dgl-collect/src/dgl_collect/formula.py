"""Formulas of demonstrations: arithmetic over named points, without `eval`."""

import ast
import operator
from collections.abc import Callable, Mapping

import numpy as np

Value = float | np.ndarray

_BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_AXES = {"x": 0, "y": 1, "z": 2}


def _distance_xy(a: Value, b: Value) -> float:
    if not isinstance(a, np.ndarray) or not isinstance(b, np.ndarray):
        raise ValueError("distance_xy takes two points")
    return float(np.linalg.norm(a[:2] - b[:2]))


_FUNCTIONS: dict[str, Callable[..., float]] = {
    "min": min,
    "max": max,
    "abs": abs,
    "distance_xy": _distance_xy,
}


def evaluate_formula(text: str | float, names: Mapping[str, Value]) -> float:
    """Evaluate a formula of a demonstration.

    Formulas have numbers, `+ - * /`, names, coordinates of points (`left_cuff.x`) and the functions
    `min`, `max`, `abs` and `distance_xy(point, point)`, the horizontal distance.

    Args:
        text: The formula, or a number.
        names: Numbers, and points [m] of shape (3,), by name.

    Returns:
        Its value, in metres where its parts are.

    Raises:
        ValueError: If it is not such a formula, or names something unknown.
    """
    try:
        tree = ast.parse(str(text), mode="eval")
        value = _evaluate(tree.body, names)
    except SyntaxError as err:
        raise ValueError(f"formula must be an arithmetic expression; got {text!r}") from err
    except (ValueError, ZeroDivisionError, TypeError) as err:
        raise ValueError(f"formula {text!r} cannot be evaluated: {err}") from err
    if not isinstance(value, float):
        raise ValueError(f"formula must give a number; {text!r} gives a point")
    if not np.isfinite(value):
        raise ValueError(f"formula must be finite; {text!r} gives {value}")
    return value


def _evaluate(node: ast.expr, names: Mapping[str, Value]) -> Value:
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return float(node.value)
    if isinstance(node, ast.Name):
        if node.id not in names:
            raise ValueError(f"unknown name {node.id!r}; known: {', '.join(sorted(names))}")
        value = names[node.id]
        return value if isinstance(value, np.ndarray) else float(value)
    if isinstance(node, ast.Attribute) and node.attr in _AXES:
        point = _evaluate(node.value, names)
        if not isinstance(point, np.ndarray):
            raise ValueError(f"only points have a coordinate {node.attr!r}")
        return float(point[_AXES[node.attr]])
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        return -_evaluate(node.operand, names)
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        left, right = _evaluate(node.left, names), _evaluate(node.right, names)
        if isinstance(left, np.ndarray) or isinstance(right, np.ndarray):
            raise ValueError("arithmetic is for numbers; name a coordinate of the point")
        return float(_BINARY[type(node.op)](left, right))
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
        if node.func.id not in _FUNCTIONS:
            raise ValueError(
                f"unknown function {node.func.id!r}; known: {', '.join(sorted(_FUNCTIONS))}"
            )
        return float(_FUNCTIONS[node.func.id](*(_evaluate(a, names) for a in node.args)))
    raise ValueError(f"{ast.unparse(node)!r} is not allowed")
