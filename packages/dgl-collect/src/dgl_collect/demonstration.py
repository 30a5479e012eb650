"""One expert demonstration of a task, as data.

A demonstration marks points on one garment and says, stage by stage, what the hands do. Targets are
formulas over the points and over named frames of the scene's objects, so that heights and distances
follow from the garment at hand, as in the paper. The files lie in `demonstrations/`.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from itertools import chain, combinations
from pathlib import Path
from typing import TypedDict

import numpy as np

from dgl_assets import AssetError, Garment, load_garment
from dgl_assets.props import make_prop
from dgl_collect.errors import DemonstrationError
from dgl_collect.formula import Value, check_formula
from dgl_collect.names import name_scene
from dgl_collect.parameters import check_used, fill_in
from dgl_collect.steps import (
    CONDITION_NAMES,
    GARMENT_NAMES,
    SEEN_NAMES,
    Demonstration,
    Follow,
    Look,
    Move,
    Stage,
    Step,
    Stretch,
    Via,
)
from dgl_files.fields import decode_json, from_plain, show
from dgl_files.whole import compute_checksum
from dgl_tasks import get_task
from dgl_tasks.declaration import Task
from dgl_tasks.tasks import find_declaration, find_demonstration

FOLDER = Path(__file__).parent / "demonstrations"
"""Demonstrations of this package's tasks."""
FORMAT_VERSION = 2
OFF_GARMENT = 0.05
"""A point further than this from the garment [m] is not on it."""
APART = 0.002
"""Points nearer to each other than this [m] are the same."""
_POINT = np.zeros(3)


def load_demonstration(task: str | Task, path: Path | None = None) -> Demonstration:
    """Load a demonstration of a task.

    Args:
        task: Environment id or declaration.
        path: A file; when None, the one beside the declaration or in this package.

    Raises:
        DemonstrationError: If there is none, the file is damaged, or it does not fit the task.
    """
    declared = task if isinstance(task, Task) else get_task(task)
    file = path or find_file(declared)
    if not file.is_file():
        raise DemonstrationError(f"there is no demonstration {file}")
    try:
        content = decode_json(file.read_text(encoding="utf-8"))
    except (ValueError, OSError) as err:
        raise DemonstrationError(f"{file.name}: {err}") from err
    demonstration = parse_demonstration(content, source=file.name)
    if demonstration.recordings is not None:
        recordings = str(file.absolute().parent / demonstration.recordings)
        demonstration = replace(demonstration, recordings=recordings)
    if file.parent == FOLDER:  # tests check the points of these
        _check_names(demonstration, declared, source=file.name)
    else:
        check_demonstration(demonstration, declared, source=file.name)
    return demonstration


def find_file(task: Task) -> Path:
    """Find the demonstration beside a declaration, or in this package.

    Raises:
        DemonstrationError: If there is none.
    """
    own = find_demonstration(task.id)
    file = own or FOLDER / f"{task.id.partition('-')[0]}.json"
    if not file.is_file():
        raise DemonstrationError(
            f"there is no demonstration of {task.id!r} (looked for {own or file.name})"
        )
    return file


class OwnFiles(TypedDict):
    """SHA-256 of one's own files of a task, in hexadecimal digits; empty for packaged ones."""

    declaration: str
    demonstration: str


def compute_own_checksums(task: Task, path: Path | None) -> OwnFiles:
    """Compute the checksums of one's own files of a task.

    Args:
        task: The declaration.
        path: File of the demonstration; when None, the one beside the declaration.
    """
    declaration, demonstration = find_declaration(task.id), path or find_demonstration(task.id)
    return {"declaration": _check(declaration), "demonstration": _check(demonstration)}


def _check(file: Path | None) -> str:
    return compute_checksum(file) if file is not None and file.is_file() else ""


def parse_demonstration(content: Mapping, *, source: str) -> Demonstration:
    """Make a demonstration of its JSON object, and check all that does not depend on the task.

    Args:
        content: The decoded file; see `demonstrations/FoldTops.json`.
        source: Name of the file, for messages.

    Raises:
        DemonstrationError: With the fault and its place in the file.
    """
    try:
        if not isinstance(content, Mapping) or content.get("format") != FORMAT_VERSION:
            found = content.get("format") if isinstance(content, Mapping) else content
            raise ValueError(f"format must be {FORMAT_VERSION}; got {show(found)}")
        fields = {key: value for key, value in content.items() if key != "format"}
        demonstration = from_plain(Demonstration, fill_in(fields))
        check_used(fields)
    except ValueError as err:
        raise DemonstrationError(f"{source}: {err}") from err
    return demonstration


def check_demonstration(demonstration: Demonstration, task: Task, *, source: str) -> None:
    """Check a demonstration against its task and its garment.

    Raises:
        DemonstrationError: If a formula uses an unknown name, the garment is not in the catalogue
            or of another category, or a point is not on it.
    """
    _check_names(demonstration, task, source=source)
    try:
        garment = load_demonstrated_garment(demonstration.garment)
        for name, xyz in demonstration.points.items():
            distance = float(np.linalg.norm(garment.vertices - xyz, axis=1).min())
            if distance > OFF_GARMENT:
                raise ValueError(
                    f"point {name!r} must be on {demonstration.garment}, in metres; "
                    f"got {xyz.tolist()}, {distance:.3g} m from it"
                )
        for (a, at_a), (b, at_b) in combinations(demonstration.points.items(), 2):
            if np.linalg.norm(at_a - at_b) < APART:
                raise ValueError(f"points {a!r} and {b!r} must differ; got {at_a.tolist()} twice")
    except (ValueError, AssetError) as err:
        raise DemonstrationError(f"{source}: {err}") from err


@lru_cache(maxsize=2)
def load_demonstrated_garment(garment_id: str) -> Garment:
    """Load the garment of a demonstration once; making one takes a second.

    Raises:
        AssetNotFoundError: If it is not in the catalogue.
    """
    return load_garment(garment_id)


def _check_names(demonstration: Demonstration, task: Task, *, source: str) -> None:
    """Check that all names in formulas and grasps exist, and have one meaning each."""
    objects = {item.name: make_prop(item.props[0]).landmarks for item in task.objects}
    points = demonstration.points
    names = {**demonstration.values, **name_scene(_POINT[None], objects, points)}
    try:
        if demonstration.task != task.id:
            raise ValueError(f"task must be {task.id!r}; got {show(demonstration.task)}")
        if demonstration.garment.partition("/")[0] != task.category:
            raise ValueError(
                f"garment must be of {task.category}; got {show(demonstration.garment)}"
            )
        if twice := set(objects) & {*points, *demonstration.parameters}:
            raise ValueError(
                f"points and parameters must not have the names of objects; got {sorted(twice)}"
            )
        for name in task.success.landmarks:
            if name not in points:
                raise ValueError(f"the points must have {name!r}, which the rule judges by")
        steps = [step for stage in demonstration.stages for step in stage.steps]
        if any(isinstance(s, Follow) for s in steps) and demonstration.recordings is None:
            raise ValueError("steps that follow recordings need the field 'recordings'")
        for stage in demonstration.stages:
            try:
                _check_stage(stage, names, points)
            except ValueError as err:
                raise ValueError(f"stage {stage.name!r}: {err}") from err
    except ValueError as err:
        raise DemonstrationError(f"{source}: {err}") from err


def _list_formulas(step: Step) -> list[str]:
    """List the formulas of places and turns of a step."""
    if isinstance(step, Move):
        return [*chain(*step.targets.values()), step.turn or "0"]
    if isinstance(step, Via):
        return [*chain(*chain(*step.targets.values())), *(step.towards or ())]
    return []


def _check_stage(
    stage: Stage, names: Mapping[str, Value], points: Mapping[str, np.ndarray]
) -> None:
    known = dict(names)
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
        if name in names:
            raise ValueError(f"definition {name!r} must not have the name of a point or an object")
        known[name] = 1.0
    for step in stage.steps:
        if isinstance(step, Stretch):
            known |= dict.fromkeys(SEEN_NAMES, 1.0)
        for formula in _list_formulas(step):
            check_formula(formula, known)
    if stage.when is not None:
        check_formula(stage.when, {**names, **dict.fromkeys(CONDITION_NAMES, 1.0)})
