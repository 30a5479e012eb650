"""One expert demonstration of a task, held as data.

A demonstration marks points on one garment and says, stage by stage, what the hands do: where they go are formulas over
the points and over named places of the scene's objects, so that heights and distances follow from the garment at hand as
the paper describes. The files lie in `demonstrations/`.
"""

import dataclasses
import re
import typing
from collections.abc import Mapping
from importlib import resources

import numpy as np
import typeguard

from dgl_assets.props import make_prop
from dgl_assets.robots import SIDES
from dgl_collect.errors import DemonstrationError
from dgl_collect.formula import Value, check_formula
from dgl_collect.steps import (
    SEEN_NAMES,
    STEPS,
    Demonstration,
    Grasp,
    Look,
    Move,
    Stage,
    Step,
    Stretch,
)
from dgl_files.fields import decode_json
from dgl_tasks import get_task
from dgl_tasks.declaration import Task

FORMAT_VERSION = 2
_POINT = np.zeros(3)
GARMENT_NAMES = ("min", "max", "centre")
"""Corners and centre of what is seen of the garment: `garment.min.x` and so on in formulas."""
CONDITION_NAMES = ("round", "held", "skipped", "value")
"""What a stage's condition may name besides what its formulas may."""


def load_demonstration(task: str) -> Demonstration:
    """Load the demonstration of a task that comes with this package.

    Raises:
        DemonstrationError: If there is none, its file is not as it should be, or it does not fit the task.
    """
    stem = task.partition("-")[0]
    if not re.fullmatch(r"\w+", stem):
        raise DemonstrationError(
            f"task must be an environment id, such as FoldTops-v1; got {task!r}"
        )
    file = resources.files("dgl_collect") / "demonstrations" / f"{stem}.json"
    if not file.is_file():
        raise DemonstrationError(f"there is no demonstration of {task!r} (looked for {stem}.json)")
    source = f"{stem}.json"
    try:
        content = decode_json(file.read_bytes())
    except ValueError as err:
        raise DemonstrationError(f"{source}: {err}") from err
    demonstration = parse_demonstration(content, source=source)
    check_demonstration(demonstration, get_task(task), source=source)
    return demonstration


def parse_demonstration(content: Mapping, *, source: str) -> Demonstration:
    """Read a demonstration from its JSON object.

    Args:
        content: The decoded file; see `demonstrations/FoldTops.json`.
        source: Name of the file, for messages.

    Raises:
        DemonstrationError: Saying what is wrong and where.
    """
    try:
        content = dict(content)
        if content.pop("format") != FORMAT_VERSION:
            raise ValueError(f"format must be {FORMAT_VERSION}")
        points = {n: np.array(xyz, dtype=np.float64) for n, xyz in content.pop("points").items()}
        for name, xyz in points.items():
            if xyz.shape != (3,) or not np.isfinite(xyz).all():
                raise ValueError(f"point {name!r} must be three numbers; got {xyz.tolist()}")
        stages = tuple(_parse_stage(stage) for stage in content.pop("stages"))
        return _make(Demonstration, {**content, "points": points, "stages": stages})
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as err:
        what = f"missing {err}" if isinstance(err, KeyError) else str(err)
        raise DemonstrationError(f"{source}: {what}") from err


def check_demonstration(demonstration: Demonstration, task: Task, *, source: str) -> None:
    """Check that all that a demonstration names is there in its task.

    Raises:
        DemonstrationError: Saying which formula names what.
    """
    if demonstration.task != task.id:
        raise DemonstrationError(f"{source}: task must be {task.id!r}; got {demonstration.task!r}")
    names: dict[str, Value] = {
        "garment": dict.fromkeys(GARMENT_NAMES, _POINT),
        **{item.name: dict(make_prop(item.prop).landmarks) for item in task.objects},
        **demonstration.points,
    }
    try:
        if demonstration.garment.partition("/")[0] != task.category:
            raise ValueError(f"garment must be of {task.category}; got {demonstration.garment!r}")
        for name in task.success.landmarks:
            if name not in demonstration.points:
                raise ValueError(f"the points must have {name!r}, which the rule judges by")
        for stage in demonstration.stages:
            _check_stage(stage, names, demonstration.points)
    except ValueError as err:
        raise DemonstrationError(f"{source}: {err}") from err


def _check_stage(
    stage: Stage, names: Mapping[str, Value], points: Mapping[str, np.ndarray]
) -> None:
    known = dict(names)
    try:
        for grasp in stage.grasp.values():
            unknown = set(grasp.points) - set(points)
            if unknown:
                raise ValueError(f"unknown points {sorted(unknown)}; known: {sorted(points)}")
            for formula in grasp.at or ():
                check_formula(formula, known)
        if any(isinstance(step, Look) for step in stage.steps):
            known["now"] = dict.fromkeys((*GARMENT_NAMES, "left_hand", "right_hand"), _POINT)
        for name, formula in stage.definitions.items():
            check_formula(formula, known)
            known[name] = 1.0
        for step in stage.steps:
            if isinstance(step, Stretch):
                if len(stage.grasp) < len(SIDES):
                    raise ValueError(f"a stretch needs both hands; got {sorted(stage.grasp)}")
                known |= dict.fromkeys(SEEN_NAMES, 1.0)
            if isinstance(step, Move):
                for formulas in step.targets.values():
                    for formula in formulas:
                        check_formula(formula, known)
        if stage.when is not None:
            check_formula(stage.when, {**names, **dict.fromkeys(CONDITION_NAMES, 1.0)})
    except ValueError as err:
        raise ValueError(f"stage {stage.name!r}: {err}") from err


def _parse_stage(content: Mapping) -> Stage:
    content = dict(content)
    try:
        content["grasp"] = {side: _parse_grasp(g) for side, g in content.pop("grasp").items()}
        content["steps"] = tuple(_parse_step(step) for step in content.pop("steps"))
        return _make(Stage, content)
    except (KeyError, TypeError, ValueError, AttributeError) as err:
        what = f"missing {err}" if isinstance(err, KeyError) else str(err)
        raise ValueError(f"stage {content.get('name')!r}: {what}") from err


def _parse_grasp(content: object) -> Grasp:
    if isinstance(content, Mapping):
        at = {"at": _to_formulas(content["at"])} if "at" in content else {}
        return _make(Grasp, {**content, **at})
    return _make(Grasp, {"points": [content] if isinstance(content, str) else content})


def _to_formulas(content: object) -> object:
    """Make formulas of a list of formulas and numbers; anything else is for others to refuse."""
    return tuple(map(str, content)) if isinstance(content, list) else content


def _parse_step(content: Mapping) -> Step:
    content = dict(content)
    kind = content.pop("step")
    if kind not in STEPS:
        raise ValueError(f"a step is one of {sorted(STEPS)}; got {kind!r}")
    if STEPS[kind] is Move:
        content["targets"] = {
            side: _to_formulas(content.pop(side)) for side in SIDES if side in content
        }
    return _make(STEPS[kind], content)


def _make(kind: type, content: Mapping):
    """Make a dataclass of decoded JSON: lists become tuples; unknown and missing keys and other types are refused."""
    items = {item.name: item for item in dataclasses.fields(kind)}
    unknown = set(content) - set(items)
    if unknown:
        raise ValueError(f"{kind.__name__} has {', '.join(sorted(items))}; got {sorted(unknown)}")
    needed = [n for n, i in items.items() if i.default is i.default_factory is dataclasses.MISSING]
    missing = [name for name in needed if name not in content]
    if missing:
        raise ValueError(f"{kind.__name__} needs {missing}")
    made = {k: tuple(v) if isinstance(v, list) else v for k, v in content.items()}
    try:
        result = kind(**made)
    except TypeError:  # of a value that cannot be compared
        _check_types(kind, made)
        raise
    _check_types(kind, made)
    return result


def _check_types(kind: type, content: Mapping) -> None:
    types = typing.get_type_hints(kind)
    for name, value in content.items():
        try:
            typeguard.check_type(value, types[name])
        except typeguard.TypeCheckError as err:
            wanted = types[name].__name__ if isinstance(types[name], type) else str(types[name])
            raise ValueError(f"{name} must be {wanted}; got {value!r}") from err
