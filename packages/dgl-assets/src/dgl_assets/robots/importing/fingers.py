"""Directions of fingers and palm of a hand, and its thumb: found from the tree, or given."""

import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dgl_assets.robots._frames import rotation_from_quaternion
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.tree import KinematicTree, TreeLink
from dgl_assets.robots.visual import LinkMeshes

AXES: dict[str, np.ndarray] = {
    f"{sign}{name}": (1 if sign == "+" else -1) * np.eye(3)[k]
    for k, name in enumerate("xyz")
    for sign in ("+", "-")
}
"""Directions by what is typed for them."""
CLEAR = 0.8
"""Cosine above which a direction counts as an axis of the hand's first link."""
_THUMB = re.compile(
    r"thumb|(^|[^a-z])th(base|proximal|hub|middle|distal|tip|j[0-9]|[^a-z]|$)", re.IGNORECASE
)
"""Names of a thumb's links and joints."""
THUMB_GAP = 0.008
"""Least distance by which the thumb begins nearer to the wrist than other fingers [m]."""


@dataclass(frozen=True, kw_only=True)
class Finger:
    """One finger: the joints that move it alone, and its tip."""

    joints: tuple[str, ...]
    """From the palm to the tip."""
    tip_link: str
    """Link that the last of them moves."""
    tip: np.ndarray
    """Fingertip [m], frame of that link, shape (3,)."""
    base: np.ndarray
    """Origin of the first joint [m], frame of the hand, all joints at rest, shape (3,)."""
    length: float
    """From there to the tip, joint by joint [m]."""


@dataclass(frozen=True, kw_only=True)
class HandFrame:
    """A hand that is understood."""

    fingers: tuple[Finger, ...]
    """The thumb first, then from the thumb's side on."""
    rotation: np.ndarray
    """Columns: directions of fingers, palm and their cross product in the hand, (3, 3)."""
    is_right: bool
    """The thumb is on the side of a right hand."""


def rest_positions(tree: KinematicTree) -> dict[str, float]:
    """Give every joint its value nearest to zero [rad or m]."""
    return {
        joint.name: float(np.clip(0.0, joint.lower, joint.upper))
        for joint in tree.joints
        if joint.axis is not None
    }


def understand_hand(
    tree: KinematicTree,
    meshes: LinkMeshes,
    *,
    fingers_axis: str | None = None,
    palm_axis: str | None = None,
    thumb: str | None = None,
) -> HandFrame:
    """Find out which way a hand is made.

    Args:
        tree: The hand.
        meshes: Files of its mesh shapes.
        fingers_axis: Direction of the straight fingers in the first link, such as "+z".
        palm_axis: Direction out of the palm.
        thumb: A link of the thumb.

    Raises:
        RobotImportError: If something cannot be told; the message says what to give.
    """
    found = _find_fingers(tree, meshes)
    rest = tree.compute_link_poses(rest_positions(tree))
    if fingers_axis is None:
        total = sum((_at(rest, f.tip_link, f.tip) - f.base for f in found), np.zeros(3))
        along = _snap(total, "the direction of the fingers", "--fingers-axis")
    else:
        along = parse_axis(fingers_axis)
    if palm_axis is None:
        closing = _closing_direction(tree, found)
        closing -= (closing @ along) * along
        palm = _snap(closing, "the side of the palm", "--palm-axis")
    else:
        palm = parse_axis(palm_axis)
    if abs(along @ palm) > 1e-9:
        raise RobotImportError(
            f"fingers and palm must be on different axes; got {along} and {palm}"
        )
    rotation = np.column_stack([along, palm, np.cross(along, palm)])
    thumb_finger = _choose_thumb(tree, found, along, thumb)
    others = [finger for finger in found if finger is not thumb_finger]
    middle = np.mean([finger.base for finger in others], axis=0)
    tip = _at(rest, thumb_finger.tip_link, thumb_finger.tip)
    # where thumb and fingers lie opposite of each other, the tip says more than the base
    lateral = float((0.5 * (thumb_finger.base + tip) - middle) @ rotation[:, 2])
    others.sort(
        key=lambda finger: -float(finger.base @ rotation[:, 2]) * (1 if lateral >= 0 else -1)
    )
    return HandFrame(fingers=(thumb_finger, *others), rotation=rotation, is_right=lateral >= 0)


def parse_axis(text: str) -> np.ndarray:
    """Read a direction such as "+z" or "-y"."""
    key = text if text[:1] in "+-" else f"+{text}"
    if key not in AXES:
        raise RobotImportError(f"a direction must be one of {', '.join(AXES)}; got {text[:20]!r}")
    return AXES[key]


def shape_points(shape: CollisionShape, files: Mapping[str, bytes]) -> np.ndarray:
    """Points whose hull is about a shape [m], frame of its link, shape (N, 3)."""
    if shape.kind == "mesh":
        import io

        import trimesh

        return np.asarray(
            trimesh.load_mesh(io.BytesIO(files[shape.mesh]), file_type="stl").vertices
        )
    r, h = shape.radius, shape.half_length + (shape.radius if shape.kind == "capsule" else 0.0)
    half = {"box": shape.half_size, "sphere": (r, r, r)}.get(shape.kind, (0.6 * r, 0.6 * r, h))
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    if shape.kind != "box":
        corners = np.vstack([corners, np.diag(half), -np.diag(half)])
    return corners @ rotation_from_quaternion(np.array(shape.wxyz)).T + np.array(shape.xyz)


def _find_fingers(tree: KinematicTree, meshes: LinkMeshes) -> list[Finger]:
    moving = {joint.child: joint for joint in tree.joints if joint.axis is not None}
    if not moving:
        raise RobotImportError("a hand must have moving joints; this file has none")
    parent = {joint.child: joint.parent for joint in tree.joints}

    def path(link: str) -> list[str]:
        """List the moved links from the root to a link."""
        links = [link]
        while links[-1] in parent:
            links.append(parent[links[-1]])
        return [name for name in reversed(links) if name in moving]

    ends = [link for link in moving if not any(link in path(other)[:-1] for other in moving)]
    paths = [path(end) for end in ends]
    if not 2 <= len(ends) <= 5:
        raise RobotImportError(
            f"a hand must have two to five fingers; found {len(ends)}: {ends[:8]}"
        )
    shared = set(paths[0]).intersection(*paths[1:])
    rest = tree.compute_link_poses(rest_positions(tree))
    fingers = []
    for end, links in zip(ends, paths, strict=True):
        own = [link for link in links if link not in shared]
        tip = _find_tip(tree, meshes, end)
        places = [rest[link][:3, 3] for link in own] + [_at(rest, end, tip)]
        length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        if length < 5e-3:
            raise RobotImportError(f"finger {end} has no length; its tip is not known")
        fingers.append(
            Finger(
                joints=tuple(moving[link].name for link in own),
                tip_link=end,
                tip=tip,
                base=places[0],
                length=length,
            )
        )
    return fingers


def _find_tip(tree: KinematicTree, meshes: LinkMeshes, end: str) -> np.ndarray:
    """Find the furthest point of the last link and links fixed to it; of frames their origin."""
    poses, points = {end: np.eye(4)}, []
    by_name: dict[str, TreeLink] = {link.name: link for link in tree.links}
    for joint in tree.joints:
        if joint.parent in poses:
            poses[joint.child] = poses[joint.parent] @ joint.joint_to_parent
    for link, T in poses.items():
        for shape in by_name[link].collision:
            points.append(shape_points(shape, meshes.files) @ T[:3, :3].T + T[:3, 3])
    if not points:
        points = [T[None, :3, 3] for T in poses.values()]
    every = np.concatenate(points)
    distance = np.linalg.norm(every, axis=1)
    near = every[distance > 0.9 * distance.max()]
    return near.mean(axis=0)


def _closing_direction(tree: KinematicTree, fingers: list[Finger]) -> np.ndarray:
    """Directions in which the tips move when every joint goes to the middle of its range."""
    rest = rest_positions(tree)
    half = dict(rest)
    own = {name for finger in fingers for name in finger.joints}
    for joint in tree.joints:
        if joint.name in own:
            half[joint.name] = float(np.clip((joint.lower + joint.upper) / 2, -1.2, 1.2))
    before, after = tree.compute_link_poses(rest), tree.compute_link_poses(half)
    moves = [_at(after, f.tip_link, f.tip) - _at(before, f.tip_link, f.tip) for f in fingers]
    return np.sum(moves, axis=0)


def _choose_thumb(
    tree: KinematicTree, fingers: list[Finger], along: np.ndarray, thumb: str | None
) -> Finger:
    if thumb is not None:
        chosen = [f for f in fingers if thumb in list_links(tree, f)]
        if not chosen:
            ends = ", ".join(f.tip_link for f in fingers)
            raise RobotImportError(
                f"no finger has the link {thumb[:60]!r}; the fingers end in {ends}"
            )
        return chosen[0]
    named = [
        finger
        for finger in fingers
        if any(_THUMB.search(name) for name in (*finger.joints, *list_links(tree, finger)))
    ]
    if len(named) == 1:
        return named[0]
    ranked = sorted(fingers, key=lambda f: float(f.base @ along))
    gap = float((ranked[1].base - ranked[0].base) @ along)
    if gap < THUMB_GAP:
        ends = ", ".join(f.tip_link for f in fingers)
        raise RobotImportError(
            f"which finger is the thumb cannot be told; give --thumb with one of its links ({ends})"
        )
    return ranked[0]


def list_links(tree: KinematicTree, finger: Finger) -> set[str]:
    """List the links of a finger: those that its joints move, and what is fixed to them."""
    links = {joint.child for joint in tree.joints if joint.name in finger.joints}
    for joint in tree.joints:
        if joint.axis is None and joint.parent in links:
            links.add(joint.child)
    return links


def _snap(direction: np.ndarray, what: str, option: str) -> np.ndarray:
    length = float(np.linalg.norm(direction))
    cosines = {name: float(axis @ direction) / max(length, 1e-12) for name, axis in AXES.items()}
    name = max(cosines, key=lambda key: cosines[key])
    if length < 5e-3 or cosines[name] < CLEAR:
        raise RobotImportError(
            f"{what} cannot be told from the joints; give {option} with one of {', '.join(AXES)}"
        )
    return AXES[name]


def _at(poses: Mapping[str, np.ndarray], link: str, point: np.ndarray) -> np.ndarray:
    T = poses[link]
    return T[:3, :3] @ point + T[:3, 3]
