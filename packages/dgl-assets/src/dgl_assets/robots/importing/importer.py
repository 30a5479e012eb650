"""Importing an arm, a hand, or an arm with its hand from a URDF."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, get_args

import numpy as np

from dgl_assets.importing.errors import AssetImportError
from dgl_assets.importing.paths import read_json
from dgl_assets.importing.staging import stage_folder
from dgl_assets.robots._frames import transform
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.convert import ConvertedPart, convert
from dgl_assets.robots.importing.drives import choose_gains
from dgl_assets.robots.importing.fingers import (
    AXES,
    HandFrame,
    list_links,
    parse_axis,
    rest_positions,
    shape_points,
    understand_hand,
)
from dgl_assets.robots.importing.folder import POSE_NAMES, read_positions, write_robot_folder
from dgl_assets.robots.importing.home import find_home, find_parked
from dgl_assets.robots.importing.options import RobotImportOptions, RobotKind
from dgl_assets.robots.importing.poses import compute_grasp_point, take_over_poses
from dgl_assets.robots.importing.raw import RawJoint, RawRobot
from dgl_assets.robots.importing.read_urdf import read_foreign_urdf
from dgl_assets.robots.importing.reflect import reflect_meshes, reflect_tree
from dgl_assets.robots.importing.topology import drop_subtrees, take_subtree
from dgl_assets.robots.robot import ArmPart, HandPart
from dgl_assets.robots.tree import (
    EE_LINK,
    ROOT_LINK,
    SIDES,
    KinematicTree,
    Side,
    TreeJoint,
    make_frame_link,
)

KINDS: tuple[RobotKind, ...] = get_args(RobotKind)
TOOL_LINKS = ("tool0", "flange", "ee_link", "tool_link", "tcp")
"""Links that are taken for the end of an arm when there are several, by their usual names."""
_NAME = re.compile(r"[a-z0-9][a-z0-9_-]{0,39}")
HAND_LOAD = 4.0
"""Mass that an arm's drives are made for, about that of the Shadow Hand [kg]."""
RESERVED = ("ur10e", "shadow")
"""Names of what is built in."""


@dataclass(frozen=True, kw_only=True)
class RobotReport:
    """Facts of an imported robot."""

    name: str
    kind: RobotKind
    folder: Path
    joints: int
    """Moving joints of one side."""
    links: int
    """Links of one side."""
    collision_shapes: Mapping[str, int]
    """Number of collision shapes of one side by kind."""
    assumptions: tuple[str, ...]
    """Findings and assumptions."""


def import_robot(
    path: Path | str,
    *,
    name: str,
    out: Path | str,
    kind: RobotKind,
    options: RobotImportOptions | None = None,
    on_progress: Callable[[str], None] | None = None,
) -> RobotReport:
    """Import a robot into `out/name`, which appears whole or not at all.

    Args:
        path: URDF file.
        name: Name to use it by: lower-case letters, digits, "_" and "-".
        out: Folder of robots.
        kind: "arm", "hand", or "pair": an arm with its hand, in one file.
        options: Options of the import.
        on_progress: Called with the name of each link when its shapes are made.

    Returns:
        Facts of the robot.

    Raises:
        AssetImportError: In one line, with the fault and the remedy.
    """
    options = options or RobotImportOptions()
    path, out = Path(path), Path(out)
    if kind not in KINDS:
        raise RobotImportError(f"kind must be one of {KINDS}; got {kind!r}")
    if not _NAME.fullmatch(name) or name in RESERVED:
        raise RobotImportError(
            "a robot's name must be lower-case letters, digits, '_' and '-', at most 40, and none "
            "of "
            f"{RESERVED}; got {name[:60]!r}"
        )
    with stage_folder(out / name, overwrite=options.overwrite, marker="robot.json") as staging:
        try:
            maker = _Maker(name, options, on_progress)
            report = maker.make(path, kind)
            write_robot_folder(
                staging,
                meta={
                    "kind": kind,
                    "licence": options.licence,
                    "source": options.source or path.name,
                    "collision": options.collision,
                    "assumptions": list(report.assumptions),
                },
                arm=maker.arm,
                hand=maker.hand,
            )
        except AssetImportError:
            raise
        except (ValueError, np.linalg.LinAlgError) as err:
            raise RobotImportError(f"{path.name}: {err}") from err
    return RobotReport(**{**report.__dict__, "folder": out / name})


class _Maker:
    """Makes the parts of one import and notes what it assumes."""

    def __init__(
        self, name: str, options: RobotImportOptions, on_progress: Callable[[str], None] | None
    ) -> None:
        self._name, self._options, self._on_progress = name, options, on_progress
        self._notes: list[str] = []
        self._ee_rotation = np.eye(3)  # of a pair, by its hand
        self.arm: ArmPart | None = None
        self.hand: HandPart | None = None

    def make(self, path: Path, kind: RobotKind) -> RobotReport:
        options = self._options
        raw = read_foreign_urdf(path, options.packages)
        if options.root is not None:
            raw = take_subtree(raw, options.root)
        if kind == "arm":
            self.arm = self._make_arm(raw, options.ee_link, self._tool_rotations(), load=HAND_LOAD)
        elif kind == "hand":
            self.hand = self._make_hand(raw)
        else:
            mount = self._find_mount(raw)
            of_hand = take_subtree(raw, mount.child)
            self.hand = self._make_hand(of_hand, mount=mount.joint_to_parent)
            self.arm = self._make_arm(
                drop_subtrees(raw, [mount.child]),
                mount.parent,
                [self._ee_rotation],
                load=sum(link.mass for link in of_hand.links),
            )
        trees = [self.arm.tree] if self.arm else []
        trees += [self.hand.trees["right"]] if self.hand else []
        shapes = [shape.kind for tree in trees for link in tree.links for shape in link.collision]
        return RobotReport(
            name=self._name,
            kind=kind,
            folder=path,
            joints=sum(len(tree.moving_joint_names) for tree in trees),
            links=sum(len(tree.links) for tree in trees),
            collision_shapes={str(k): shapes.count(k) for k in sorted(set(shapes))},
            assumptions=tuple(self._notes),
        )

    def _find_mount(self, raw: RawRobot) -> RawJoint:
        """Find the joint between arm and hand of a pair."""
        wanted = self._options.hand_link
        if wanted is None:
            raise RobotImportError("a pair needs --hand-link, the first link of its hand")
        if self._options.ee_link is not None:
            raise RobotImportError(
                "--ee-link is for an arm; a pair's hand is fixed where its arm ends"
            )
        for joint in raw.joints:
            if joint.child == wanted and joint.axis is None:
                return joint
        raise RobotImportError(
            f"--hand-link must be a link that is fixed to the arm; got {wanted[:60]!r}"
        )

    # Arms ------------------------------------------------------------------------------------

    def _tool_rotations(self) -> list[np.ndarray]:
        """List axes of `ee` in the link of the tool, as columns: every way to turn the palm."""
        x = parse_axis(self._options.tool_axis)
        if self._options.tool_palm is not None:
            sides = [parse_axis(self._options.tool_palm)]
        else:  # -x of a tool along z, as UR has it, comes first
            sides = [y for y in AXES.values() if abs(x @ y) < 0.5]
            sides.sort(key=lambda y: float(y @ (1.0, 0.5, 0.25)))
        if any(abs(x @ y) > 0.5 for y in sides):
            raise RobotImportError("fingers and palm of a tool must be on different axes")
        return [np.column_stack([x, y, np.cross(x, y)]) for y in sides]

    def _make_arm(
        self, raw: RawRobot, ee_link: str | None, rotations: list[np.ndarray], *, load: float
    ) -> ArmPart:
        ee_link = ee_link or self._find_ee(raw)
        raw = self._trim_arm(raw, ee_link)
        part = convert(
            raw, self._options.collision, rename=_rename_reserved, on_link=self._on_progress
        )
        self._notes += part.assumptions
        count = len(part.tree.moving_joint_names)
        if not 6 <= count <= 12:
            raise RobotImportError(
                f"an arm must have 6 to 12 moving joints to hold a hand anywhere; {ee_link} is "
                f"moved by {count}"
            )
        trees = [_add_ee(part.tree, _rename_reserved(ee_link), R) for R in rotations]
        tree, home = self._choose_home(trees)
        meshes = part.meshes
        return ArmPart(
            name=self._name,
            tree=tree,
            home=home,
            parked={side: find_parked(tree, home[side], side) for side in SIDES},
            gains=choose_gains(tree, home["right"], is_hand=False, load=load),
            load_meshes=lambda: meshes,
        )

    def _choose_home(
        self, trees: list[KinematicTree]
    ) -> tuple[KinematicTree, dict[Side, np.ndarray]]:
        """Choose the mount whose home reaches most; a given home takes the first mount."""
        given = self._read_home(trees[0])
        if given is not None:
            return trees[0], given
        best: tuple[float, KinematicTree, dict[Side, np.ndarray]] | None = None
        for tree in trees:
            homes = {side: find_home(tree, side) for side in SIDES}
            left, right = homes["left"], homes["right"]
            if left is None or right is None:
                continue
            score = left.score + right.score
            # the usual way to mount a hand comes first; another must be clearly better
            if best is None or score > best[0] + 0.5:
                best = (score, tree, {"left": left.positions, "right": right.positions})
        if best is None:
            raise RobotImportError(
                "no home was found: the arm cannot hold the fingers forward with the palm down "
                "near its base; "
                "give --home with joint values, or another --tool-axis"
            )
        R = best[1].joints[-1].joint_to_parent[:3, :3]
        self._notes.append(
            f"the hand is mounted with fingers along {_name_axis(R[:, 0])} and palm towards "
            f"{_name_axis(R[:, 1])} "
            "of the tool; home was found by inverse kinematics"
        )
        return best[1], best[2]

    def _find_ee(self, raw: RawRobot) -> str:
        parents = {joint.parent for joint in raw.joints}
        moved = _moved_links(raw)
        ends = [link.name for link in raw.links if link.name not in parents and link.name in moved]
        usual = [link.name for link in raw.links if link.name in TOOL_LINKS and link.name in moved]
        if len(ends) == 1:
            chosen = ends[0]
        elif len(usual) == 1:
            chosen = usual[0]
        else:
            raise RobotImportError(
                "where the arm ends cannot be told; give --ee-link, one of "
                f"{', '.join(ends[:12]) or 'its links'}"
            )
        self._notes.append(f"the arm ends in link {chosen}")
        return chosen

    def _trim_arm(self, raw: RawRobot, ee_link: str) -> RawRobot:
        """Leave out what moves beside the chain, and what hangs on its end."""
        parent = {joint.child: joint for joint in raw.joints}
        if ee_link not in {link.name for link in raw.links}:
            raise RobotImportError(f"there is no link {ee_link[:60]!r} for --ee-link")
        chain, link = {ee_link}, ee_link
        while link in parent:
            link = parent[link].parent
            chain.add(link)
        dropped = [
            joint.child
            for joint in raw.joints
            if joint.child not in chain and (joint.axis is not None or joint.parent == ee_link)
        ]
        if dropped:
            self._notes.append(f"left out what hangs beside the arm: {', '.join(dropped[:8])}")
        return drop_subtrees(raw, dropped)

    def _read_home(self, tree: KinematicTree) -> dict[Side, np.ndarray] | None:
        if self._options.home is None:
            return None
        content = read_json(self._options.home)
        if not isinstance(content, dict) or set(content) != set(SIDES):
            raise RobotImportError(f"{self._options.home.name} must have left and right")
        return {side: read_positions(tree, content[side], f"home, {side}") for side in SIDES}

    # Hands -----------------------------------------------------------------------------------

    def _make_hand(self, raw: RawRobot, *, mount: np.ndarray | None = None) -> HandPart:
        """Make a hand; `mount` is its pose on the arm, shape (4, 4), in a file that has both."""

        def rename(name: str) -> str:
            if mount is None and not name.startswith(self._name):
                return f"{self._name}_{name}"
            return _rename_reserved(name)

        options = self._options
        part = convert(raw, options.collision, rename=rename, on_link=self._on_progress)
        self._notes += part.assumptions
        thumb = None if options.thumb is None else rename(options.thumb)
        frame = understand_hand(
            part.tree,
            part.meshes,
            fingers_axis=options.fingers_axis,
            palm_axis=options.palm_axis,
            thumb=thumb,
        )
        is_right = frame.is_right if options.side is None else options.side == "right"
        mirrored = ConvertedPart(
            tree=reflect_tree(part.tree), meshes=reflect_meshes(part.meshes), assumptions=()
        )
        right, left = (part, mirrored) if is_right else (mirrored, part)
        if mount is None:
            mount_of_file = self._choose_mount(part, frame)
        else:
            self._ee_rotation = mount[:3, :3] @ frame.rotation
            mount_of_file = transform((0, 0, 0), self._ee_rotation.T) @ mount
        if not is_right:
            frame = understand_hand(
                right.tree,
                right.meshes,
                fingers_axis=_reflect_axis(frame.rotation[:, 0]),
                palm_axis=_reflect_axis(frame.rotation[:, 1]),
                thumb=thumb,
            )
        self._note_hand(frame, is_right=is_right)
        # in `ee` the other hand is the reflection in z, across fingers and palm
        flipped = np.diag([1.0, 1.0, -1.0, 1.0]) @ mount_of_file @ np.diag([-1.0, 1.0, 1.0, 1.0])
        mounts: dict[Side, np.ndarray] = {
            "right": mount_of_file if is_right else flipped,
            "left": flipped if is_right else mount_of_file,
        }
        names = right.tree.moving_joint_names
        poses = {
            pose: np.array([values[name] for name in names])
            for pose, values in self._find_poses(right.tree, frame, rename).items()
        }
        grasp = options.grasp_point or compute_grasp_point(frame, mounts["right"])
        meshes = {"right": right.meshes, "left": left.meshes}
        moved = {name for finger in frame.fingers for name in finger.joints}
        return HandPart(
            name=self._name,
            trees={"right": right.tree, "left": left.tree},
            mounts=mounts,
            poses=poses,
            grasp_point=grasp,
            ground_links=_links_of_fingers_and_palm(right.tree, moved),
            thumb_links=frozenset(list_links(right.tree, frame.fingers[0])),
            gains=choose_gains(right.tree, poses["open"], is_hand=True),
            load_meshes=lambda side: meshes[side],
        )

    def _note_hand(self, frame: HandFrame, *, is_right: bool) -> None:
        names = ", ".join(finger.tip_link for finger in frame.fingers)
        which = "right" if is_right else "left"
        other = "left" if is_right else "right"
        self._notes.append(
            f"fingers along {_name_axis(frame.rotation[:, 0])}, palm towards "
            f"{_name_axis(frame.rotation[:, 1])}; "
            f"thumb first, the fingers end in {names}"
        )
        self._notes.append(f"the file has a {which} hand; the {other} one is its reflection")

    def _choose_mount(self, part: ConvertedPart, frame: HandFrame) -> np.ndarray:
        """Mount a hand so that its body begins at the flange."""
        offset = self._options.mount_offset
        if offset is None:
            offset = -_find_lowest(part, frame)
            self._notes.append(
                f"the hand's body begins at the flange: its first link is {offset:.3f} m before it"
            )
        if not abs(offset) <= 0.5:
            raise RobotImportError(f"--mount-offset must be within 0.5 m; got {offset:g}")
        return transform((offset, 0.0, 0.0), frame.rotation.T)

    def _find_poses(
        self, tree: KinematicTree, frame: HandFrame, rename: Callable[[str], str]
    ) -> dict[str, dict[str, float]]:
        poses = take_over_poses(tree, frame)
        if self._options.poses is None:
            self._notes.append(
                "hand poses are those of the Shadow Hand by the places of the fingertips"
            )
            return poses
        content: Any = read_json(self._options.poses)
        if not isinstance(content, dict) or not set(content) <= set(POSE_NAMES):
            raise RobotImportError(
                f"{self._options.poses.name} must have poses of {', '.join(POSE_NAMES)}"
            )
        for name, values in content.items():
            if not isinstance(values, dict):
                raise RobotImportError(f"pose {name} must be joint values by name")
            renamed = {rename(joint): value for joint, value in values.items()}
            array = read_positions(tree, renamed, f"pose {name}")
            poses[name] = dict(zip(tree.moving_joint_names, array.tolist(), strict=True))
        return poses


def _add_ee(tree: KinematicTree, link: str, ee_to_link: np.ndarray) -> KinematicTree:
    joint = TreeJoint(
        name="ee_joint",
        parent=link,
        child=EE_LINK,
        joint_to_parent=transform((0, 0, 0), ee_to_link),
    )
    return KinematicTree(
        links=(*tree.links, make_frame_link(EE_LINK)), joints=(*tree.joints, joint)
    )


def _rename_reserved(name: str) -> str:
    """Keep the names that this package gives itself free."""
    reserved = (EE_LINK, ROOT_LINK, "ee_joint", "base_joint", "hand_mount")
    return f"own_{name}" if name in reserved else name


def _reflect_axis(axis: np.ndarray) -> str:
    return _name_axis(axis * (-1, 1, 1))


def _name_axis(axis: np.ndarray) -> str:
    k = int(np.abs(axis).argmax())
    return ("+" if axis[k] > 0 else "-") + "xyz"[k]


def _moved_links(raw: RawRobot) -> set[str]:
    moved: set[str] = set()
    for joint in raw.joints:
        if joint.axis is not None or joint.parent in moved:
            moved.add(joint.child)
    return moved


def _find_lowest(part: ConvertedPart, frame: HandFrame) -> float:
    """Find the begin of the hand's body along the fingers [m], frame of its first link."""
    poses = part.tree.compute_link_poses(rest_positions(part.tree))
    lowest = inf
    for link in part.tree.links:
        T = poses[link.name]
        for shape in link.collision:
            points = shape_points(shape, part.meshes.files) @ T[:3, :3].T + T[:3, 3]
            lowest = min(lowest, float((points @ frame.rotation[:, 0]).min()))
    return 0.0 if lowest is inf else lowest


def _links_of_fingers_and_palm(tree: KinematicTree, finger_joints: set[str]) -> frozenset[str]:
    """List links that fingers move, links that fingers are attached to, and links fixed to them."""
    links = {joint.child for joint in tree.joints if joint.name in finger_joints}
    links |= {joint.parent for joint in tree.joints if joint.name in finger_joints}
    for joint in tree.joints:
        if joint.axis is None and joint.parent in links:
            links.add(joint.child)
    return frozenset(links)
