"""The written files: content, whole folders, meshes."""

import io
import threading
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from dgl_assets.robots import DEFAULT_ROBOT, HAND_MASS, SIDES, UR10E
from dgl_assets.robots._solids import Section, ball, cylinder, loft, rounded_box, shade
from dgl_assets.robots.visual import (
    FINISHES,
    build_pedestal_mesh,
    build_shadow_meshes,
    build_ur10e_meshes,
)

JOINT_NAMES = DEFAULT_ROBOT.joint_names
build_arm_urdf = DEFAULT_ROBOT.build_arm_urdf
build_bimanual_urdf = DEFAULT_ROBOT.build_urdf


@pytest.fixture(scope="module")
def bimanual(tmp_path_factory):
    return build_bimanual_urdf(tmp_path_factory.mktemp("robots"))


def test_urdf_has_all_joints_links_and_shapes(bimanual):
    robot = ET.parse(bimanual).getroot()
    moving = [j.get("name") for j in robot.findall("joint") if j.get("type") == "revolute"]
    assert tuple(moving) == JOINT_NAMES
    links = {link.get("name") for link in robot.findall("link")}
    assert len(links) == 77
    assert {f"{s}_{n}" for s in SIDES for n in ("ee", "ff_tip", "th_tip", "palm")} <= links
    expected = sum(len(link.collision) for link in DEFAULT_ROBOT.build_tree().links)
    assert len(robot.findall("link/collision")) == expected
    base = robot.find("joint[@name='right_base_joint']/origin")
    assert base.get("xyz") == "0.8 0 0.5"


def test_every_mesh_is_there_and_every_link_is_drawn(bimanual):
    robot = ET.parse(bimanual).getroot()
    drawn = {}
    for link in robot.findall("link"):
        drawn[link.get("name")] = [m.get("filename") for m in link.findall("visual/geometry/mesh")]
    for names in drawn.values():
        for name in names:
            assert (bimanual.parent / name).stat().st_size > 1000
    bodies = [*HAND_MASS, *(j.link for j in UR10E), "base_link"]
    assert all(drawn[f"{side}_{body}"] for side in SIDES for body in bodies)


def test_total_mass(bimanual):
    robot = ET.parse(bimanual).getroot()
    mass = sum(float(m.get("value")) for m in robot.findall("link/inertial/mass"))
    assert mass == pytest.approx(2 * (4.0 + 29.104 + sum(HAND_MASS.values())), abs=0.01)


def test_equal_content_is_one_folder_and_other_bases_are_another(tmp_path, bimanual):
    first = build_bimanual_urdf(tmp_path)
    before = first.stat().st_mtime_ns
    assert build_bimanual_urdf(tmp_path) == first
    assert first.stat().st_mtime_ns == before, "an existing robot is not written again"
    assert first.parent.name == bimanual.parent.name, "the name does not depend on the place"
    moved = build_bimanual_urdf(tmp_path, left_base=(-0.9, 0.0, 0.5, 0.0))
    assert moved.parent != first.parent


def test_writers_at_once_leave_one_whole_robot(tmp_path):
    results = []
    threads = [
        threading.Thread(target=lambda: results.append(build_bimanual_urdf(tmp_path)))
        for _ in range(6)
    ]
    for t in threads:
        t.start()
    for t in threads:
        t.join()
    assert len(set(results)) == 1
    assert [p.name for p in tmp_path.iterdir()] == [results[0].parent.name], "nothing left behind"
    ET.parse(results[0])


def test_failed_write_leaves_nothing(tmp_path, monkeypatch):
    def fail(self, target):
        raise OSError("disk full")

    monkeypatch.setattr("pathlib.Path.rename", fail)
    with pytest.raises(OSError, match="disk full"):
        build_bimanual_urdf(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_arm_urdf_is_six_joints_and_ee(tmp_path):
    robot = ET.parse(build_arm_urdf(tmp_path, "right", (0.8, 0, 0.5, 0))).getroot()
    moving = [j.get("name") for j in robot.findall("joint") if j.get("type") == "revolute"]
    assert moving == [f"right_{j.name}" for j in UR10E]
    assert robot.findall("link")[-1].get("name") == "right_ee"
    assert robot.find("link/visual") is None


def test_meshes_are_modest_finite_and_named_finishes():
    meshes = build_pedestal_mesh("left_base_link", 0.5) | build_pedestal_mesh(
        "right_base_link", 0.5
    )
    for side in SIDES:
        for part in (build_ur10e_meshes(), build_shadow_meshes(side)):
            meshes |= part.with_prefix(f"{side}_")
    triangles = {}
    for name, data in meshes.files.items():
        scene = trimesh.load(io.BytesIO(data), file_type="glb")
        assert set(scene.geometry) <= set(FINISHES)
        triangles[name] = 0
        for mesh in scene.geometry.values():
            assert np.isfinite(mesh.vertices).all()
            np.testing.assert_allclose(np.linalg.norm(mesh.vertex_normals, axis=1), 1, atol=1e-3)
            triangles[name] += len(mesh.faces)
    total = sum(triangles[f] for files in meshes.by_link.values() for f in files)
    assert total < 30_000


def test_low_base_has_no_pedestal():
    assert list(build_pedestal_mesh("base", 0.5).by_link) == ["base"]
    assert build_pedestal_mesh("base", 0.0).by_link == {}


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        (cylinder("steel", 0.1, 0.0, 0.2, segments=400), np.pi * 0.01 * 0.2),
        (ball("steel", 0.1, segments=200), 4 / 3 * np.pi * 0.001),
        (rounded_box("steel", (0.1, 0.2, 0.3), radius=1e-6, power=200, segments=400), 0.048),
    ],
)
def test_solids_are_closed_outward_and_of_the_right_volume(solid, volume):
    mesh = trimesh.Trimesh(solid.vertices, solid.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(volume, rel=0.01)
    assert trimesh.Trimesh(
        solid.mirrored_x().vertices, solid.mirrored_x().faces
    ).volume == pytest.approx(mesh.volume)


def test_shading_is_smooth_round_the_side_and_sharp_at_the_rim():
    vertices, normals, _ = shade(cylinder("steel", 1.0, 0.0, 1.0, segments=36))
    is_side = np.abs(normals[:, 2]) < 0.5
    radial = vertices[is_side, :2] / np.linalg.norm(vertices[is_side, :2], axis=1, keepdims=True)
    assert (np.einsum("nd,nd->n", radial, normals[is_side, :2]) > 0.995).all()
    np.testing.assert_allclose(np.abs(normals[~is_side, 2]), 1.0, atol=1e-9)


def test_loft_follows_its_sections():
    solid = loft("shell", [Section(z=0, hx=1, hy=2), Section(z=3, hx=1, hy=2, cx=0.5)])
    assert solid.vertices[:, 0].min() == pytest.approx(-1.0)
    assert solid.vertices[:, 0].max() == pytest.approx(1.5)
    assert solid.vertices[:, 2].max() == 3
