"""Write robots as URDF files with their meshes into content-addressed folders."""

import hashlib
import logging
import shutil
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from dgl_assets.robots._frames import rotation_from_quaternion, rpy_from_rotation, transform
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.tree import KinematicTree, TreeJoint, TreeLink
from dgl_assets.robots.visual import LinkMeshes

logger = logging.getLogger(__name__)

FRAME_MASS = 1e-4
"""Mass [kg] written for pure frames: a physics engine gives a link without mass a kilogram."""
FRAME_INERTIA = 1e-8
"""Inertia [kg m^2] written for pure frames."""


def write_robot(
    directory: Path | str, name: str, tree: KinematicTree, meshes: LinkMeshes | None
) -> Path:
    """Write a robot into `directory/<name>-<hash>/` by renaming a finished folder into place.

    Args:
        directory: Folder that holds generated robots; made when missing.
        name: Name of the robot and its file.
        tree: Its links and joints.
        meshes: Its meshes; None for neither pictures nor collision shapes.

    Returns:
        Path of the URDF; its meshes lie in `meshes/` beside it.
    """
    directory = Path(directory)
    text = make_urdf_text(name, tree, meshes)
    digest = hashlib.sha256(text.encode())
    files = {} if meshes is None else meshes.files
    for file_name in sorted(files):
        digest.update(file_name.encode())
        digest.update(files[file_name])
    folder = directory / f"{name}-{digest.hexdigest()[:16]}"
    path = folder / f"{name}.urdf"
    if path.is_file():
        return path

    directory.mkdir(parents=True, exist_ok=True)
    temporary = Path(tempfile.mkdtemp(prefix=f".{name}-", dir=directory))
    try:
        temporary.chmod(0o755)
        (temporary / path.name).write_text(text, encoding="utf-8")
        (temporary / "meshes").mkdir()
        for file_name, data in files.items():
            (temporary / "meshes" / file_name).write_bytes(data)
        try:
            temporary.rename(folder)
        except OSError:
            # Another process finished the same content first; anything else is a real failure.
            if not path.is_file():
                raise
        else:
            logger.info("wrote %s", path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return path


def make_urdf_text(name: str, tree: KinematicTree, meshes: LinkMeshes | None) -> str:
    """Give the text of a URDF whose meshes lie in `meshes/` beside it; see `write_robot`."""
    robot = ET.Element("robot", name=name)
    for link in tree.links:
        _add_link(robot, link, meshes)
    for joint in tree.joints:
        _add_joint(robot, joint)
    ET.indent(robot)
    return ET.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def _numbers(*values: float) -> str:
    # Adding zero turns -0.0 into 0.0, so that equal robots have equal text.
    return " ".join(f"{float(v) + 0.0:.9g}" for v in values)


def _add_origin(parent: ET.Element, T: np.ndarray) -> None:
    rpy = rpy_from_rotation(T[:3, :3])
    ET.SubElement(parent, "origin", xyz=_numbers(*T[:3, 3]), rpy=_numbers(*rpy))


def _add_link(robot: ET.Element, link: TreeLink, meshes: LinkMeshes | None) -> None:
    element = ET.SubElement(robot, "link", name=link.name)
    inertial = ET.SubElement(element, "inertial")
    _add_origin(inertial, link.inertial_to_link)
    is_frame = link.mass == 0.0
    ET.SubElement(inertial, "mass", value=_numbers(FRAME_MASS if is_frame else link.mass))
    inertia = FRAME_INERTIA * np.eye(3) if is_frame else link.inertia
    names = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2)}
    names["iyz"] = (1, 2)
    ET.SubElement(inertial, "inertia", {key: _numbers(inertia[ij]) for key, ij in names.items()})
    if meshes is None:
        return
    for file_name in meshes.by_link.get(link.name, ()):
        visual = ET.SubElement(element, "visual")
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", filename=f"meshes/{file_name}")
    for shape in link.collision:
        _add_collision(element, shape)


def _add_collision(element: ET.Element, shape: CollisionShape) -> None:
    collision = ET.SubElement(element, "collision")
    _add_origin(collision, transform(shape.xyz, rotation_from_quaternion(np.array(shape.wxyz))))
    geometry = ET.SubElement(collision, "geometry")
    if shape.kind == "box":
        ET.SubElement(geometry, "box", size=_numbers(*(2 * h for h in shape.half_size)))
    elif shape.kind == "sphere":
        ET.SubElement(geometry, "sphere", radius=_numbers(shape.radius))
    elif shape.kind == "mesh":
        ET.SubElement(geometry, "mesh", filename=f"meshes/{shape.mesh}")
    else:
        # Capsules are not in the URDF standard, but read by SAPIEN, Isaac and MuJoCo; their length
        # excludes the caps.
        size = {"radius": _numbers(shape.radius), "length": _numbers(2 * shape.half_length)}
        ET.SubElement(geometry, shape.kind, size)


def _add_joint(robot: ET.Element, joint: TreeJoint) -> None:
    kind = "fixed" if joint.axis is None else joint.kind
    element = ET.SubElement(robot, "joint", name=joint.name, type=kind)
    _add_origin(element, joint.joint_to_parent)
    ET.SubElement(element, "parent", link=joint.parent)
    ET.SubElement(element, "child", link=joint.child)
    if joint.axis is not None:
        ET.SubElement(element, "axis", xyz=_numbers(*joint.axis))
        limits = {"lower": joint.lower, "upper": joint.upper, "effort": joint.effort}
        limits["velocity"] = joint.speed
        ET.SubElement(element, "limit", {key: _numbers(value) for key, value in limits.items()})
