"""Obstacles: objects that arms and hands must not pass through, such as a person."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dgl_assets.props import Prop
from dgl_assets.robots import SIDES, BasePlacement, Robot, Side
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.tree import KinematicTree
from dgl_tasks.rotations import to_rotation

__all__ = ["Obstacle", "RobotSpheres"]

_NEAR = 0.1
"""Distance from an obstacle's box beyond which distances are not computed [m]."""
_SPACING = 0.03
"""Least distance of the spheres in a shape [m]."""
_MESH_RADIUS = 0.01
"""Radius of the sphere that stands for a collision mesh, whose size is not at hand [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Obstacle:
    """An object where it stands now."""

    name: str
    prop: Prop
    pose: np.ndarray
    """xyz [m] and quaternion wxyz, shape (7,), world frame."""

    def compute_distance(self, points: np.ndarray) -> np.ndarray:
        """Compute signed distances of points [m], shape (N, 3), world frame.

        Returns:
            Distances [m], shape (N,), negative inside; 0.1 for points that are farther away.
        """
        local = to_rotation(self.pose[3:]).inv().apply(np.asarray(points) - self.pose[:3])
        low, high = self.prop.extent
        near = ((local > low - _NEAR) & (local < high + _NEAR)).all(axis=1)
        distances = np.full(len(local), _NEAR)
        if near.any():
            distances[near] = np.minimum(self.prop.compute_distance(local[near]), _NEAR)
        return distances


class RobotSpheres:
    """Spheres inside the forearm, the wrist and the hand of each arm."""

    def __init__(self, robot: Robot, bases: Mapping[Side, BasePlacement]) -> None:
        """Take the spheres from the robot's collision shapes.

        Args:
            robot: Whose arms and hands they are.
            bases: Placement of each arm's base.
        """
        self._robot = robot
        self._trees: dict[Side, KinematicTree] = {
            side: robot.build_side_tree(side, bases[side]) for side in SIDES
        }
        self._links: dict[Side, dict[str, np.ndarray]] = {}
        self.radii: dict[Side, np.ndarray] = {}
        """Radius of each sphere of a side [m], shape (M,)."""
        self._of_fingers: dict[Side, np.ndarray] = {}
        arm = robot.arm.tree
        moving = [joint for joint in arm.joints if joint.axis is not None]
        near = {arm.links[0].name, *(joint.child for joint in moving[:2])}
        for side, tree in self._trees.items():
            links = [item for item in tree.links if item.name.partition("_")[2] not in near]
            filled = {item.name: _fill(item.collision) for item in links if item.collision}
            self._links[side] = {name: centres for name, (centres, _) in filled.items()}
            self.radii[side] = np.concatenate([radii for _, radii in filled.values()])
            fingers = _find_fingers(tree)
            marks = [np.full(len(radii), n in fingers) for n, (_, radii) in filled.items()]
            self._of_fingers[side] = np.concatenate(marks)

    def compute_centres(self, side: Side, joints: np.ndarray) -> np.ndarray:
        """Compute the spheres' centres [m], shape (M, 3), world frame.

        Args:
            side: "left" or "right".
            joints: Positions of all joints of the robot [rad], shape (D,).
        """
        part = self._robot.joint_slice(side, "all")
        names = self._robot.joint_names[part]
        poses = self._trees[side].compute_link_poses(dict(zip(names, joints[part], strict=True)))
        return np.concatenate(
            [
                centres @ poses[name][:3, :3].T + poses[name][:3, 3]
                for name, centres in self._links[side].items()
            ]
        )

    def find_touched(
        self,
        side: Side,
        rows: np.ndarray,
        obstacles: Sequence[Obstacle],
        *,
        with_fingers: bool = True,
    ) -> tuple[str, float] | None:
        """Find the obstacle that a side enters deepest.

        Args:
            side: "left" or "right".
            rows: Joint positions [rad], shape (N, D).
            obstacles: The obstacles.
            with_fingers: Count the fingers, too.

        Returns:
            Name and depth [m]; None if the side enters none.
        """
        if not len(rows) or not obstacles:
            return None
        counted = np.flatnonzero(with_fingers | ~self._of_fingers[side])
        centres = np.concatenate([self.compute_centres(side, row)[counted] for row in rows])
        radii = np.tile(self.radii[side][counted], len(rows))
        depths = {
            item.name: float((radii - item.compute_distance(centres)).max()) for item in obstacles
        }
        name = max(depths, key=lambda key: depths[key])
        return (name, depths[name]) if depths[name] > 0.0 else None


def _find_fingers(tree: KinematicTree) -> set[str]:
    """Find the links beyond the last one from which all fingers start."""
    parents = {joint.child: joint.parent for joint in tree.joints}
    leaves = set(parents) - set(parents.values())
    chains = []
    for leaf in leaves:
        chain = [leaf]
        while chain[-1] in parents:
            chain.append(parents[chain[-1]])
        chains.append(chain)
    common = set(chains[0]).intersection(*chains)
    return {name for chain in chains for name in chain} - common


def _fill(shapes: Sequence[CollisionShape]) -> tuple[np.ndarray, np.ndarray]:
    """Fill the collision shapes of a link with spheres.

    Returns:
        Centres [m], shape (K, 3), frame of the link, and radii [m], shape (K,).
    """
    filled = [_fill_shape(shape) for shape in shapes]
    centres = np.concatenate([centres for centres, _ in filled])
    return centres, np.concatenate([np.full(len(each), radius) for each, radius in filled])


def _fill_shape(shape: CollisionShape) -> tuple[np.ndarray, float]:
    """Give the centres of a shape's spheres [m], shape (K, 3), and their radius [m]."""
    if shape.kind == "mesh":
        half, radius = np.zeros(3), _MESH_RADIUS
    elif shape.kind == "box":
        radius = min(shape.half_size)
        half = np.array(shape.half_size) - radius
    else:
        half, radius = np.array([0.0, 0.0, shape.half_length]), shape.radius
    spacing = max(2 * radius, _SPACING)
    axes = [np.linspace(-h, h, 1 + int(np.ceil(2 * h / spacing - 1e-9))) for h in half]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    centres = to_rotation(np.array(shape.wxyz)).apply(grid) + shape.xyz
    return centres, radius
