"""One expert demonstration of a task, held as data and retargeted to any garment.

A demonstration marks points on one garment and says, stage by stage, where the hands that grasp
them go: waypoints as formulas over the points, so that heights and distances follow from the
garment at hand as the paper describes. The files lie in `demonstrations/`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources

import numpy as np

from dgl_assets.robots import HAND_POSES, SIDES, Side
from dgl_collect.errors import DemonstrationError
from dgl_collect.formula import evaluate_formula

FORMAT_VERSION = 1


SEEN_NAMES = ("half_span", "hanging")
"""What is seen of a garment that has been stretched between the hands, by its name in formulas [m]: half the
distance of the hands, and how far it hangs below them. The stage's definitions say what to expect."""


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """Both hands move apart until what hangs between them is seen to be taut."""

    sag: float
    """How far the upper edge may hang below the hands midway between them [m]."""
    step: float
    """How much farther each hand moves at a time [m]."""
    at_most: float
    """How much farther each hand moves in all [m]."""
    spacing: float
    """As in `Waypoint`."""

    def __post_init__(self) -> None:
        for name in ("sag", "step", "at_most", "spacing"):
            if not 0 < getattr(self, name) < np.inf:
                raise ValueError(f"{name} of a stretch must be positive; got {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """Where the grasp points of the working hands go next: formulas for x, y, z by hand."""

    targets: Mapping[Side, tuple[str, str, str]]
    spacing: float
    """Distance between samples of the line [m], one a control step; 0.01 is 0.6 m/s."""
    stretch: Stretch | None = None
    """What the hands do when they have arrived."""


@dataclass(frozen=True, kw_only=True)
class RetargetedWaypoint:
    """A waypoint on the garment at hand."""

    targets: Mapping[Side, np.ndarray]
    """Goal of the grasp point of each working hand [m], shape (3,), world frame."""
    spacing: float
    """As in `Waypoint`."""
    stretch: Stretch | None = None
    """As in `Waypoint`."""


@dataclass(frozen=True, kw_only=True)
class DemonstratedStage:
    """What the expert did in one stage."""

    name: str
    grasp_pose: str
    """Hand pose that grasps."""
    release_pose: str
    """Hand pose that lets go."""
    definitions: Mapping[str, str]
    """Numbers by name, as formulas over the points and the numbers before them."""
    waypoints: tuple[Waypoint, ...]


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """One demonstration on one garment."""

    task: str
    garment: str
    """Catalogue id of the garment it was given on."""
    points: Mapping[str, np.ndarray]
    """Marked places [m], shape (3,), frame of that garment lying flat."""
    stages: tuple[DemonstratedStage, ...]

    def get_stage(self, name: str) -> DemonstratedStage:
        """Return the stage of that name."""
        for stage in self.stages:
            if stage.name == name:
                return stage
        raise DemonstrationError(
            f"demonstration of {self.task} has no stage {name!r}; it has "
            f"{', '.join(s.name for s in self.stages)}"
        )


def retarget_waypoints(
    stage: DemonstratedStage,
    points: Mapping[str, np.ndarray],
    *,
    seen: Mapping[str, float] | None = None,
) -> list[RetargetedWaypoint]:
    """Compute a stage's waypoints for a garment.

    Args:
        stage: What was demonstrated.
        points: The demonstration's points as found on this garment [m], shape (3,), world frame.
        seen: What has been seen on the way, by `SEEN_NAMES`; it takes the place of the definition.

    Returns:
        The waypoints in order.

    Raises:
        DemonstrationError: If a formula cannot be evaluated.
    """
    names: dict[str, float | np.ndarray] = dict(points)
    try:
        for name, formula in stage.definitions.items():
            known = (seen or {}).get(name)
            names[name] = evaluate_formula(formula, names) if known is None else known
        return [
            RetargetedWaypoint(
                targets={
                    side: np.array([evaluate_formula(f, names) for f in formulas])
                    for side, formulas in waypoint.targets.items()
                },
                spacing=waypoint.spacing,
                stretch=waypoint.stretch,
            )
            for waypoint in stage.waypoints
        ]
    except ValueError as err:
        raise DemonstrationError(f"stage {stage.name!r}: {err}") from err


def load_demonstration(task: str) -> Demonstration:
    """Load the demonstration of a task that comes with this package.

    Raises:
        DemonstrationError: If there is none, or its file is not as it should be.
    """
    stem = task.partition("-")[0]
    file = resources.files("dgl_collect") / "demonstrations" / f"{stem}.json"
    if not file.is_file():
        raise DemonstrationError(f"there is no demonstration of {task!r} (looked for {stem}.json)")
    return parse_demonstration(json.loads(file.read_text(encoding="utf-8")), source=f"{stem}.json")


def parse_demonstration(content: Mapping, *, source: str) -> Demonstration:
    """Read a demonstration from its JSON object.

    Args:
        content: The decoded file; see `demonstrations/FoldTops.json`.
        source: Name of the file, for messages.

    Raises:
        DemonstrationError: Saying what is wrong and where.
    """
    try:
        if content["format"] != FORMAT_VERSION:
            raise ValueError(f"format must be {FORMAT_VERSION}; got {content['format']!r}")
        points = {name: np.array(xyz, dtype=np.float64) for name, xyz in content["points"].items()}
        for name, xyz in points.items():
            if xyz.shape != (3,) or not np.isfinite(xyz).all():
                raise ValueError(f"point {name!r} must be three numbers; got {xyz.tolist()}")
        return Demonstration(
            task=content["task"],
            garment=content["garment"],
            points=points,
            stages=tuple(_parse_stage(stage) for stage in content["stages"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError) as err:
        what = f"missing {err}" if isinstance(err, KeyError) else str(err)
        raise DemonstrationError(f"{source}: {what}") from err


def _parse_stage(content: Mapping) -> DemonstratedStage:
    waypoints = []
    for entry in content["waypoints"]:
        targets = {side: entry[side] for side in SIDES if side in entry}
        unknown = set(entry) - set(SIDES) - {"spacing", "stretch"}
        if unknown or not targets:
            raise ValueError(
                f"a waypoint has hands {SIDES}, spacing and stretch; got {sorted(entry)}"
            )
        for side, formulas in targets.items():
            if len(formulas) != 3:
                raise ValueError(f"{side} must have formulas for x, y, z; got {formulas}")
        spacing = float(entry.get("spacing", 0.01))
        if not spacing > 0:
            raise ValueError(f"spacing must be positive; got {spacing}")
        stretch = None
        if "stretch" in entry:
            stretch = Stretch(**entry["stretch"])
            missing = [n for n in SEEN_NAMES if n not in content.get("definitions", {})]
            if set(targets) != set(SIDES) or missing:
                raise ValueError(
                    "a stretch needs both hands and definitions of "
                    f"{' and '.join(SEEN_NAMES)}, for what to expect; got {sorted(entry)}"
                )
        waypoints.append(
            Waypoint(
                targets={s: tuple(f) for s, f in targets.items()}, spacing=spacing, stretch=stretch
            )
        )
    for key in ("grasp_pose", "release_pose"):
        if content[key] not in HAND_POSES:
            raise ValueError(f"{key} must be one of {sorted(HAND_POSES)}; got {content[key]!r}")
    return DemonstratedStage(
        name=content["name"],
        grasp_pose=content["grasp_pose"],
        release_pose=content["release_pose"],
        definitions=dict(content.get("definitions", {})),
        waypoints=tuple(waypoints),
    )
