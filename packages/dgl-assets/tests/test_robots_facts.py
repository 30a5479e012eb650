"""Tables of the robots: names and order, limits, masses, collision primitives."""

import numpy as np
import pytest

from dgl_assets.robots import (
    DEFAULT_ROBOT,
    HAND_MASS,
    HAND_POSES,
    SHADOW_HAND,
    SIDES,
    UR10E,
    CollisionShape,
)
from dgl_assets.robots._frames import (
    quaternion_from_rotation,
    rotation_about,
    rotation_from_quaternion,
    rpy_from_rotation,
)

JOINT_NAMES = DEFAULT_ROBOT.joint_names
joint_slice = DEFAULT_ROBOT.joint_slice


def collision_shapes(side):
    tree = DEFAULT_ROBOT.build_side_tree(side, (0.0, 0.0, 0.0, 0.0))
    return [shape for link in tree.links for shape in link.collision]


def test_joint_names_are_sixty_in_task_order():
    assert len(JOINT_NAMES) == len(set(JOINT_NAMES)) == 60
    assert JOINT_NAMES[0] == "left_shoulder_pan_joint"
    assert JOINT_NAMES[6:12] == tuple(
        f"left_{n}" for n in ("WRJ2", "WRJ1", "FFJ4", "FFJ3", "FFJ2", "FFJ1")
    )
    assert JOINT_NAMES[20] == "left_LFJ5"
    assert JOINT_NAMES[25:30] == tuple(f"left_THJ{k}" for k in (5, 4, 3, 2, 1))
    assert JOINT_NAMES[30:] == tuple(n.replace("left", "right") for n in JOINT_NAMES[:30])


def test_slices_tile_the_vector():
    seen = np.zeros(60, dtype=int)
    for side in SIDES:
        for part in ("arm", "hand"):
            seen[joint_slice(side, part)] += 1
            assert all(n.startswith(side) for n in JOINT_NAMES[joint_slice(side, part)])
    assert (seen == 1).all()
    with pytest.raises(ValueError, match="got 'wrist'"):
        joint_slice("left", "wrist")


def test_tree_moves_the_joints_in_the_same_order():
    assert DEFAULT_ROBOT.build_tree().moving_joint_names == JOINT_NAMES


def test_home_is_mirrored_and_read_only():
    left, right = (DEFAULT_ROBOT.arm.home[side] for side in SIDES)
    # Reflection of a UR arm: pan, elbow, wrist_2 change sign; lift and wrist_1 become -pi - q.
    np.testing.assert_allclose(right[[0, 2, 4]], -left[[0, 2, 4]])
    np.testing.assert_allclose(right[[1, 3]], -np.pi - left[[1, 3]], atol=5e-3)
    with pytest.raises(ValueError, match="read-only"):
        left[0] = 0.0


def test_hand_poses_lie_within_the_hand_limits():
    lower = np.array([j.lower for j in SHADOW_HAND])
    upper = np.array([j.upper for j in SHADOW_HAND])
    assert set(HAND_POSES) == {"open", "close", "pinch", "cradle", "smooth", "flat"}
    for name, pose in HAND_POSES.items():
        assert pose.shape == (24,)
        # The poses are rounded to six digits, and some sit on a limit.
        assert (pose >= lower - 1e-6).all(), name
        assert (pose <= upper + 1e-6).all(), name


def test_hand_limits_in_degrees():
    limits = {j.name: tuple(np.round(np.degrees((j.lower, j.upper)), 6)) for j in SHADOW_HAND}
    assert limits["WRJ2"] == (-30, 10)
    assert limits["WRJ1"] == (-40, 28)
    assert limits["LFJ5"] == (0, 45)
    assert limits["THJ4"] == (0, 70)
    assert {limits[f"{f}J3"] for f in ("FF", "MF", "RF", "LF")} == {(-15, 90)}


def test_arm_limits_and_masses():
    assert [round(np.degrees(j.speed)) for j in UR10E] == [120, 120, 180, 180, 180, 180]
    assert [j.torque for j in UR10E] == [330, 330, 150, 54, 54, 54]
    assert sum(j.mass for j in UR10E) == pytest.approx(29.104)
    for joint in UR10E:
        ixx, iyy, izz, ixy, ixz, iyz = joint.inertia
        eigenvalues = np.linalg.eigvalsh([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])
        assert eigenvalues[0] > 0
        # A thin link may round to the triangle inequality's edge.
        assert eigenvalues[0] + eigenvalues[1] >= 0.98 * eigenvalues[2]


def test_hand_weighs_what_its_maker_says():
    assert sum(HAND_MASS.values()) == pytest.approx(3.8, abs=0.05)
    assert {j.child for j in SHADOW_HAND} == set(HAND_MASS) - {"hand_forearm"}


def test_drives_keep_published_torques_and_finger_gains():
    arm = DEFAULT_ROBOT.arm
    assert [gains.force_limit for gains in arm.gains] == [joint.torque for joint in UR10E]
    hand = dict(zip((joint.name for joint in SHADOW_HAND), DEFAULT_ROBOT.hand.gains, strict=True))
    assert hand["LFJ5"].stiffness == 1
    assert hand["THJ2"].stiffness == 1.5
    assert hand["WRJ2"].force_limit == 10


def test_unknown_side_is_refused():
    with pytest.raises(ValueError, match="'middle'"):
        collision_shapes("middle")


def test_fingertip_capsules_end_at_the_tips():
    for side in SIDES:
        shapes = {s.link: s for s in collision_shapes(side)}
        for link, tip in ((f"{side}_ff_distal", 0.026), (f"{side}_th_distal", 0.0275)):
            s = shapes[link]
            assert s.kind == "capsule"
            assert s.xyz[2] + s.half_length + s.radius == pytest.approx(tip)
            assert s.xyz[2] - s.half_length == pytest.approx(0.0)


def test_left_shapes_are_reflections_in_the_hand_and_equal_on_the_arm():
    left, right = collision_shapes("left"), collision_shapes("right")
    assert len(left) == len(right)
    for a, b in zip(left, right, strict=True):
        name = a.link.removeprefix("left_")
        assert name == b.link.removeprefix("right_")
        sign = -1 if name in HAND_MASS else 1
        assert a.xyz == (sign * b.xyz[0], b.xyz[1], b.xyz[2])
        assert (a.kind, a.radius, a.half_length, a.half_size) == (
            b.kind,
            b.radius,
            b.half_length,
            b.half_size,
        )


def test_arm_tubes_span_their_joints():
    """The tubes' segments run from joint to joint within 3 cm."""
    tubes = [s for s in collision_shapes("left") if abs(s.wxyz[2]) > 0.5 and "arm_link" in s.link]
    for shape, length in zip(tubes, (0.6127, 0.57155), strict=True):
        R = rotation_from_quaternion(np.array(shape.wxyz))
        ends = [np.array(shape.xyz) + s * shape.half_length * R[:, 2] for s in (-1, 1)]
        xs = sorted(e[0] for e in ends)
        assert xs[1] == pytest.approx(0.0, abs=0.03)
        assert xs[0] == pytest.approx(-length, abs=0.03)


def test_bad_shapes_are_refused():
    with pytest.raises(ValueError, match="cone"):
        CollisionShape(link="a", kind="cone")
    with pytest.raises(ValueError, match="positive"):
        CollisionShape(link="a", kind="capsule", radius=0.01)


def test_rotation_conversions_round_trip():
    rng = np.random.default_rng(3)
    cases = [rotation_about(rng.normal(size=3), rng.uniform(-np.pi, np.pi)) for _ in range(50)]
    cases += [rotation_about((0, 1, 0), s * np.pi / 2) for s in (-1, 1)]  # gimbal lock
    cases += [np.diag([-1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0]), np.eye(3)]
    for R in cases:
        roll, pitch, yaw = rpy_from_rotation(R)
        again = (
            rotation_about((0, 0, 1), yaw)
            @ rotation_about((0, 1, 0), pitch)
            @ rotation_about((1, 0, 0), roll)
        )
        np.testing.assert_allclose(again, R, atol=1e-9)
        np.testing.assert_allclose(
            rotation_from_quaternion(quaternion_from_rotation(R)), R, atol=1e-9
        )
