"""Links and joints are one tree: one root, no cycles, every name once."""

from collections import Counter
from collections.abc import Sequence

from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.raw import RawJoint, RawLink, RawRobot


def order_tree(
    name: str, links: Sequence[RawLink], joints: Sequence[RawJoint], *, source: str
) -> RawRobot:
    """Check that links and joints are a tree, and put parents before their children.

    Args:
        name: Name of the robot.
        links: All links.
        joints: All joints.
        source: Name of the file, for messages.

    Raises:
        RobotImportError: If a name is there twice or missing, or they are no tree.
    """
    for what, items in (("link", links), ("joint", joints)):
        name_, count = Counter(item.name for item in items).most_common(1)[0] if items else ("", 0)
        if count > 1:
            raise RobotImportError(
                f"{source}: {what} {name_} is there {count} times; names must be unique"
            )
    by_name = {link.name: link for link in links}
    names_of_joints = {joint.name for joint in joints}
    parent_joint: dict[str, RawJoint] = {}
    for joint in joints:
        for end in (joint.parent, joint.child):
            if end not in by_name:
                raise RobotImportError(
                    f"{source}, joint {joint.name}: there is no link {end[:60]!r}"
                )
        if joint.child in parent_joint:
            raise RobotImportError(
                f"{source}: link {joint.child} has two parents, by joints "
                f"{parent_joint[joint.child].name} "
                f"and {joint.name}; closed loops cannot be imported"
            )
        if joint.mimic is not None and joint.mimic not in names_of_joints:
            raise RobotImportError(
                f"{source}, joint {joint.name}: mimics {joint.mimic[:60]!r}, which does not exist"
            )
        parent_joint[joint.child] = joint
    roots = [link.name for link in links if link.name not in parent_joint]
    if not roots:
        raise RobotImportError(f"{source}: the joints form a cycle; there is no root link")
    if len(roots) > 1:
        raise RobotImportError(f"{source}: must have one root link; got {len(roots)}: {roots[:6]}")
    children: dict[str, list[RawJoint]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint)
    ordered_joints = _depth_first(roots[0], children)
    if len(ordered_joints) != len(joints):
        cut_off = sorted({j.child for j in joints} - {j.child for j in ordered_joints})
        raise RobotImportError(f"{source}: the joints form a cycle at links {cut_off[:6]}")
    ordered_links = (by_name[roots[0]], *(by_name[joint.child] for joint in ordered_joints))
    return RawRobot(name=name, links=ordered_links, joints=tuple(ordered_joints))


def take_subtree(robot: RawRobot, root: str) -> RawRobot:
    """Keep a link and what hangs on it.

    Raises:
        RobotImportError: If there is no such link.
    """
    names = [link.name for link in robot.links]
    if root not in names:
        raise RobotImportError(f"there is no link {root!r}; links: {', '.join(names[:40])}")
    kept, joints = {root}, []
    for joint in robot.joints:  # parents come first
        if joint.parent in kept:
            kept.add(joint.child)
            joints.append(joint)
    by_name = {link.name: link for link in robot.links}
    links = (by_name[root], *(by_name[joint.child] for joint in joints))
    return RawRobot(name=robot.name, links=links, joints=tuple(joints))


def drop_subtrees(robot: RawRobot, roots: Sequence[str]) -> RawRobot:
    """Leave out links with all that hangs on them."""
    dropped, joints = set(roots), []
    for joint in robot.joints:
        if joint.parent in dropped or joint.child in dropped:
            dropped.add(joint.child)
        else:
            joints.append(joint)
    links = tuple(link for link in robot.links if link.name not in dropped)
    return RawRobot(name=robot.name, links=links, joints=tuple(joints))


def _depth_first(root: str, children: dict[str, list[RawJoint]]) -> list[RawJoint]:
    """List the joints below a link, each finger's together, in the order of the file."""
    ordered: list[RawJoint] = []
    waiting = list(reversed(children.get(root, [])))
    while waiting:
        joint = waiting.pop()
        ordered.append(joint)
        waiting += reversed(children.get(joint.child, []))
    return ordered
