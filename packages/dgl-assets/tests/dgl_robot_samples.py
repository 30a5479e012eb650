"""Robots of other makers' styles, written in code: text of URDF files and their meshes."""

import json
from pathlib import Path

import numpy as np
import trimesh


def link(name, mass=0.0, *, visual="", collision="", com=(0, 0, 0), size=0.05, extra=""):
    """A link; its inertia is that of a ball."""
    inertial = ""
    if mass:
        moment = 0.4 * mass * size**2
        inertial = (
            f'<inertial><origin xyz="{com[0]} {com[1]} {com[2]}"/><mass value="{mass}"/>'
            f'<inertia ixx="{moment}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/>'
            "</inertial>"
        )
    return f'<link name="{name}">{inertial}{visual}{collision}{extra}</link>'


def joint(
    name, parent, child, kind="revolute", *, xyz="0 0 0", rpy="0 0 0", axis="0 0 1", limit=None
):
    """A joint; `limit` is (lower, upper, effort, velocity)."""
    text = (
        ""
        if limit is None
        else (
            f'<limit lower="{limit[0]}" upper="{limit[1]}" effort="{limit[2]}" '
            f'velocity="{limit[3]}"/>'
        )
    )
    axis_text = "" if kind == "fixed" else f'<axis xyz="{axis}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/>'
        f'<parent link="{parent}"/><child link="{child}"/>{axis_text}{text}</joint>'
    )


def shape(tag, geometry, xyz="0 0 0", rpy="0 0 0", colour=""):
    """A visual or collision element."""
    return (
        f'<{tag}><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry>{colour}</{tag}>'
    )


def both(geometry, xyz="0 0 0", rpy="0 0 0", colour='<material name="white"/>'):
    """Visual and collision of one geometry."""
    return {
        "visual": shape("visual", geometry, xyz, rpy, colour),
        "collision": shape("collision", geometry, xyz, rpy),
    }


def robot(name, *parts):
    """The text of a file."""
    body = "\n".join(parts)
    return (
        f'<?xml version="1.0"?>\n<robot name="{name}">\n'
        f'<material name="white"><color rgba="0.9 0.9 0.9 1"/></material>\n{body}\n</robot>\n'
    )


def make_glb_of_nodes(count: int) -> bytes:
    """A binary glTF that shows one ball of 162 vertices in many places."""
    data = bytes(trimesh.creation.icosphere(subdivisions=2, radius=0.1).export(file_type="glb"))
    size = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + size])
    tree["nodes"] = [{"mesh": 0}] * count
    tree["scenes"] = [{"nodes": list(range(count))}]
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + size :]
    head = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text) + len(rest)).to_bytes(4, "little")
    return head + len(text).to_bytes(4, "little") + b"JSON" + text + rest


def six_joint_arm():
    """Primitives only: an arm with an offset wrist, cylinders as its maker draws them."""
    tube = '<cylinder radius="0.05" length="{}"/>'
    parts = [link("base_link", 3.0, **both('<cylinder radius="0.08" length="0.1"/>', "0 0 0.05"))]
    rows = [
        # name, offset, rpy, axis, length of the tube, mass
        ("shoulder_pan", "0 0 0.16", "0 0 0", "0 0 1", 0.12, 5.0),
        ("shoulder_lift", "0 0.13 0", "0 1.5707963 0", "0 1 0", 0.55, 8.0),
        ("elbow", "0 -0.11 0.55", "0 0 0", "0 1 0", 0.5, 3.5),
        ("wrist_a", "0 0 0.5", "0 1.5707963 0", "0 1 0", 0.11, 1.5),
        ("wrist_b", "0 0.1 0", "0 0 0", "0 0 1", 0.1, 1.5),
        ("wrist_c", "0 0 0.1", "0 0 0", "0 1 0", 0.08, 0.6),
    ]
    parent = "base_link"
    for name, xyz, rpy, axis, length, mass in rows:
        child = f"{name}_body"
        parts.append(
            link(
                child,
                mass,
                com=(0, 0, length / 2),
                size=max(0.06, length / 3),
                **both(tube.format(length), f"0 0 {length / 2}"),
            )
        )
        parts.append(
            joint(
                f"{name}_joint",
                parent,
                child,
                xyz=xyz,
                rpy=rpy,
                axis=axis,
                limit=(-6.2, 6.2, 150, 2.5),
            )
        )
        parent = child
    parts += [
        link("tool0"),
        joint("tool0_fixed", parent, "tool0", "fixed", xyz="0 0.09 0", rpy="-1.5707963 0 0"),
    ]
    return robot("six", *parts)


SEVEN_DH = (  # modified Denavit-Hartenberg of a well-known seven-joint arm: a, d, alpha, limits
    (0.0, 0.333, 0.0, -2.8, 2.8),
    (0.0, 0.0, -np.pi / 2, -1.7, 1.7),
    (0.0, 0.316, np.pi / 2, -2.8, 2.8),
    (0.0825, 0.0, np.pi / 2, -3.0, -0.1),
    (-0.0825, 0.384, -np.pi / 2, -2.8, 2.8),
    (0.0, 0.0, np.pi / 2, -0.0, 3.7),
    (0.088, 0.0, np.pi / 2, -2.8, 2.8),
)

SEVEN_HOME = {  # fingers forward, palm down, elbow up; the palm towards -y of link8
    "left": [-0.184, 1.079, 0.939, -2.577, 2.265, 2.134, 0.929],
    "right": [2.773, 0.649, -0.58, -2.638, -2.457, 1.743, 1.869],
}


def write_seven_joint_arm(folder: Path) -> Path:
    """A robot with meshes in millimetres, package references, an endless joint, and a gripper."""
    package = folder / "seven_description"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    tube = trimesh.creation.cylinder(radius=60, height=220, sections=24)
    tube.export(package / "meshes" / "tube.stl")
    elbow = trimesh.util.concatenate(
        [
            trimesh.creation.box(extents=(80, 80, 200)),
            trimesh.creation.box(
                extents=(200, 80, 80),
                transform=trimesh.transformations.translation_matrix((60, 0, 60)),
            ),
        ]
    )
    (package / "meshes" / "elbow.obj").write_text(elbow.export(file_type="obj"))
    mesh = '<mesh filename="package://seven_description/meshes/{}" scale="0.001 0.001 0.001"/>'
    parts = [
        link("world"),
        joint("anchor", "world", "link0", "fixed"),
        link("link0", 2.8, **both(mesh.format("tube.stl"), "0 0 0.11")),
    ]
    for k, (a, d, alpha, lower, upper) in enumerate(SEVEN_DH, start=1):
        y, z = -d * np.sin(alpha), d * np.cos(alpha)
        shown = both(mesh.format("elbow.obj" if k in (3, 4) else "tube.stl"), rpy="1.5707963 0 0")
        parts.append(link(f"link{k}", 3.0 / k, size=0.08, **shown))
        kind = "continuous" if k == 1 else "revolute"
        limit = (0, 0, 87, 0) if k == 1 else (lower, upper, 87 if k < 5 else 12, 2.2)
        parts.append(
            joint(
                f"joint{k}",
                f"link{k - 1}",
                f"link{k}",
                kind,
                xyz=f"{a} {y} {z}",
                rpy=f"{alpha} 0 0",
                limit=limit,
            )
        )
    parts += [
        link("link8"),
        joint("joint8", "link7", "link8", "fixed", xyz="0 0 0.107"),
        link("gripper", 0.7, **both('<box size="0.2 0.06 0.06"/>')),
        joint("gripper_joint", "link8", "gripper", "fixed"),
        link("jaw", 0.02, **both('<box size="0.02 0.02 0.05"/>', "0 0 0.06")),
        joint("jaw_joint", "gripper", "jaw", "prismatic", axis="0 1 0", limit=(0, 0.04, 20, 0.2)),
    ]
    home = {
        side: {f"joint{k}": value for k, value in enumerate(values, start=1)}
        for side, values in SEVEN_HOME.items()
    }
    (folder / "home.json").write_text(json.dumps(home))
    path = package / "urdf" / "seven.urdf"
    path.write_text(robot("seven", *parts))
    return path


def sixteen_joint_hand(*, is_left=False, prefix=""):
    """Four fingers of four joints each, fingers along +z, palm towards +x; boxes and cylinders."""
    s = -1 if is_left else 1  # the thumb of the right hand is at +y
    parts = [
        link(
            f"{prefix}palm",
            0.4,
            com=(0, 0, -0.04),
            **both('<box size="0.03 0.11 0.09"/>', "-0.01 0 -0.05"),
        )
    ]
    bone = '<box size="0.02 0.025 {}"/>'

    def add(finger, k, parent, xyz, rpy, axis, limit, length, mass=0.03):
        name = f"{prefix}{finger}_{k}"
        parts.append(
            link(
                name,
                mass,
                com=(0, 0, length / 2),
                size=0.02,
                **both(bone.format(length), f"0 0 {length / 2}"),
            )
        )
        parts.append(
            joint(
                f"{prefix}{finger}_joint_{k}",
                parent,
                name,
                xyz=xyz,
                rpy=rpy,
                axis=axis,
                limit=(*limit, 0.7, 6.0),
            )
        )
        return name

    for finger, y in (("index", 0.0435), ("middle", 0.0), ("ring", -0.0435)):
        at = add(
            finger, 0, f"{prefix}palm", f"0 {s * y} 0", "0 0 0", "0 0 1", (-0.47, 0.47), 0.0164
        )
        at = add(finger, 1, at, "0 0 0.0164", "0 0 0", "0 1 0", (-0.196, 1.61), 0.054)
        at = add(finger, 2, at, "0 0 0.054", "0 0 0", "0 1 0", (-0.174, 1.709), 0.0384)
        add(finger, 3, at, "0 0 0.0384", "0 0 0", "0 1 0", (-0.227, 1.618), 0.0267)
    # the thumb leaves the palm sideways, its first joint swings it in front of the fingers
    at = add(
        "thumb",
        0,
        f"{prefix}palm",
        f"0 {s * 0.03} -0.055",
        f"{-s * 1.2} 0 0",
        "0 0 1",
        (-1.4, 0.26) if not is_left else (-0.26, 1.4),
        0.02,
    )
    at = add("thumb", 1, at, "0 0 0.02", "0 0 0", "0 1 0", (-0.105, 1.163), 0.035)
    at = add("thumb", 2, at, "0 0 0.035", "0 0 0", "0 1 0", (-0.189, 1.644), 0.0514)
    add("thumb", 3, at, "0 0 0.0514", "0 0 0", "0 1 0", (-0.162, 1.719), 0.0423)
    return robot("sixteen", *parts)


def pair():
    """The six-joint arm with the sixteen-joint hand fixed to its tool, in one file."""
    arm, hand = six_joint_arm(), sixteen_joint_hand(prefix="h_")
    body = hand.split("\n", 3)[3].rpartition("</robot>")[0]
    mount = joint("mount", "tool0", "h_palm", "fixed", xyz="0 0 0.1")
    return arm.replace("</robot>", f"{body}\n{mount}\n</robot>")
