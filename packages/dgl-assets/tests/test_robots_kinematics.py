"""Forward kinematics against independent arithmetic."""

import numpy as np
import pytest

from dgl_assets.robots import (
    DEFAULT_ROBOT,
    HAND_POSES,
    HAND_TIPS,
    SIDES,
)
from dgl_assets.robots.hand import HAND_MASS

build_side_tree = DEFAULT_ROBOT.build_side_tree

# Universal Robots' published standard Denavit-Hartenberg table: a, d, alpha.
UR_TABLE = (
    (0.0, 0.1807, np.pi / 2),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, np.pi / 2),
    (0.0, 0.11985, -np.pi / 2),
    (0.0, 0.11655, 0.0),
)
REFLECT_X = np.diag([-1.0, 1.0, 1.0])


def _dh_flange(q):
    T = np.diag([-1.0, -1.0, 1.0, 1.0])  # the DH base is the ROS base turned half round
    for (a, d, alpha), theta in zip(UR_TABLE, q, strict=True):
        ct, st, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        T = T @ np.array(
            [
                [ct, -st * ca, st * sa, a * ct],
                [st, ct * ca, -ct * sa, a * st],
                [0, sa, ca, d],
                [0, 0, 0, 1],
            ]
        )
    return T


def _poses(side, arm_q, hand_q, base=(0.0, 0.0, 0.0, 0.0)):
    tree = build_side_tree(side, base)
    return tree.compute_link_poses(
        dict(zip(tree.moving_joint_names, np.concatenate([arm_q, hand_q]), strict=True))
    )


def test_arm_agrees_with_denavit_hartenberg():
    rng = np.random.default_rng(0)
    for q in [np.zeros(6), *rng.uniform(-np.pi, np.pi, (20, 6))]:
        flange = _dh_flange(q)
        ee = _poses("left", q, np.zeros(24))["left_ee"]
        np.testing.assert_allclose(ee[:3, 3], flange[:3, 3], atol=1e-12)
        # ee x = flange z, ee y = -flange x, ee z = -flange y
        expected = np.column_stack([flange[:3, 2], -flange[:3, 0], -flange[:3, 1]])
        np.testing.assert_allclose(ee[:3, :3], expected, atol=1e-12)


def test_base_placement_moves_everything():
    q, base = np.array([0.3, -1.0, 1.2, 0.4, -0.7, 0.9]), (1.25, 1.15, 0.45, np.pi / 2)
    at_origin = _poses("right", q, np.zeros(24))["right_ff_tip"]
    placed = _poses("right", q, np.zeros(24), base)["right_ff_tip"]
    x, y, z = at_origin[:3, 3]
    np.testing.assert_allclose(placed[:3, 3], (1.25 - y, 1.15 + x, 0.45 + z), atol=1e-12)


def test_home_holds_both_hands_forward_between_the_bases():
    home = zip(DEFAULT_ROBOT.joint_names, DEFAULT_ROBOT.compute_start(), strict=True)
    poses = DEFAULT_ROBOT.build_tree().compute_link_poses(dict(home))
    for side, sign in zip(SIDES, (-1, 1), strict=True):
        ee = poses[f"{side}_ee"]
        assert ee[1, 0] > 0.99, "fingers point to +y"
        assert 0.4 < sign * ee[0, 3] < 0.8
        assert 0.5 < ee[2, 3] < 0.7


@pytest.mark.parametrize("pose", sorted(HAND_POSES))
def test_hands_with_equal_joints_are_reflections(pose):
    """Every link of the left hand, seen from its forearm, is the right one reflected in x."""
    inside = {}
    for side in SIDES:
        poses = _poses(side, np.zeros(6), HAND_POSES[pose])
        to_forearm = np.linalg.inv(poses[f"{side}_hand_forearm"])
        inside[side] = {k.removeprefix(f"{side}_"): to_forearm @ T for k, T in poses.items()}
    for link in (*HAND_MASS, *HAND_TIPS):
        left, right = inside["left"][link], inside["right"][link]
        np.testing.assert_allclose(left[:3, 3], REFLECT_X @ right[:3, 3], atol=1e-12)
        np.testing.assert_allclose(
            left[:3, :3], REFLECT_X @ right[:3, :3] @ REFLECT_X, atol=1e-12, err_msg=link
        )


@pytest.mark.parametrize(("pose", "depth"), [("open", 0.062), ("flat", 0.0)])
def test_a_flat_hand_has_its_thumb_beside_the_palm_instead_of_before_it(pose, depth):
    poses = _poses("left", np.zeros(6), HAND_POSES[pose])
    thumb = np.linalg.inv(poses["left_ee"]) @ poses["left_th_tip"]
    assert thumb[1, 3] == pytest.approx(depth, abs=0.01)  # y is out of the palm


def test_finger_lengths_and_reach():
    poses = _poses("right", np.zeros(6), np.zeros(24))
    to_forearm = np.linalg.inv(poses["right_hand_forearm"])

    def point(link):
        return (to_forearm @ poses[f"right_{link}"])[:3, 3]

    for finger in ("ff", "mf", "rf", "lf"):
        assert np.linalg.norm(point(f"{finger}_tip") - point(f"{finger}_knuckle")) == pytest.approx(
            0.045 + 0.025 + 0.026
        )
    assert np.linalg.norm(point("th_tip") - point("th_base")) == pytest.approx(
        0.038 + 0.032 + 0.0275
    )
    # The tasks' grasp point lies 28 mm beyond the knuckle of the first finger.
    assert 0.37 - point("ff_knuckle")[2] == pytest.approx(0.028, abs=1e-3)


@pytest.mark.parametrize("side", SIDES)
def test_palm_and_thumb_follow_the_ee_axes(side):
    """The palm faces ee y; the thumb is on ee +z of the right hand and on ee -z of the left."""
    poses = _poses(side, np.zeros(6), np.zeros(24))
    ee = np.linalg.inv(poses[f"{side}_ee"])
    fingertip = (ee @ poses[f"{side}_mf_tip"])[:3, 3]
    thumb = (ee @ poses[f"{side}_th_tip"])[:3, 3]
    curled = np.zeros(24)
    curled[7] = np.pi / 2  # MFJ3
    bent = (ee @ _poses(side, np.zeros(6), curled)[f"{side}_mf_tip"])[:3, 3]
    assert fingertip[0] == pytest.approx(0.21301 + 0.034 + 0.099 + 0.096)
    assert bent[1] - fingertip[1] == pytest.approx(0.096), "fingers close towards ee y"
    assert thumb[2] * (1 if side == "right" else -1) > 0.05


def test_standard_grasp_turns_the_palm_down():
    """Orientation of the fold tasks: fingers horizontal, 20 degrees inward, palm to the ground."""
    w, x, y, z = np.array([0.579, -0.579, -0.406, 0.406]) / np.linalg.norm(
        [0.579, -0.579, -0.406, 0.406]
    )
    R = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    poses = _poses("left", np.zeros(6), np.zeros(24))
    palm_in_ee = np.linalg.inv(poses["left_ee"])[:3, :3] @ poses["left_palm"][:3, :3]
    np.testing.assert_allclose(R @ palm_in_ee @ (0, -1, 0), (0, 0, -1), atol=2e-3)
    np.testing.assert_allclose(R @ palm_in_ee @ (0, 0, 1), (0.341, 0.940, 0), atol=2e-3)


def test_missing_joint_is_named():
    tree = build_side_tree("left", (0, 0, 0, 0), with_hand=False)
    with pytest.raises(ValueError, match="left_wrist_3_joint"):
        tree.compute_link_poses(dict.fromkeys(tree.moving_joint_names[:5], 0.0))
