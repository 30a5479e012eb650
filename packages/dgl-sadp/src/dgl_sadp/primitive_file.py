"""Primitives of a task as one safetensors file, and those that come with this package."""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from annotated_types import Len

from dgl_files.fields import check_value, decode_json
from dgl_files.tensors import open_tensors, write_tensors
from dgl_sadp.errors import CheckpointError
from dgl_sadp.primitive import HandModel, Primitive

__all__ = [
    "PRIMITIVES_FILE",
    "TaskPrimitives",
    "find_primitives",
    "load_primitives",
    "save_primitives",
]

PRIMITIVES_FILE = "primitives.safetensors"
"""Name of the file in the folder of a training."""
_KIND, _VERSION = "dgl_sadp.primitives", "2"
_MAX_BYTES = 2**24
_MODEL = tuple(each.name for each in dataclasses.fields(HandModel))
_TIMES = ("durations", "distances")
_Name = Annotated[str, Len(1, 64)]
_STAGES = dict[_Name, dict[_Name, list[_Name]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class TaskPrimitives:
    """Primitives of the stages of a task."""

    task: str
    """Environment id."""
    stages: Mapping[str, Primitive]
    """By name of the stage."""
    card: Mapping[str, Any] = field(default_factory=dict)
    """Record of the training: episodes, errors of recordings left out. Plain values."""


def save_primitives(path: Path, primitives: TaskPrimitives) -> None:
    """Write primitives; the file appears whole.

    Args:
        path: The file, ending in .safetensors; its folder is made.
        primitives: What to write.

    Raises:
        ValueError: If the path has another ending, or a number of the card is not finite.
    """
    arrays, stages = {}, {}
    for name, primitive in primitives.stages.items():
        stages[name] = {"anchors": list(primitive.anchors), "hands": sorted(primitive.hands)}
        for each in _TIMES:
            arrays[f"{name}.{each}"] = getattr(primitive, each)
        for side, model in primitive.hands.items():
            for each in _MODEL:
                arrays[f"{name}.{side}.{each}"] = getattr(model, each)
    arrays = {key: np.ascontiguousarray(a, dtype=np.float32) for key, a in arrays.items()}
    values = {"task": primitives.task, "stages": stages, "card": dict(primitives.card)}
    text = json.dumps(values, allow_nan=False)
    write_tensors(path, arrays, {"format": _KIND, "version": _VERSION, "values": text})


def load_primitives(path: Path) -> TaskPrimitives:
    """Read primitives.

    Raises:
        CheckpointError: If the file is missing, damaged, or holds something else.
    """
    with open_tensors(path, what="a file of primitives", error=CheckpointError) as file:
        file.check_format(_KIND)
        file.check_version(wanted=_VERSION)
        try:
            values = decode_json(file.metadata.get("values", ""))
            check_value("values", values, dict[str, Any])
            for name, hint in (("task", _Name), ("stages", _STAGES), ("card", dict[str, Any])):
                check_value(name, values.get(name), hint)
            shapes = {}
            for stage, parts in values["stages"].items():
                check_value(f"stages.{stage}", sorted(parts), list[str])
                if sorted(parts) != ["anchors", "hands"] or not parts["hands"]:
                    raise ValueError(f"stage {stage} must have anchors and hands")
                shapes |= _find_shapes(stage, parts, file.found)
        except ValueError as err:
            raise CheckpointError(f"{path}: its metadata are damaged: {err}") from err
        file.check_types(("F32",), max_bytes=_MAX_BYTES)
        file.check_shapes(shapes)
        arrays = {name: a.astype(float) for name, a in file.read(is_finite=True).items()}
    stages = {}
    for stage, parts in values["stages"].items():
        hands = {
            side: HandModel(**{each: arrays[f"{stage}.{side}.{each}"] for each in _MODEL})
            for side in parts["hands"]
        }
        times = {each: arrays[f"{stage}.{each}"] for each in _TIMES}
        stages[stage] = Primitive(anchors=tuple(parts["anchors"]), hands=hands, **times)
    return TaskPrimitives(task=values["task"], stages=stages, card=values["card"])


def _find_shapes(
    stage: str, parts: Mapping[str, list[str]], found: Mapping[str, tuple[tuple[int, ...], str]]
) -> dict[str, tuple[int, ...]]:
    """Derive the shapes of a stage's arrays from its anchors, and the sizes K and P from two."""
    anchors = len(parts["anchors"]) + 1
    shapes: dict[str, tuple[int, ...]] = {}
    for side in parts["hands"]:
        poses = found.get(f"{stage}.{side}.poses", ((0, 0), ""))[0]
        if len(poses) != 2 or poses[0] < 2:
            raise ValueError(f"poses of {stage} must have shape (K, P); got {poses}")
        knots, size = poses
        sizes: Mapping[str, tuple[int, ...]] = {
            "mean": (knots, 3),
            "level": (2, anchors + 1, knots),
            "height": (2 * anchors + len(parts["hands"]) + 1, knots),
            "turns": (knots, 3),
            "poses": (knots, size),
            "leverage": (2, anchors + 1, anchors + 1),
            "noise": (knots,),
        }
        shapes |= {f"{stage}.{side}.{each}": sizes[each] for each in _MODEL}
        shapes |= {f"{stage}.{each}": (knots - 1,) for each in _TIMES}
    return shapes


def find_primitives(task: str) -> Path:
    """Find the primitives of a task that come with this package.

    Raises:
        CheckpointError: If there are none; the message tells how to make some.
    """
    folder = resources.files("dgl_sadp") / "primitives"
    path = Path(str(folder / f"{task.partition('-')[0]}.safetensors"))
    if not path.is_file():
        raise CheckpointError(
            f"no primitives of {task} come with this package; collect ten episodes with `dgl "
            f"collect {task} --episodes 10 --out DIR`, and learn from them with `dgl train "
            f"primitive --data DIR/episodes --out PRIMITIVES`"
        )
    return path
