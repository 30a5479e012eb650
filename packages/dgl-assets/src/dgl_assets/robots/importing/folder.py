"""The folder of an imported robot: robot.json, one URDF for each part, and their meshes.

`robot.json` holds its kind, joints, home, poses, drives, grasp point, licence and origin. It may be
edited; everything that is read from it is checked.
"""

import json
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.importing.paths import read_bytes, read_json
from dgl_assets.robots._frames import (
    quaternion_from_rotation,
    rotation_from_quaternion,
    transform,
)
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.gains import JointGains
from dgl_assets.robots.importing.collision import convert_primitive
from dgl_assets.robots.importing.raw import RawLink, RawRobot, RawShape
from dgl_assets.robots.importing.read_urdf import read_urdf
from dgl_assets.robots.robot import ArmPart, HandPart
from dgl_assets.robots.tree import EE_LINK, SIDES, KinematicTree, Side, TreeLink
from dgl_assets.robots.urdf import FRAME_MASS, make_urdf_text
from dgl_assets.robots.visual import LinkMeshes

FORMAT = 1
META_FILE = "robot.json"
POSE_NAMES = ("open", "close", "pinch", "cradle", "smooth", "flat")
ARM_FILE = "arm.urdf"
HAND_FILES: dict[Side, str] = {side: f"hand_{side}.urdf" for side in SIDES}


def write_robot_folder(
    folder: Path,
    *,
    meta: Mapping[str, Any],
    arm: ArmPart | None,
    hand: HandPart | None,
) -> None:
    """Write the files of a robot into an empty folder.

    Args:
        folder: Folder to write into.
        meta: Kind, licence, origin, assumptions and the like, JSON-ready.
        arm: The arm, if it has one.
        hand: The hand, if it has one.
    """
    (folder / "meshes").mkdir()
    tree: dict[str, Any] = {"format": FORMAT, **meta}
    if arm is not None:
        tree["arm"] = _describe_arm(arm)
        _write_part(folder, ARM_FILE, arm.name, arm.tree, arm.load_meshes())
    if hand is not None:
        tree["hand"] = _describe_hand(hand)
        for side, name in HAND_FILES.items():
            _write_part(folder, name, hand.name, hand.trees[side], hand.load_meshes(side))
    text = json.dumps(tree, indent=2, ensure_ascii=False, allow_nan=False)
    (folder / META_FILE).write_text(text + "\n", encoding="utf-8")


def load_robot_folder(folder: Path) -> tuple[ArmPart | None, HandPart | None]:
    """Load an imported robot: its arm, its hand, or both.

    Raises:
        AssetNotFoundError: If there is none.
        AssetImportError: If its files are broken or contradict each other.
    """
    content = read_meta(folder)
    arm = hand = None
    try:
        if "arm" in content:
            arm = _load_arm(folder, content["arm"])
        if "hand" in content:
            hand = _load_hand(folder, content["hand"])
    except (ArithmeticError, AttributeError, KeyError, TypeError, ValueError) as err:
        what = f"{err} is missing" if isinstance(err, KeyError) else str(err)
        raise RobotImportError(f"{folder / META_FILE}: {what}") from err
    return arm, hand


def read_meta(folder: Path) -> dict[str, Any]:
    """Read `robot.json`.

    Raises:
        AssetNotFoundError: If there is none.
        AssetImportError: If it is broken or of another format.
    """
    path = folder / META_FILE
    if not path.is_file():
        raise AssetNotFoundError(f"there is no imported robot in {folder} (no {META_FILE})")
    content = read_json(path)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise RobotImportError(f"{path} is not of format {FORMAT}")
    if not {"arm", "hand"} & set(content):
        raise RobotImportError(f"{path} describes neither an arm nor a hand")
    return content


# Writing -------------------------------------------------------------------------------------


def _write_part(
    folder: Path, file: str, name: str, tree: KinematicTree, meshes: LinkMeshes
) -> None:
    (folder / file).write_text(make_urdf_text(name, tree, meshes), encoding="utf-8")
    for mesh, data in meshes.files.items():
        (folder / "meshes" / mesh).write_bytes(data)


def _describe_arm(arm: ArmPart) -> dict[str, Any]:
    names = arm.tree.moving_joint_names
    return {
        "joints": list(names),
        "home": {side: _named(names, arm.home[side]) for side in SIDES},
        "parked": {side: _named(names, arm.parked[side]) for side in SIDES},
        "gains": {n: asdict(g) for n, g in zip(names, arm.gains, strict=True)},
    }


def _describe_hand(hand: HandPart) -> dict[str, Any]:
    names = hand.trees["right"].moving_joint_names
    return {
        "joints": list(names),
        "poses": {pose: _named(names, values) for pose, values in hand.poses.items()},
        "grasp_point": list(hand.grasp_point),
        "mounts": {
            side: {
                "xyz": hand.mounts[side][:3, 3].tolist(),
                "wxyz": quaternion_from_rotation(hand.mounts[side][:3, :3]).tolist(),
            }
            for side in SIDES
        },
        "ground_links": sorted(hand.ground_links),
        "thumb_links": sorted(hand.thumb_links),
        "gains": {n: asdict(g) for n, g in zip(names, hand.gains, strict=True)},
    }


def _named(names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {name: round(float(v), 6) for name, v in zip(names, values, strict=True)}


# Reading -------------------------------------------------------------------------------------


def _load_arm(folder: Path, content: Mapping[str, Any]) -> ArmPart:
    tree, load = _load_part(folder, ARM_FILE)
    if tree.links[-1].name != EE_LINK:
        raise ValueError(f"the last link of {ARM_FILE} must be {EE_LINK!r}")
    return ArmPart(
        name=folder.name,
        tree=tree,
        home={side: read_positions(tree, content["home"][side], "home") for side in SIDES},
        parked={side: read_positions(tree, content["parked"][side], "parked") for side in SIDES},
        gains=_read_gains(tree, content["gains"]),
        load_meshes=load,
    )


def _load_hand(folder: Path, content: Mapping[str, Any]) -> HandPart:
    parts = {side: _load_part(folder, HAND_FILES[side]) for side in SIDES}
    left, right = (parts[side][0] for side in SIDES)
    if left.moving_joint_names != right.moving_joint_names:
        raise ValueError("both hands must have the same joints in the same order")
    missing = sorted(set(POSE_NAMES) - set(content["poses"]))
    if missing:
        raise ValueError(f"poses must have {', '.join(POSE_NAMES)}; missing {missing}")
    x, y, z = (_finite(v, "grasp_point") for v in content["grasp_point"])
    links = {link.name for link in right.links}
    thumb = content.get("thumb_links", [])  # older files have none
    for key, named in (("ground_links", content["ground_links"]), ("thumb_links", thumb)):
        unknown = sorted(set(named) - links)
        if unknown:
            raise ValueError(f"{key} must be links of the hand; got {unknown}")
    return HandPart(
        name=folder.name,
        trees={side: parts[side][0] for side in SIDES},
        mounts={side: _read_mount(content["mounts"][side]) for side in SIDES},
        poses={
            name: read_positions(right, values, f"pose {name}")
            for name, values in content["poses"].items()
        },
        grasp_point=(x, y, z),
        ground_links=frozenset(content["ground_links"]),
        thumb_links=frozenset(thumb),
        gains=_read_gains(right, content["gains"]),
        load_meshes=lambda side: parts[side][1](),
    )


def read_positions(tree: KinematicTree, values: Mapping[str, Any], what: str) -> np.ndarray:
    """Read joint values by name.

    Args:
        tree: Whose joints they are.
        values: Numbers [rad or m] by joint.
        what: For messages.

    Returns:
        Values in the order of the tree, shape (n,).

    Raises:
        ValueError: If a joint is missing, unknown, or outside of its limits.
    """
    names = tree.moving_joint_names
    if not isinstance(values, Mapping):
        raise ValueError(f"{what} must map joints to values; got {reprlib.repr(values)}")
    if set(values) != set(names):
        raise ValueError(
            f"{what} must name every joint; missing {sorted(set(names) - set(values))[:6]}, "
            f"unknown {sorted(set(values) - set(names))[:6]}"
        )
    joints = {joint.name: joint for joint in tree.joints}
    result = []
    for name in names:
        value, joint = _finite(values[name], f"{what}, {name}"), joints[name]
        if not joint.lower - 1e-4 <= value <= joint.upper + 1e-4:
            raise ValueError(
                f"{what}: {name} must be within {joint.lower:.4f} to {joint.upper:.4f}; got "
                f"{value:.4f}"
            )
        result.append(float(np.clip(value, joint.lower, joint.upper)))
    array = np.array(result)
    array.setflags(write=False)
    return array


def _read_gains(tree: KinematicTree, content: Mapping[str, Any]) -> tuple[JointGains, ...]:
    names = [field.name for field in fields(JointGains)]
    gains = []
    for joint in tree.moving_joint_names:
        values = {key: _finite(content[joint][key], f"gains of {joint}") for key in names}
        if min(values.values()) < 0.0 or values["stiffness"] == 0.0:
            raise ValueError(f"gains of {joint} must be positive; got {values}")
        gains.append(JointGains(**values))
    return tuple(gains)


def _read_mount(content: Mapping[str, Any]) -> np.ndarray:
    xyz = [_finite(v, "mount") for v in content["xyz"]]
    wxyz = np.array([_finite(v, "mount") for v in content["wxyz"]])
    if len(xyz) != 3 or wxyz.shape != (4,) or abs(np.linalg.norm(wxyz) - 1.0) > 1e-3:
        raise ValueError(f"a mount must have xyz and a unit quaternion wxyz; got {dict(content)}")
    return transform((xyz[0], xyz[1], xyz[2]), rotation_from_quaternion(wxyz))


def _finite(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise ValueError(f"{what} must be a finite number; got {reprlib.repr(value)}")
    return float(value)


def _load_part(folder: Path, file: str) -> tuple[KinematicTree, Callable[[], LinkMeshes]]:
    raw = read_urdf(folder / file)
    shown = {link.name: tuple(_mesh_name(s) for s in link.visuals) for link in raw.links}
    hulls = [_mesh_name(s) for link in raw.links for s in link.collisions if s.kind == "mesh"]
    load = partial(_read_files, folder / "meshes", {k: v for k, v in shown.items() if v}, hulls)
    return _to_tree(raw), load


def _read_files(folder: Path, by_link: dict[str, tuple[str, ...]], hulls: list[str]) -> LinkMeshes:
    names = {name for files in by_link.values() for name in files} | set(hulls)
    return LinkMeshes(files={n: read_bytes(folder / n) for n in sorted(names)}, by_link=by_link)


def _mesh_name(shape: RawShape) -> str:
    if shape.path is None or shape.path.parent.name != "meshes":
        raise ValueError("pictures of an imported robot must be files in meshes/")
    return shape.path.name


def _to_tree(raw: RawRobot) -> KinematicTree:
    links = tuple(
        TreeLink(
            name=link.name,
            mass=0.0 if link.mass <= FRAME_MASS else link.mass,
            inertial_to_link=link.inertial_to_link,
            inertia=link.inertia,
            collision=tuple(_to_shape(link, shape) for shape in link.collisions),
        )
        for link in raw.links
    )
    for joint in raw.joints:
        if joint.is_endless:
            raise ValueError(f"joint {joint.name} must have limits")
    return KinematicTree(links=links, joints=raw.joints)


def _to_shape(link: RawLink, shape: RawShape) -> CollisionShape:
    if shape.kind == "mesh":
        return CollisionShape(link=link.name, kind="mesh", mesh=_mesh_name(shape))
    return convert_primitive(link.name, shape, is_kept=True)
