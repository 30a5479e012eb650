"""Import of robots of several styles; a folder loads as it was imported."""

import dataclasses
import importlib.util
import io
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from dgl_assets import AssetError, AssetNotFoundError
from dgl_assets.robots import DEFAULT_ROBOT, SIDES, Robot
from dgl_assets.robots.importing import (
    RobotImportOptions,
    home,
    import_robot,
    list_robots,
    load_robot,
)
from dgl_assets.robots.importing.fingers import rest_positions
from dgl_assets.robots.importing.home import ArmChain
from dgl_assets.robots.importing.poses import _tip
from dgl_assets.robots.importing.read_urdf import read_urdf

JOINT_NAMES = DEFAULT_ROBOT.joint_names

_PATH = Path(__file__).parent / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)


@pytest.fixture(scope="module", autouse=True)
def few_starts():
    """Search an arm's home from fewer starts, and rate fewer solutions: a third of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(home, "STARTS", 24)
        patch.setattr(home, "CANDIDATES", 2)
        yield


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    folder = tmp_path_factory.mktemp("library")
    reports = {}
    for name, kind, text, options in (
        ("six", "arm", samples.six_joint_arm(), {"licence": "MIT", "source": "a drawing"}),
        ("sixteen", "hand", samples.sixteen_joint_hand(), {}),
        ("lefty", "hand", samples.sixteen_joint_hand(is_left=True), {}),
        ("both", "pair", samples.pair(), {"hand_link": "h_palm"}),
    ):
        path = folder / f"{name}.urdf"
        path.write_text(text)
        reports[name] = import_robot(
            path, name=name, out=folder / "robots", kind=kind, options=RobotImportOptions(**options)
        )
    return folder / "robots", reports


@pytest.fixture(scope="module")
def seven(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seven")
    path = samples.write_seven_joint_arm(folder)
    report = import_robot(
        path,
        name="seven",
        out=folder / "r",
        kind="arm",
        options=RobotImportOptions(ee_link="link8", tool_palm="-y"),
    )
    return path, folder / "r", report


def test_what_was_imported_is_listed_and_recorded(library):
    folder, reports = library
    robots = list_robots(folder)
    assert list(robots) == ["ur10e", "shadow", "both", "lefty", "six", "sixteen"]
    assert (robots["six"]["licence"], robots["six"]["source"]) == ("MIT", "a drawing")
    assert [robots[n]["kind"] for n in ("six", "sixteen", "both")] == ["arm", "hand", "pair"]
    assert (reports["six"].joints, reports["sixteen"].joints, reports["both"].joints) == (6, 16, 22)
    assert robots["six"]["arm"]["joints"][0] == "shoulder_pan_joint"


@pytest.mark.parametrize(
    ("name", "full", "dof"),
    [
        ("six", "six+shadow", 60),
        ("sixteen", "ur10e+sixteen", 44),
        ("six+lefty", "six+lefty", 44),
        ("both", "both", 44),
        ("ur10e+shadow", "ur10e+shadow", 60),
    ],
)
def test_any_arm_goes_with_any_hand(library, tmp_path, name, full, dof):
    robot = load_robot(name, library[0])
    assert (robot.name, robot.dof, len(robot.joint_names)) == (full, dof, dof)
    raw = read_urdf(robot.build_urdf(tmp_path))
    moving = tuple(j.name for j in raw.joints if j.axis is not None)
    assert moving == robot.joint_names
    assert {f"{side}_ee" for side in SIDES} <= {link.name for link in raw.links}


def test_the_default_robot_is_what_it_was():
    assert load_robot("ur10e+shadow") is DEFAULT_ROBOT
    assert load_robot("shadow") is DEFAULT_ROBOT
    assert DEFAULT_ROBOT.joint_names == JOINT_NAMES


def test_unknown_and_unfitting_names_are_refused(library):
    with pytest.raises(AssetNotFoundError, match="did you mean 'sixteen'"):
        load_robot("sixteenn", library[0])
    with pytest.raises(AssetError, match="arm first"):
        load_robot("shadow+six", library[0])
    with pytest.raises(AssetError, match="ARM\\+HAND"):
        load_robot("six+shadow+six", library[0])
    with pytest.raises(AssetNotFoundError, match="imported ones need their folder"):
        load_robot("six")
    hand = load_robot("sixteen", library[0]).hand
    with pytest.raises(ValueError, match="different names"):
        Robot(
            arm=dataclasses.replace(load_robot("six", library[0]).arm, tree=hand.trees["right"]),
            hand=hand,
        )


def test_the_arm_keeps_its_kinematics(library, tmp_path):
    """Pose of the tool for random joints, by the file's text and arithmetic of its own."""
    path = tmp_path / "six.urdf"
    path.write_text(samples.six_joint_arm())
    raw, robot = read_urdf(path), load_robot("six", library[0])
    rng = np.random.default_rng(1)
    for q in rng.uniform(-3, 3, (5, 6)):
        T, values = np.eye(4), iter(q)
        for joint in raw.joints:
            T = T @ joint.joint_to_parent
            if joint.axis is not None:
                turn = trimesh.transformations.rotation_matrix(next(values), joint.axis)
                T = T @ turn
        pose = ArmChain(robot.arm.tree).linearise(q)[0]
        np.testing.assert_allclose(pose[:3, 3], T[:3, 3], atol=1e-7)
        np.testing.assert_allclose(pose[:3, 0], T[:3, 2], atol=1e-7)  # fingers along +z of the tool


def test_home_holds_the_fingers_forward_and_the_palm_down(library, seven):
    for name, folder in (("six", library[0]), ("both", library[0]), ("seven", seven[1])):
        arm = load_robot(name, folder).arm
        for side in SIDES:
            pose, J, _ = ArmChain(arm.tree).linearise(arm.home[side])
            np.testing.assert_allclose(pose[:3, 0], (0, 1, 0), atol=0.06)
            np.testing.assert_allclose(pose[:3, 1], (0, 0, -1), atol=0.06)
            assert np.linalg.svd(J)[1][-1] > 0.02, "home is no singularity"
            parked = ArmChain(arm.tree).linearise(arm.parked[side])[0]
            assert (parked[0, 3] < pose[0, 3]) == (side == "left"), "parked is outwards"


def test_the_other_hand_is_the_reflection(library):
    """The left hand is the right one, reflected across fingers and palm."""
    for name in ("sixteen", "lefty", "both"):
        hand = load_robot(name, library[0]).hand
        rng = np.random.default_rng(2)
        joints = [j for j in hand.trees["right"].joints if j.axis is not None]
        q = {j.name: float(rng.uniform(j.lower, j.upper)) for j in joints}
        right, left = (hand.trees[s].compute_link_poses(q) for s in ("right", "left"))
        for link, T in right.items():
            seen = hand.mounts["right"] @ T
            other = hand.mounts["left"] @ left[link]
            np.testing.assert_allclose(other[:3, 3], seen[:3, 3] * (1, 1, -1), atol=1e-9)


def test_right_and_left_files_of_one_hand_give_the_same_pair(library):
    """The left file describes the reflection, so both imports are one robot but for their names."""
    right, left = (load_robot(n, library[0]).hand for n in ("sixteen", "lefty"))
    np.testing.assert_allclose(right.grasp_point, left.grasp_point, atol=1e-9)
    for side in SIDES:
        tips = []
        for hand in (right, left):
            tree = hand.trees[side]
            poses = tree.compute_link_poses(
                dict(zip(tree.moving_joint_names, hand.poses["close"], strict=True))
            )
            tips.append(
                [(hand.mounts[side] @ T)[:3, 3] for n, T in poses.items() if n.endswith("_3")]
            )
        np.testing.assert_allclose(tips[0], tips[1], atol=2e-3)


def test_poses_do_what_their_names_say(library):
    hand = load_robot("sixteen", library[0]).hand
    tree, mount = hand.trees["right"], hand.mounts["right"]

    def tips(pose):
        values = dict(zip(tree.moving_joint_names, hand.poses[pose], strict=True))
        poses = tree.compute_link_poses(values)
        return {
            f: (mount @ poses[f"sixteen_{f}_3"] @ [0, 0, 0.0267, 1])[:3]
            for f in ("index", "middle", "ring", "thumb")
        }

    opened, closed, pinched = tips("open"), tips("close"), tips("pinch")
    for finger in ("index", "middle", "ring"):
        assert opened[finger][0] - closed[finger][0] > 0.04, "closing draws the tips back"
        assert closed[finger][1] - opened[finger][1] > 0.02, "towards the palm's side"

    def gap(found):
        return float(np.linalg.norm(found["index"] - found["thumb"]))

    assert gap(pinched) < 0.6 * gap(opened)
    assert pinched["ring"][0] > closed["ring"][0] + 0.04, "a pinch leaves the others open"


def test_meshes_packages_scales_and_grippers_are_understood(seven, tmp_path):
    _, folder, report = seven
    assert report.joints == 7
    notes = " ".join(report.assumptions)
    assert "gripper" in notes
    assert "joint1 turns without end" in notes
    assert "no speed limit" in notes
    assert report.collision_shapes == {"capsule": report.collision_shapes["capsule"]}
    arm = load_robot("seven", folder).arm
    meshes = arm.load_meshes()
    scene = trimesh.load_scene(
        io.BytesIO(meshes.files[meshes.by_link["link0"][0]]), file_type="glb"
    )
    np.testing.assert_allclose(scene.extents, (0.12, 0.12, 0.22), atol=0.002)
    # the elbow's L is two bodies at least, and they hold its vertices
    elbow = next(link for link in arm.tree.links if link.name == "link3")
    assert len(elbow.collision) >= 2


@pytest.mark.parametrize("method", [pytest.param("coacd", marks=pytest.mark.slow), "keep"])
def test_convex_pieces_are_files_of_the_robot(tmp_path, method, rest_poses):
    """CoACD divides an L; kept, it is one hull."""
    arm = trimesh.creation.box(extents=(0.3, 0.05, 0.05))
    leg = trimesh.creation.box(
        extents=(0.05, 0.3, 0.05),
        transform=trimesh.transformations.translation_matrix((0.125, 0.125, 0)),
    )
    shape = trimesh.util.concatenate([arm, leg])
    shape.export(tmp_path / "palm.stl")
    text = samples.sixteen_joint_hand().replace(
        '<box size="0.03 0.11 0.09"/>', '<mesh filename="palm.stl" scale="0.3 0.3 0.3"/>'
    )
    (tmp_path / "h.urdf").write_text(text)
    report = import_robot(
        tmp_path / "h.urdf",
        name="h",
        out=tmp_path / "r",
        kind="hand",
        options=RobotImportOptions(collision=method),
    )
    count = report.collision_shapes["mesh"]
    assert count == 1 if method == "keep" else 2 <= count <= 8
    hand = load_robot("h", tmp_path / "r").hand
    hulls = {}
    for side in SIDES:
        meshes = hand.load_meshes(side)
        names = [s.mesh for s in hand.trees[side].links[0].collision]
        parts = [trimesh.load_mesh(io.BytesIO(meshes.files[n]), file_type="stl") for n in names]
        assert all(part.is_convex for part in parts)
        hulls[side] = np.concatenate([part.vertices for part in parts])
    flipped = hulls["right"] * (-1, 1, 1)
    np.testing.assert_allclose(np.sort(hulls["left"], axis=0), np.sort(flipped, axis=0), atol=1e-6)


def test_collada_is_read_in_its_unit(tmp_path, rest_poses):
    collada = pytest.importorskip("collada")
    box = trimesh.creation.box(extents=(60, 100, 90))
    data = box.export(file_type="dae")
    assert collada is not None
    text = (
        data.decode().replace('meter="1.0"', 'meter="0.001"').replace('meter="1"', 'meter="0.001"')
    )
    if "<unit" not in text:
        text = text.replace("<asset>", '<asset><unit name="millimetre" meter="0.001"/>')
    (tmp_path / "palm.dae").write_text(text)
    hand = samples.sixteen_joint_hand().replace(
        '<box size="0.03 0.11 0.09"/>', '<mesh filename="palm.dae"/>'
    )
    (tmp_path / "h.urdf").write_text(hand)
    import_robot(tmp_path / "h.urdf", name="h", out=tmp_path / "r", kind="hand")
    meshes = load_robot("h", tmp_path / "r").hand.load_meshes("right")
    scene = trimesh.load_scene(
        io.BytesIO(meshes.files[meshes.by_link["h_palm"][0]]), file_type="glb"
    )
    np.testing.assert_allclose(np.sort(scene.extents), (0.06, 0.09, 0.1), atol=1e-6)


def test_given_poses_and_home_are_taken(tmp_path):
    (tmp_path / "hand.urdf").write_text(samples.sixteen_joint_hand())
    names = [f"{f}_joint_{k}" for f in ("index", "middle", "ring", "thumb") for k in range(4)]
    (tmp_path / "poses.json").write_text(json.dumps({"cradle": dict.fromkeys(names, 0.1)}))
    options = RobotImportOptions(poses=tmp_path / "poses.json", grasp_point=(0.2, 0.03, 0.01))
    import_robot(tmp_path / "hand.urdf", name="h", out=tmp_path, kind="hand", options=options)
    hand = load_robot("h", tmp_path).hand
    np.testing.assert_allclose(hand.poses["cradle"], 0.1)
    assert hand.poses["close"].max() > 0.5
    assert hand.grasp_point == (0.2, 0.03, 0.01)


def test_edits_of_the_folder_are_checked(tmp_path, rest_poses):
    (tmp_path / "hand.urdf").write_text(samples.sixteen_joint_hand())
    import_robot(tmp_path / "hand.urdf", name="h", out=tmp_path, kind="hand")
    path = tmp_path / "h" / "robot.json"
    whole = json.loads(path.read_text())
    joint = whole["hand"]["joints"][0]

    def refuse(change, words):
        content = json.loads(json.dumps(whole))
        change(content["hand"])
        path.write_text(json.dumps(content))
        with pytest.raises(AssetError, match=words):
            load_robot("h", tmp_path)

    refuse(lambda h: h["poses"].pop("close"), "close")
    refuse(lambda h: h["poses"]["open"].pop(joint), "every joint")
    refuse(lambda h: h["poses"]["open"].update({joint: 7.0}), "must be within")
    refuse(lambda h: h["gains"][joint].update(stiffness=-1.0), "positive")
    refuse(lambda h: h["gains"].pop(joint), "missing")
    refuse(lambda h: h["mounts"]["left"].update(wxyz=[0, 0, 0, 0]), "unit quaternion")
    refuse(lambda h: h.update(ground_links=["nose"]), "ground_links")
    refuse(lambda h: h.update(grasp_point=[0, 1]), "not enough values")
    path.write_text("{")
    with pytest.raises(AssetError, match="JSON"):
        load_robot("h", tmp_path)


def test_tip_of_a_finger_is_where_its_box_ends(library):
    from dgl_assets.robots.importing.fingers import understand_hand

    hand = load_robot("sixteen", library[0]).hand
    tree = hand.trees["right"]
    frame = understand_hand(tree, hand.load_meshes("right"))
    assert frame.is_right
    assert [f.tip_link for f in frame.fingers] == [
        f"sixteen_{f}_3" for f in ("thumb", "index", "middle", "ring")
    ]
    np.testing.assert_allclose(frame.fingers[1].tip, (0, 0, 0.0267), atol=1e-9)
    tip = _tip(tree, frame, frame.fingers[1], rest_positions(tree))
    np.testing.assert_allclose(tip, (0.0164 + 0.054 + 0.0384 + 0.0267, 0, 0.0435), atol=1e-6)
