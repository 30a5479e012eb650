"""Read URDF: every number and every reference is checked.

Read here and not by yourdfpy, which drops capsules, names neither link nor joint in its errors, and
whose rotations differ in the last bit from those of robots that were imported before.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.importing.bounds import check_count
from dgl_assets.importing.errors import AssetImportError
from dgl_assets.importing.guarded import call_reader
from dgl_assets.importing.paths import check_file, read_bytes, resolve_reference
from dgl_assets.robots._frames import rotation_about, transform
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.masses import NO_INERTIA
from dgl_assets.robots.importing.raw import (
    RawJoint,
    RawLink,
    RawRobot,
    RawShape,
    Rgba,
)
from dgl_assets.robots.importing.topology import order_tree

MAX_XML_BYTES = 16 * 2**20
MAX_LINKS = 400
MAX_MASS = 1e4
"""Largest mass of a link [kg]."""
MAX_NUMBER = 1e6
"""Largest other number of a file: efforts, speeds, moments, components of axes."""
_SIZES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
}  # numbers of each attribute
_SCALES = (1e-6, 1e4)  # of a mesh along an axis
_ROUNDING = 1e-6  # of the largest moment that the least may be negative
_NAME = re.compile(r"[A-Za-z0-9_.\-]{1,100}")
_KINDS = ("revolute", "continuous", "prismatic", "fixed")


def read_foreign_urdf(path: Path, packages: Mapping[str, Path]) -> RawRobot:
    """Read a URDF of unknown origin in a child process; arguments and errors as of `read_urdf`."""
    check_file(path)
    folders = {name: str(folder.absolute()) for name, folder in packages.items()}
    return call_reader(
        read_urdf_here, str(path.absolute()), folders, file=path.name, returns=RawRobot
    )


def read_urdf_here(file: str, folders: dict[str, str]) -> RawRobot:
    """Read a URDF; `read_foreign_urdf` calls this in the child process."""
    packages = {name: Path(folder) for name, folder in folders.items()}
    return read_urdf(Path(file), packages=packages)


def read_urdf(path: Path, *, packages: Mapping[str, Path] | None = None) -> RawRobot:
    """Read a URDF.

    Meshes must lie in the folder of the file or below, or in a folder of `packages` or below. A
    reference `package://NAME/...` without an entry in `packages` is looked up in the folders above
    the file: in the nearest one called NAME.

    Args:
        path: The file; xacro must have been expanded.
        packages: Folders by name of a ROS package.

    Raises:
        AssetImportError: In one line, with the place of the fault.
    """
    data = read_bytes(path)
    check_count(len(data), MAX_XML_BYTES, "bytes", path.name)
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise RobotImportError(
            f"{path.name} declares a document type or entities, which are not read; remove them"
        )
    try:
        robot = ET.fromstring(data)
    except (ET.ParseError, ValueError, LookupError) as err:
        raise RobotImportError(f"{path.name} is not valid XML: {err}") from err
    if robot.tag != "robot":
        raise RobotImportError(
            f"{path.name} must be a URDF, <robot>; its root is <{robot.tag[:60]}>"
        )
    if any("xacro" in element.tag for element in robot.iter()) or b"${" in data:
        raise RobotImportError(f"{path.name} is xacro; expand it first: xacro in.xacro > out.urdf")
    return _UrdfReader(path, robot, packages or {}).read()


class _UrdfReader:
    """Reads the elements of one file; messages name the link or joint."""

    def __init__(self, path: Path, robot: ET.Element, packages: Mapping[str, Path]) -> None:
        self._path, self._robot, self._packages = path, robot, packages
        self._where = "robot"
        self._colours: dict[str, Rgba] = {}

    def read(self) -> RawRobot:
        for material in self._robot.findall("material"):
            name, colour = material.get("name"), self._read_colour(material)
            if name and colour:
                self._colours[name] = colour
        links = [self._read_link(element) for element in self._robot.findall("link")]
        if not links:
            raise self._error("has no links")
        if len(links) > MAX_LINKS:
            raise self._error(f"has {len(links)} links; at most {MAX_LINKS} are read")
        joints = [self._read_joint(element) for element in self._robot.findall("joint")]
        name = self._robot.get("name") or self._path.stem
        return order_tree(name, links, joints, source=self._path.name)

    def _error(self, text: str) -> RobotImportError:
        where = "" if self._where == "robot" else f", {self._where}"
        return RobotImportError(f"{self._path.name}{where}: {text}")

    # Links -----------------------------------------------------------------------------------

    def _read_link(self, element: ET.Element) -> RawLink:
        self._where = "a link"
        name = self._read_name(element)
        self._where = f"link {name}"
        mass, T, inertia = self._read_inertial(element.find("inertial"))
        return RawLink(
            name=name,
            mass=mass,
            inertial_to_link=T,
            inertia=inertia,
            visuals=tuple(self._read_shape(e) for e in element.findall("visual")),
            collisions=tuple(self._read_shape(e) for e in element.findall("collision")),
        )

    def _read_inertial(self, element: ET.Element | None) -> tuple[float, np.ndarray, np.ndarray]:
        if element is None:
            return 0.0, np.eye(4), np.zeros((3, 3))
        T = self._read_origin(element)
        mass_element, moments = element.find("mass"), element.find("inertia")
        if mass_element is None or moments is None:
            raise self._error("its inertial must have mass and inertia")
        (mass,) = self._read_numbers(mass_element, "value", 1, most=MAX_MASS)
        if mass < 0.0:
            raise self._error(f"its mass must not be negative; got {mass:g}")
        xx, yy, zz, xy, xz, yz = (
            self._read_numbers(moments, key, 1)[0]
            for key in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        )
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        largest = float(np.abs(inertia).max())
        if mass == 0.0:
            return 0.0, np.eye(4), np.zeros((3, 3))
        if largest < NO_INERTIA:
            return mass, T, np.zeros((3, 3))
        moments_of_axes = np.linalg.eigvalsh(inertia)
        if moments_of_axes[0] < -_ROUNDING * largest:
            raise self._error(
                f"its inertia must be positive; its least moment is {moments_of_axes[0]:.3g}"
            )
        if moments_of_axes[2] > 1.5 * (moments_of_axes[0] + moments_of_axes[1]):
            raise self._error(
                "its inertia is of no body: one moment exceeds the other two together, "
                f"{np.array2string(moments_of_axes, precision=3)}"
            )
        return mass, T, inertia

    def _read_shape(self, element: ET.Element) -> RawShape:
        geometry = element.find("geometry")
        if geometry is None or len(geometry) != 1:
            raise self._error(f"its {element.tag} must have one geometry")
        shape = geometry[0]
        values: dict[str, Any] = {
            "kind": shape.tag,
            "shape_to_link": self._read_origin(element),
            "rgba": self._read_material(element),
        }
        if shape.tag == "mesh":
            scale = self._read_numbers(shape, "scale", 3, default=(1.0, 1.0, 1.0))
            if not all(_SCALES[0] <= abs(s) <= _SCALES[1] for s in scale):
                raise self._error(
                    f"the scale of a mesh must be {_SCALES[0]:g} to {_SCALES[1]:g} along each "
                    f"axis; got {scale}"
                )
            path = self._find_mesh(shape.get("filename", ""))
            return RawShape(**values, path=path, scale=(scale[0], scale[1], scale[2]))
        if shape.tag not in _SIZES:
            raise self._error(
                f"geometry must be box, cylinder, sphere, capsule or mesh; got {shape.tag[:40]!r}"
            )
        numbers = (self._read_numbers(shape, key, n) for key, n in _SIZES[shape.tag].items())
        size = tuple(number for several in numbers for number in several)
        if not all(1e-6 <= s <= 10.0 for s in size):
            raise self._error(f"sizes of a {shape.tag} must be within 1e-6 to 10 m; got {size}")
        return RawShape(**values, size=size)

    def _read_material(self, element: ET.Element) -> Rgba | None:
        material = element.find("material")
        if material is None:
            return None
        return self._read_colour(material) or self._colours.get(material.get("name", ""))

    def _read_colour(self, material: ET.Element) -> Rgba | None:
        colour = material.find("color")
        if colour is None:
            return None
        r, g, b, a = self._read_numbers(colour, "rgba", 4)
        if not all(0.0 <= c <= 1.0 for c in (r, g, b, a)):
            raise self._error(f"colours must be within 0 to 1; got {(r, g, b, a)}")
        return r, g, b, a

    def _find_mesh(self, reference: str) -> Path:
        if not reference:
            raise self._error("a mesh must have a filename")
        folder, text = self._path.parent, reference
        if reference.startswith("package://"):
            name, _, text = reference.removeprefix("package://").partition("/")
            if not _NAME.fullmatch(name) or set(name) == {"."}:
                raise self._error(
                    f"{reference[:120]!r} must name a package, package://NAME/PATH; got "
                    f"{name[:60]!r}"
                )
            folder = self._packages.get(name) or self._find_package(name)
        elif reference.startswith("file://"):
            raise self._error(f"{reference[:120]!r} is absolute; make it relative to the file")
        try:
            return resolve_reference(folder, text, named_by=f"{self._path.name}, {self._where}")
        except AssetImportError as err:
            raise RobotImportError(str(err)) from err

    def _find_package(self, name: str) -> Path:
        for folder in self._path.resolve().parents:
            if folder.name == name:
                return folder
        raise self._error(
            f"refers to package {name[:60]!r}, whose folder is not known; give it with --packages "
            "NAME FOLDER"
        )

    # Joints ----------------------------------------------------------------------------------

    def _read_joint(self, element: ET.Element) -> RawJoint:
        self._where = "a joint"
        name = self._read_name(element)
        self._where = f"joint {name}"
        kind = element.get("type", "")
        if kind not in _KINDS:
            raise self._error(f"its type must be one of {', '.join(_KINDS)}; got {kind[:40]!r}")
        ends = []
        for tag in ("parent", "child"):
            end = element.find(tag)
            if end is None or not end.get("link"):
                raise self._error(f"must have a {tag} link")
            ends.append(end.get("link", ""))
        values: dict[str, Any] = {
            "name": name,
            "parent": ends[0],
            "child": ends[1],
            "joint_to_parent": self._read_origin(element),
            "mimic": None if (mimic := element.find("mimic")) is None else mimic.get("joint", ""),
        }
        axis = np.array([1.0, 0.0, 0.0])
        if (axis_element := element.find("axis")) is not None:
            axis = np.array(self._read_numbers(axis_element, "xyz", 3))
        lower, upper, effort, speed = self._read_limit(element.find("limit"), kind)
        if kind == "fixed":
            return RawJoint(**values)
        length = float(np.linalg.norm(axis))
        if length < 1e-6:
            raise self._error("its axis must not be zero")
        axis = axis / max(length, 1e-12)
        return RawJoint(
            **values,
            lower=lower,
            upper=upper,
            effort=effort,
            speed=speed,
            kind="prismatic" if kind == "prismatic" else "revolute",
            axis=(float(axis[0]), float(axis[1]), float(axis[2])),
            is_endless=kind == "continuous",
        )

    def _read_limit(
        self, element: ET.Element | None, kind: str
    ) -> tuple[float, float, float, float]:
        """Read the lower and the upper limit, the effort and the speed."""
        is_bounded = kind in ("revolute", "prismatic")
        if element is None:
            if is_bounded:
                raise self._error(f"a {kind} joint must have a limit")
            return 0.0, 0.0, 0.0, 0.0
        keys = ("effort", "velocity", "lower", "upper") if is_bounded else ("effort", "velocity")
        read = [self._read_numbers(element, key, 1, default=(0.0,))[0] for key in keys]
        effort, speed, lower, upper = (*read, 0.0, 0.0)[:4]
        if effort < 0.0 or speed < 0.0:
            raise self._error(
                f"effort and velocity must not be negative; got {effort:g} and {speed:g}"
            )
        if is_bounded and lower >= upper:
            raise self._error(f"lower limit must be below the upper; got {lower:g} and {upper:g}")
        furthest = 10.0 if kind == "prismatic" else 100.0
        if max(-lower, upper) > furthest:
            raise self._error(f"limits must be within +-{furthest:g}; got {lower:g} and {upper:g}")
        return lower, upper, effort, speed

    # Pieces ----------------------------------------------------------------------------------

    def _read_name(self, element: ET.Element) -> str:
        name = element.get("name", "")
        if not _NAME.fullmatch(name):
            raise self._error(
                "names must be of letters, digits, '_', '.' and '-', at most 100; got "
                f"{name[:60]!r}"
            )
        return name

    def _read_origin(self, element: ET.Element) -> np.ndarray:
        origin = element.find("origin")
        if origin is None:
            return np.eye(4)
        xyz = self._read_numbers(origin, "xyz", 3, default=(0.0, 0.0, 0.0), most=100.0)
        roll, pitch, yaw = self._read_numbers(origin, "rpy", 3, default=(0.0, 0.0, 0.0), most=100.0)
        x, y, z = np.eye(3)
        R = rotation_about(z, yaw) @ rotation_about(y, pitch) @ rotation_about(x, roll)
        return transform((xyz[0], xyz[1], xyz[2]), R)

    def _read_numbers(
        self,
        element: ET.Element,
        key: str,
        count: int,
        *,
        default: tuple[float, ...] | None = None,
        most: float = MAX_NUMBER,
    ) -> tuple[float, ...]:
        text = element.get(key)
        if text is None:
            if default is not None:
                return default
            raise self._error(f"{element.tag} must have {key}")
        try:
            values = tuple(float(v) for v in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not np.isfinite(values).all():
            raise self._error(
                f"{key} of {element.tag} must be {count} finite number{'s' * (count > 1)}; got "
                f"{text[:60]!r}"
            )
        if max(map(abs, values)) > most:
            raise self._error(
                f"{key} of {element.tag} must be within +-{most:g}; got {text[:60]!r}"
            )
        return values
