"""The other hand: every link frame, shape and picture reflected in its own x.

A rotation by the same angle about the reflected axis gives the reflected pose, so that equal joint
values give mirrored hands.
"""

from dataclasses import replace

import numpy as np

from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.importing.collision import mirror_hull
from dgl_assets.robots.importing.meshes import mirror_glb
from dgl_assets.robots.tree import REFLECTION, KinematicTree, TreeLink, reflect_joint
from dgl_assets.robots.visual import LinkMeshes


def reflect_tree(tree: KinematicTree) -> KinematicTree:
    """Reflect a tree; its mesh shapes name the files of `reflect_meshes`."""
    return KinematicTree(
        links=tuple(_reflect_link(link) for link in tree.links),
        joints=tuple(reflect_joint(joint) for joint in tree.joints),
    )


def reflect_meshes(meshes: LinkMeshes) -> LinkMeshes:
    """Reflect the files of a part."""
    return LinkMeshes(
        files={
            mirrored_name(name): (mirror_glb if name.endswith(".glb") else mirror_hull)(data)
            for name, data in meshes.files.items()
        },
        by_link={
            link: tuple(mirrored_name(name) for name in names)
            for link, names in meshes.by_link.items()
        },
    )


def mirrored_name(name: str) -> str:
    """Name of the reflection of a file, and back."""
    prefix = "mirrored_"
    return name.removeprefix(prefix) if name.startswith(prefix) else prefix + name


def _reflect(T: np.ndarray) -> np.ndarray:
    return REFLECTION @ T @ REFLECTION


def _reflect_link(link: TreeLink) -> TreeLink:
    S = REFLECTION[:3, :3]
    return replace(
        link,
        inertial_to_link=_reflect(link.inertial_to_link),
        inertia=S @ link.inertia @ S,
        collision=tuple(_reflect_shape(shape) for shape in link.collision),
    )


def _reflect_shape(shape: CollisionShape) -> CollisionShape:
    if shape.kind == "mesh":
        return replace(shape, mesh=mirrored_name(shape.mesh))
    x, y, z = shape.xyz
    w, a, b, c = shape.wxyz
    return replace(shape, xyz=(-x, y, z), wxyz=(w, a, -b, -c))
