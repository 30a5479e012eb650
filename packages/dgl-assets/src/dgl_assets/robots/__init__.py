"""Robots: two UR10e arms with Shadow Hands as facts, shapes and URDF, and those of a user's own."""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

if TYPE_CHECKING:
    from dgl_assets.robots.arm import UR10E as UR10E
    from dgl_assets.robots.collision import CollisionShape as CollisionShape
    from dgl_assets.robots.gains import JointGains as JointGains
    from dgl_assets.robots.hand import HAND_MASS as HAND_MASS
    from dgl_assets.robots.hand import HAND_TIPS as HAND_TIPS
    from dgl_assets.robots.hand import SHADOW_HAND as SHADOW_HAND
    from dgl_assets.robots.layout import HAND_POSES as HAND_POSES
    from dgl_assets.robots.robot import DEFAULT_ROBOT as DEFAULT_ROBOT
    from dgl_assets.robots.robot import SHADOW_HAND_PART as SHADOW_HAND_PART
    from dgl_assets.robots.robot import UR10E_ARM as UR10E_ARM
    from dgl_assets.robots.robot import ArmPart as ArmPart
    from dgl_assets.robots.robot import HandPart as HandPart
    from dgl_assets.robots.robot import Robot as Robot
    from dgl_assets.robots.tree import DEFAULT_LEFT_BASE as DEFAULT_LEFT_BASE
    from dgl_assets.robots.tree import DEFAULT_RIGHT_BASE as DEFAULT_RIGHT_BASE
    from dgl_assets.robots.tree import SIDES as SIDES
    from dgl_assets.robots.tree import BasePlacement as BasePlacement
    from dgl_assets.robots.tree import KinematicTree as KinematicTree
    from dgl_assets.robots.tree import Side as Side

__all__, __getattr__ = export_lazily(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
