"""Faulty robot descriptions in use: no mass, no inertia, rods without thickness."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest

from dgl_assets.robots.importing import import_robot, load_robot
from dgl_assets.robots.importing.convert import compute_moments
from dgl_assets.robots.importing.masses import SMALL_MASS, SMALL_RADIUS, THIN, settle_masses
from dgl_assets.robots.importing.read_urdf import read_urdf

_PATH = Path(__file__).parent / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)

pytestmark = pytest.mark.usefixtures("rest_poses")
HAND = samples.sixteen_joint_hand()


def inertial(mass, moments=(0, 0, 0), com=(0, 0, 0)):
    xx, yy, zz = moments
    return (
        f'<inertial><origin xyz="{com[0]} {com[1]} {com[2]}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def replace_inertial(text, link, new):
    """The text with another inertial of a link."""
    pattern = rf'(<link name="{link}">)<inertial>.*?</inertial>'
    assert re.search(pattern, text)
    return re.sub(pattern, rf"\g<1>{new}", text)


def read(tmp_path, text):
    (tmp_path / "r.urdf").write_text(text)
    return read_urdf(tmp_path / "r.urdf")


def with_tips(text, mass=0.002):
    """Tips of zero inertia on three fingers, as dex-urdf writes them."""
    parts = ""
    for finger in ("index", "middle", "ring"):
        parts += f'<link name="{finger}_tip">{inertial(mass)}</link>'
        parts += samples.joint(
            f"{finger}_t", f"{finger}_3", f"{finger}_tip", "fixed", xyz="0 0 0.03"
        )
    return text.replace("</robot>", parts + "</robot>")


def test_tips_of_zero_inertia_count_as_points_of_their_finger(tmp_path):
    (tmp_path / "h.urdf").write_text(with_tips(HAND))
    report = import_robot(tmp_path / "h.urdf", name="h", out=tmp_path / "out", kind="hand")
    (note,) = [note for note in report.assumptions if "inertia" in note]
    assert note.endswith("what they are fixed to: index_tip, middle_tip, ring_tip")
    tree = load_robot("h", tmp_path / "out").hand.trees["right"]
    masses = {link.name: link.mass for link in tree.links}
    assert masses["h_index_3"] == pytest.approx(0.03 + 0.002)
    assert masses["h_index_tip"] == 0.0


def test_a_point_moves_centre_and_inertia_as_the_parallel_axis_theorem_says(tmp_path):
    parts = [
        samples.link("base", 1.0),
        f'<link name="body">{inertial(2.0, (0.02, 0.03, 0.04), (0, 0, 0.1))}</link>',
        samples.joint("turn", "base", "body", axis="0 0 1", limit=(-1, 1, 1, 1)),
        f'<link name="arm">{inertial(0.5, com=(0.1, 0, 0))}</link>',
        samples.joint("fix", "body", "arm", "fixed", xyz="0 0.2 0", rpy="0 0 1.5707963267948966"),
    ]
    robot, notes = settle_masses(read(tmp_path, samples.robot("r", *parts)))
    body = next(link for link in robot.links if link.name == "body")
    place = np.array([0, 0.3, 0])  # 0.1 along x of a link that is turned by 90 degrees
    assert body.mass == 2.5
    centre = (2.0 * np.array([0, 0, 0.1]) + 0.5 * place) / 2.5
    assert body.inertial_to_link[:3, 3] == pytest.approx(centre)

    def about(point):
        """Inertia of both parts about a point, by its definition."""
        total = np.diag([0.02, 0.03, 0.04])
        for mass, at in ((2.0, np.array([0, 0, 0.1])), (0.5, place)):
            arm = at - point
            total = total + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return total

    assert body.inertia == pytest.approx(about(centre))
    assert len(notes) == 1


@pytest.mark.parametrize("new", ["", inertial(0, (1, 1, 1))])
def test_links_that_move_without_mass_get_a_small_one(new, tmp_path):
    text = replace_inertial(replace_inertial(HAND, "index_1", new), "index_3", new)
    (tmp_path / "h.urdf").write_text(text)
    report = import_robot(tmp_path / "h.urdf", name="h", out=tmp_path / "out", kind="hand")
    (note,) = [note for note in report.assumptions if "mass" in note]
    assert note.endswith(f"get {SMALL_MASS:g} kg: index_1, index_3")
    hand = load_robot("h", tmp_path / "out").hand
    links = {link.name: link for link in hand.trees["right"].links}
    assert links["h_index_1"].mass == pytest.approx(SMALL_MASS)
    assert (compute_moments(hand.trees["right"], [0.0] * 16) > 0).all()


def test_a_link_that_moves_as_a_point_gets_the_inertia_of_a_ball(tmp_path):
    robot, notes = settle_masses(read(tmp_path, replace_inertial(HAND, "thumb_2", inertial(0.05))))
    link = next(link for link in robot.links if link.name == "thumb_2")
    assert link.mass == 0.05
    assert link.inertia == pytest.approx(0.4 * 0.05 * SMALL_RADIUS**2 * np.eye(3))
    assert notes == ["links without inertia in the file get that of a ball of 2 cm radius: thumb_2"]


def test_a_rod_without_thickness_gets_some(tmp_path):
    text = replace_inertial(HAND, "thumb_2", inertial(0.05, (0, 1e-5, 1e-5)))
    robot, notes = settle_masses(read(tmp_path, text))
    link = next(link for link in robot.links if link.name == "thumb_2")
    assert np.linalg.eigvalsh(link.inertia) == pytest.approx([THIN * 1e-5, 1e-5, 1e-5])
    assert notes == [
        "links whose inertia has no thickness in the file get 0.001 of their largest moment: "
        "thumb_2"
    ]


def test_a_link_without_mass_between_others_is_no_matter(tmp_path):
    """Frames fixed to a link with mass stay, and the written robot can be read again."""
    arm = samples.six_joint_arm()
    (tmp_path / "a.urdf").write_text(arm)
    robot, notes = settle_masses(read(tmp_path, arm))
    assert notes == []
    assert next(link for link in robot.links if link.name == "tool0").mass == 0.0


def test_a_thumb_is_known_by_its_name_where_another_finger_begins_lower(tmp_path):
    """The little finger of the Shadow Hand begins below its thumb."""
    lower = HAND.replace('<origin xyz="0 -0.0435 0"', '<origin xyz="0 -0.0435 -0.08"')
    assert lower != HAND
    for number, (text, expected) in enumerate(
        ((lower, "thumb_3"), (lower.replace("thumb_", "pollex_"), "ring_3"))
    ):
        (tmp_path / "h.urdf").write_text(text)
        name = f"h{number}"
        report = import_robot(tmp_path / "h.urdf", name=name, out=tmp_path / "out", kind="hand")
        (note,) = [note for note in report.assumptions if "thumb first" in note]
        assert f"end in {name}_{expected}" in note
