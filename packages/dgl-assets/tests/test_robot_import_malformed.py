"""Files that are no usable robot are refused in one clear line, and leave nothing behind."""

import contextlib
import importlib.util
import json
import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dgl_assets import AssetError
from dgl_assets.robots.importing import RobotImportError, RobotImportOptions, import_robot

_PATH = Path(__file__).parent / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)

ARM = samples.six_joint_arm()
HAND = samples.sixteen_joint_hand()
CUBE = trimesh.creation.box(extents=(0.1, 0.1, 0.1)).export(file_type="stl")
HAND_JOINTS = [f"{f}_joint_{k}" for f in ("index", "middle", "ring", "thumb") for k in range(4)]
BASE_SHAPE = '<cylinder radius="0.08" length="0.1"/>'


def change(old, new, text=ARM, count=1):
    """A file with one thing changed."""
    assert old in text
    return text.replace(old, new, count)


def with_mesh(reference, scale="1 1 1", **files):
    """The arm with a mesh as its base, and files beside it."""
    mesh = f'<mesh filename="{reference}" scale="{scale}"/>'
    return {"r.urdf": change(BASE_SHAPE, mesh, count=-1), **files}


BOMB = (
    '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1 if k else str()};" * 10}">' for k in range(9))
    + "]><robot name='&a8;'/>"
)
EXTERNAL = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/hostname">]><robot name="r">&x;</robot>'
LIMIT = '<limit lower="-6.2" upper="6.2" effort="150" velocity="2.5"/>'
FIRST = 'type="revolute"'

# name: (files or text, kind, options, words of the message)
CASES = {
    "empty": ("", "arm", {}, "empty"),
    "text": ("hello", "arm", {}, "XML"),
    "cut off": (ARM[: len(ARM) // 2], "arm", {}, "XML"),
    "binary": (bytes(range(256)) * 10, "arm", {}, "XML"),
    "two roots of XML": (ARM + ARM.split("\n", 1)[1], "arm", {}, "XML"),
    "unknown encoding": (change('version="1.0"', 'version="1.0" encoding="x-klingon"'), "arm", {},
        "XML"),
    "entity bomb": (BOMB, "arm", {}, "document type"),
    "external entity": (EXTERNAL, "arm", {}, "document type"),
    "deep": ("<robot>" + "<a>" * 200 + "</a>" * 200 + "</robot>", "arm", {}, "no links"),
    "very many elements": ("<robot>" + "<a/>" * 100_001 + "</robot>", "arm", {}, "no links"),
    "too large": (b"<robot>" + b" " * (17 * 2**20) + b"</robot>", "arm", {}, "bytes"),
    "mujoco": ("<mujoco><worldbody/></mujoco>", "arm", {}, "must be a URDF"),
    "xacro": (change('xyz="0 0 0.16"', 'xyz="0 0 ${h}"'), "arm", {}, "xacro"),
    "no links": ('<robot name="r"/>', "arm", {}, "no links"),
    "too many links": (
        "<robot name='r'>" + "".join(f"<link name='l{k}'/>" for k in range(500)) + "</robot>",
        "arm", {}, "at most 400",
    ),
    "link without name": (change('<link name="tool0">', "<link>"), "arm", {}, "names must be"),
    "hostile name": (change("tool0", "../../tool", count=-1), "arm", {}, "names must be"),
    "long name": (change("tool0", "t" * 200, count=-1), "arm", {}, "names must be"),
    "link twice": (change('<link name="tool0">', '<link name="elbow_body">'), "arm", {}, "unique"),
    "joint twice": (change('"elbow_joint"', '"wrist_a_joint"'), "arm", {}, "unique"),
    "unknown parent": (change('<parent link="elbow_body"/>', '<parent link="x"/>'), "arm", {},
        "there is no link"),
    "unknown child": (change('<child link="tool0"/>', '<child link="x"/>'), "arm", {},
        "there is no link"),
    "no parent": (change('<parent link="elbow_body"/>', ""), "arm", {}, "parent"),
    "no child": (change('<child link="tool0"/>', "<child/>"), "arm", {}, "child"),
    "loose link": (change("</robot>", '<link name="loose"/></robot>'), "arm", {}, "one root"),
    "cycle": (change('<parent link="base_link"/>', '<parent link="tool0"/>'), "arm", {}, "cycle"),
    "all in a cycle": (
        '<robot name="r"><link name="a"/><link name="b"/>'
        + samples.joint("j", "a", "b", "fixed") + samples.joint("k", "b", "a", "fixed")
        + "</robot>",
        "arm", {}, "no root",
    ),
    "its own parent": (change('<parent link="elbow_body"/>', '<parent link="wrist_a_body"/>'),
        "arm", {}, "cycle"),
    "two parents": (
        change("</robot>", samples.joint("again", "base_link", "tool0", "fixed") + "</robot>"),
        "arm", {}, "two parents",
    ),
    "floating joint": (change(FIRST, 'type="floating"'), "arm", {}, "type must be one of"),
    "planar joint": (change(FIRST, 'type="planar"'), "arm", {}, "type must be one of"),
    "no type": (change(FIRST, ""), "arm", {}, "type must be one of"),
    "made-up type": (change(FIRST, 'type="rubber"'), "arm", {}, "'rubber'"),
    "no limit": (change(LIMIT, ""), "arm", {}, "must have a limit"),
    "limits turned round": (change('lower="-6.2"', 'lower="7"'), "arm", {}, "below the upper"),
    "limit not a number": (change('upper="6.2"', 'upper="nan"'), "arm", {}, "finite"),
    "infinite limit": (change('upper="6.2"', 'upper="inf"'), "arm", {}, "finite"),
    "limits in degrees": (change('upper="6.2"', 'upper="360"'), "arm", {}, "within"),
    "negative effort": (change('effort="150"', 'effort="-1"'), "arm", {}, "negative"),
    "negative speed": (change('velocity="2.5"', 'velocity="-2"'), "arm", {}, "negative"),
    "zero axis": (change('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>'), "arm", {}, "axis"),
    "axis of two numbers": (change('<axis xyz="0 0 1"/>', '<axis xyz="0 1"/>'), "arm", {},
        "3 finite"),
    "origin of text": (change('xyz="0 0 0.16"', 'xyz="0 0 high"'), "arm", {}, "3 finite"),
    "origin not finite": (change('xyz="0 0 0.16"', 'xyz="0 0 -inf"'), "arm", {}, "3 finite"),
    "origin far away": (change('xyz="0 0 0.16"', 'xyz="0 0 1e9"'), "arm", {}, "within +-100"),
    "rpy not finite": (change('rpy="0 1.5707963 0"', 'rpy="0 1e999 0"'), "arm", {}, "3 finite"),
    "negative mass": (change('<mass value="5.0"/>', '<mass value="-5"/>'), "arm", {},
        "mass must not be negative"),
    "mass not a number": (change('<mass value="5.0"/>', '<mass value="nan"/>'), "arm", {},
        "finite"),
    "mass of a star": (change('<mass value="5.0"/>', '<mass value="1e300"/>'), "arm", {},
        "within +-10000"),
    "effort of a god": (change('effort="150"', 'effort="1e308"'), "arm", {}, "within +-1e+06"),
    "axis beyond numbers": (change('<axis xyz="0 0 1"/>', '<axis xyz="0 0 1e200"/>'), "arm", {},
        "within +-1e+06"),
    "speed of 400 digits": (change('velocity="2.5"', f'velocity="{"9" * 400}"'), "arm", {},
        "1 finite"),
    "no mass": (change('<mass value="5.0"/>', ""), "arm", {}, "mass and inertia"),
    "inertia negative": (change('ixx="', 'ixx="-1" unused="'), "arm", {},
        "inertia must be positive"),
    "inertia of no body": (change('ixx="', 'ixx="100" unused="'), "arm", {}, "of no body"),
    "no geometry": (change(f"<geometry>{BASE_SHAPE}</geometry>", ""), "arm", {}, "one geometry"),
    "unknown geometry": (change(BASE_SHAPE, '<torus radius="1"/>'), "arm", {}, "'torus'"),
    "radius of zero": (change('radius="0.08"', 'radius="0"'), "arm", {}, "sizes"),
    "negative length": (change('length="0.1"', 'length="-0.1"'), "arm", {}, "sizes"),
    "giant cylinder": (change('length="0.1"', 'length="1000"'), "arm", {}, "sizes"),
    "no radius": (change('radius="0.08" ', ""), "arm", {}, "radius"),
    "colour beyond white": (change("0.9 0.9 0.9 1", "255 255 255 1"), "arm", {}, "0 to 1"),
    "mimics nothing": (change(LIMIT, LIMIT + '<mimic joint="ghost"/>'), "arm", {}, "ghost"),
    "missing mesh": (with_mesh("base.stl"), "arm", {}, "does not exist"),
    "mesh without name": (with_mesh(""), "arm", {}, "filename"),
    "absolute mesh": (with_mesh("/etc/hostname"), "arm", {}, "own folder"),
    "mesh of a file address": (with_mesh("file:///etc/hostname"), "arm", {}, "absolute"),
    "mesh from the web": (with_mesh("http://example.org/base.stl"), "arm", {}, "own folder"),
    "mesh above the folder": (with_mesh("../secret.stl"), "arm", {}, "own folder"),
    "mesh above its package": (with_mesh("package://in/../../secret.stl"), "arm", {}, "own folder"),
    "mesh of no package": (with_mesh("package:///secret.stl"), "arm", {}, "must name a package"),
    "mesh of a package of dots": (with_mesh("package://../secret.stl"), "arm", {},
        "must name a package"),
    "scale too small": (with_mesh("base.stl", scale="1e-8 1 1", **{"base.stl": CUBE}), "arm", {},
        "scale of a mesh"),
    "mesh too small": (with_mesh("base.stl", scale="1e-5 1e-5 1e-5", **{"base.stl": CUBE}), "arm",
        {}, "m long, at least"),
    "mesh of many nodes": (
        with_mesh("base.glb", **{"base.glb": samples.make_glb_of_nodes(20_000)}), "arm", {},
            "as often as it is shown",
    ),
    "mesh shown very often": (
        with_mesh("base.glb", **{"base.glb": samples.make_glb_of_nodes(9_000)}), "arm", {},
            "as often as it is shown",
    ),
    "mesh of many lines": (
        with_mesh("base.obj", **{"base.obj": b"v 0 0 0" + b"\n" * 6_000_100}), "arm", {},
            "base.obj",
    ),
    "unknown package": (with_mesh("package://nowhere/base.stl"), "arm", {}, "--package"),
    "windows path": (with_mesh("C:\\robots\\base.stl"), "arm", {}, "own folder"),
    "mesh of another kind": (with_mesh("base.step", **{"base.step": b"ISO-10303-21;"}), "arm", {},
        "meshes must be"),
    "empty mesh": (with_mesh("base.stl", **{"base.stl": b""}), "arm", {}, "empty"),
    "cut-off mesh": (with_mesh("base.stl", **{"base.stl": CUBE[:200]}), "arm", {}, "base.stl"),
    "mesh of text": (with_mesh("base.obj", **{"base.obj": b"no mesh at all"}), "arm", {},
        "base.obj"),
    "mesh without triangles": (with_mesh("base.obj", **{"base.obj": b"v 0 0 0\nv 1 0 0\n"}), "arm",
        {}, "base.obj"),
    "mesh named wrongly": (with_mesh("base.obj", **{"base.obj": CUBE}), "arm", {}, "rename"),
    "mesh that is not finite": (
        with_mesh("base.obj", **{"base.obj": b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n"}), "arm", {},
            "finite",
    ),
    "index out of range": (
        with_mesh("base.obj", **{"base.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n"}), "arm", {},
            "base.obj",
    ),
    "mesh in millimetres": (
        with_mesh("base.stl", scale="1000 1000 1000", **{"base.stl": CUBE}), "arm", {},
            "millimetres",
    ),
    "scale of zero": (with_mesh("base.stl", scale="0 1 1", **{"base.stl": CUBE}), "arm", {},
        "scale"),
    "scale not finite": (with_mesh("base.stl", scale="nan 1 1", **{"base.stl": CUBE}), "arm", {},
        "finite"),
    "collada bomb": (
        with_mesh("base.dae", **{"base.dae":
            b'<!DOCTYPE x [<!ENTITY a "b">]><COLLADA>&a;</COLLADA>'}), "arm", {}, "base.dae",
    ),
    "collada of nothing": (with_mesh("base.dae", **{"base.dae": b"<COLLADA/>"}), "arm", {},
        "base.dae"),
    "arm of five joints": (ARM, "arm", {"ee_link": "wrist_b_body"}, "6 to 12"),
    "unknown end": (ARM, "arm", {"ee_link": "nowhere"}, "no link"),
    "unknown root": (ARM, "arm", {"root": "nowhere"}, "no link"),
    "a hand as an arm": (HAND, "arm", {}, "--ee-link"),
    "an arm as a hand": (ARM, "hand", {}, "fingers"),
    "tool axis of nothing": (ARM, "arm", {"tool_axis": "up"}, "direction"),
    "palm along the fingers": (HAND, "hand", {"fingers_axis": "+z", "palm_axis": "-z"},
        "different axes"),
    "unknown thumb": (HAND, "hand", {"thumb": "nose"}, "no finger"),
    "hand without joints": (samples.robot("h", samples.link("palm", 1.0)), "hand", {},
        "moving joints"),
    "pair without hand": (samples.pair(), "pair", {}, "--hand-link"),
    "pair at a moving link": (samples.pair(), "pair", {"hand_link": "elbow_body"},
        "fixed to the arm"),
    "far mount": (HAND, "hand", {"mount_offset": 3.0}, "0.5 m"),
    "home of nobody": ({"r.urdf": ARM, "home.json": b'{"left": {}}'}, "arm", {"home": "home.json"},
        "left and right"),
    "home without joints": (
        {"r.urdf": ARM, "home.json": b'{"left": {}, "right": {}}'}, "arm", {"home": "home.json"},
            "every joint",
    ),
    "home of numbers": ({"r.urdf": ARM, "home.json": b'{"left": 1, "right": 2}'}, "arm",
        {"home": "home.json"}, "must map joints"),
    "home of 400 digits": (
        {"r.urdf": ARM, "home.json": b'{"left": ' + b"9" * 400 + b', "right": {}}'}, "arm",
            {"home": "home.json"}, "map joints",
    ),
    "home not JSON": ({"r.urdf": ARM, "home.json": b"{"}, "arm", {"home": "home.json"}, "JSON"),
    "pose of nobody": ({"r.urdf": HAND, "p.json": b'{"wave": {}}'}, "hand", {"poses": "p.json"},
        "poses of"),
    "pose out of limits": (
        {"r.urdf": HAND, "p.json": json.dumps({"open": dict.fromkeys(HAND_JOINTS, 9)})},
        "hand", {"poses": "p.json"}, "must be within",
    ),
}  # fmt: skip


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Folder for temporary files, which must be empty in the end."""
    folder = tmp_path / "scratch"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def _write(folder, content):
    files = content if isinstance(content, dict) else {"r.urdf": content}
    for name, data in files.items():
        (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)
    return folder / "r.urdf"


def find_fault(case, folder):
    """Import one case; tell how it went wrong, or nothing where it was refused as it should."""
    content, kind, options, words = case
    source = folder / "in"
    source.mkdir(parents=True)
    (folder / "secret.stl").write_bytes(CUBE)
    path = _write(source, content)
    options = {k: source / v if k in ("home", "poses") else v for k, v in options.items()}
    before = sorted(folder.rglob("*"))
    out = folder / "out" / "robots"
    try:
        import_robot(path, name="r", out=out, kind=kind, options=RobotImportOptions(**options))
    except AssetError as err:
        message = str(err)
        if words not in message or "\n" in message or not 12 < len(message) < 500:
            return f"unclear: {message}"
    else:
        return "was imported"
    return None if sorted(folder.rglob("*")) == before else "left something"


def test_malformed_robots_are_refused_and_leave_nothing(tmp_path, scratch, reads_here):
    assert len(CASES) >= 100
    found = {
        name: find_fault(case, tmp_path / str(k)) for k, (name, case) in enumerate(CASES.items())
    }
    assert {name: fault for name, fault in found.items() if fault} == {}
    assert list(scratch.iterdir()) == []


def test_malformed_robots_are_refused_as_well_in_a_child_process(tmp_path, scratch):
    names = list(CASES)[::12]
    found = {name: find_fault(CASES[name], tmp_path / str(k)) for k, name in enumerate(names)}
    assert {name: fault for name, fault in found.items() if fault} == {}
    assert list(scratch.iterdir()) == []


def test_missing_files_links_out_of_the_folder_and_bad_names(tmp_path):
    def refuse(path, words, name="r", kind="arm"):
        with pytest.raises(AssetError, match=words):
            import_robot(path, name=name, out=tmp_path / "out", kind=kind)
        assert not (tmp_path / "out").exists()

    refuse(tmp_path / "none.urdf", "not a file")
    refuse(tmp_path, "not a file")
    path = tmp_path / "r.urdf"
    path.write_text(ARM)
    for name in ("", "../up", "A", "ur10e", "shadow", "a+b", "x" * 60, ".hidden"):
        refuse(path, "name must be", name=name)
    refuse(path, "kind must be", kind="leg")
    with pytest.raises(ValueError, match="collision"):
        RobotImportOptions(collision="voxels")
    inside = tmp_path / "deep"
    inside.mkdir()
    (tmp_path / "base.stl").write_bytes(CUBE)
    os.symlink(tmp_path / "base.stl", inside / "base.stl")
    (inside / "r.urdf").write_text(with_mesh("base.stl")["r.urdf"])
    refuse(inside / "r.urdf", "out of its own folder")


def test_a_robot_that_exists_is_kept_unless_asked(tmp_path, rest_poses):
    path = tmp_path / "hand.urdf"
    path.write_text(HAND)
    out = tmp_path / "out"
    import_robot(path, name="h", out=out, kind="hand")
    before = (out / "h" / "robot.json").read_bytes()
    with pytest.raises(AssetError, match="exists"):
        import_robot(path, name="h", out=out, kind="hand")
    path.write_text(HAND.replace('mass value="0.4"', 'mass value="-1"'))
    with pytest.raises(RobotImportError):
        import_robot(
            path, name="h", out=out, kind="hand", options=RobotImportOptions(overwrite=True)
        )
    assert (out / "h" / "robot.json").read_bytes() == before
    path.write_text(HAND.replace('mass value="0.4"', 'mass value="0.5"'))
    import_robot(path, name="h", out=out, kind="hand", options=RobotImportOptions(overwrite=True))
    assert sorted(p.name for p in out.iterdir()) == ["h"]


def test_damaged_bytes_are_refused_or_read_and_never_a_defect(tmp_path, reads_here, rest_poses):
    rng = np.random.default_rng(3)
    for number in range(20):
        data = bytearray(HAND.encode())
        for _ in range(int(rng.choice([1, 3, 20]))):
            data[int(rng.integers(len(data)))] = int(rng.integers(32, 127))
        path = tmp_path / f"{number}.urdf"
        path.write_bytes(data)
        with contextlib.suppress(AssetError):  # anything else is a defect and fails the test
            import_robot(path, name=f"h{number}", out=tmp_path / "out", kind="hand")
            continue
        assert not (tmp_path / "out" / f"h{number}").exists()
