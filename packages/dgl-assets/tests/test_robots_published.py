"""The written URDF and the tables against published numbers, with arithmetic of the test's own."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, HAND_MASS, HAND_POSES, SIDES

JOINT_NAMES = DEFAULT_ROBOT.joint_names
build_bimanual_urdf = DEFAULT_ROBOT.build_urdf

BASES = {"left": (-0.8, 0.0, 0.5, 0.3), "right": (1.25, 1.15, 0.45, np.pi / 2)}

# Universal Robots, UR10e: a [m], d [m], alpha [rad] (standard Denavit-Hartenberg).
UR_DH = (
    (0.0, 0.1807, np.pi / 2),
    (-0.6127, 0.0, 0.0),
    (-0.57155, 0.0, 0.0),
    (0.0, 0.17415, np.pi / 2),
    (0.0, 0.11985, -np.pi / 2),
    (0.0, 0.11655, 0.0),
)
UR_LIMITS = {  # degrees, degrees/s, N m
    "shoulder_pan_joint": (360, 120, 330),
    "shoulder_lift_joint": (360, 120, 330),
    "elbow_joint": (180, 180, 150),
    "wrist_1_joint": (360, 180, 54),
    "wrist_2_joint": (360, 180, 54),
    "wrist_3_joint": (360, 180, 54),
}
UR_MASSES = {
    "base_link": 4.0,
    "shoulder_link": 7.369,
    "upper_arm_link": 13.051,
    "forearm_link": 3.989,
    "wrist_1_link": 2.100,
    "wrist_2_link": 1.980,
    "wrist_3_link": 0.615,
}

# Shadow Hand, right: offset from the last joint [m], turn (axis, degrees), axis, limits [degrees].
_FINGER = {"J3": (0, "x", -15, 90), "J2": (0.045, "x", 0, 90), "J1": (0.025, "x", 0, 90)}
KNUCKLES = {
    "FF": ((0.033, 0, 0.095), (0, -1, 0)),
    "MF": ((0.011, 0, 0.099), (0, -1, 0)),
    "RF": ((-0.011, 0, 0.095), (0, 1, 0)),
    "LF": ((0, 0, 0.06579), (0, 1, 0)),
}
HAND_LIMITS = {
    "WRJ2": (-30, 10),
    "WRJ1": (-40, 28),
    "LFJ5": (0, 45),
    **{f"{f}J4": (-20, 20) for f in KNUCKLES},
    **{f"{f}{j}": row[2:] for f in KNUCKLES for j, row in _FINGER.items()},
    "THJ5": (-60, 60),
    "THJ4": (0, 70),
    "THJ3": (-12, 12),
    "THJ2": (-40, 40),
    "THJ1": (-15, 90),
}
HAND_MASSES = {
    "hand_forearm": 3.0,
    "wrist": 0.1,
    "palm": 0.3,
    "lf_metacarpal": 0.03,
    "th_base": 0.01,
    "th_proximal": 0.04,
    "th_hub": 0.005,
    "th_middle": 0.02,
    "th_distal": 0.017,
    **{
        f"{finger}_{part}": mass
        for finger in ("ff", "mf", "rf", "lf")
        for part, mass in (
            ("knuckle", 0.008),
            ("proximal", 0.030),
            ("middle", 0.017),
            ("distal", 0.013),
        )
    },
}


def _move(x=0.0, y=0.0, z=0.0):
    T = np.eye(4)
    T[:3, 3] = x, y, z
    return T


def _turn(axis, angle):
    """Rotation by the series of the exponential map, unlike the package's closed form."""
    x, y, z = np.asarray(axis, dtype=float)
    K = angle * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    R, term = np.eye(3), np.eye(3)
    for n in range(1, 40):
        term = term @ K / n
        R = R + term
    T = np.eye(4)
    T[:3, :3] = R
    return T


def _rpy(roll, pitch, yaw):
    return _turn((0, 0, 1), yaw) @ _turn((0, 1, 0), pitch) @ _turn((1, 0, 0), roll)


def _dh_tool(q):
    T = np.diag([-1.0, -1.0, 1.0, 1.0])  # the DH base is the ROS base turned half round
    for (a, d, alpha), theta in zip(UR_DH, q, strict=True):
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


def _right_tips(q, *, thumb="menagerie", metacarpal="palm frame"):
    """Fingertips in the frame of the forearm from the published table of offsets and axes."""
    palm = _move(0, -0.010, 0.21301) @ _turn((0, 1, 0), q["WRJ2"])
    palm = palm @ _move(0, 0, 0.034) @ _turn((1, 0, 0), q["WRJ1"])
    tips = {}
    for finger, (offset, axis) in KNUCKLES.items():
        T = palm
        if finger == "LF":
            if metacarpal == "palm frame":
                c, s = np.cos(np.radians(55)), np.sin(np.radians(55))
                T = T @ _move(-0.033, 0, 0.02071) @ _turn((c, 0, s), q["LFJ5"])
                T = T @ _move(*offset)
            else:  # in a frame turned by 55 degrees about y, as the other published model has it
                T = T @ _move(-0.033, 0, 0.02071) @ _turn((0, 1, 0), -np.radians(55))
                T = T @ _turn((1, 0, 0), q["LFJ5"]) @ _move(0.05397, 0, 0.03779)
                T = T @ _turn((0, 1, 0), np.radians(55))
        else:
            T = T @ _move(*offset)
        T = T @ _turn(axis, q[f"{finger}J4"])
        for joint, (length, _, _, _) in _FINGER.items():
            T = T @ _move(0, 0, length) @ _turn((1, 0, 0), q[f"{finger}{joint}"])
        tips[finger] = (T @ _move(0, 0, 0.026))[:3, 3]
    T = palm @ _move(0.034, -0.00858, 0.029)
    if thumb == "menagerie":
        T = T @ _turn((0, 1, 0), np.radians(45)) @ _turn((0, 0, -1), q["THJ5"])
        T = T @ _turn((1, 0, 0), q["THJ4"]) @ _move(0, 0, 0.038) @ _turn((1, 0, 0), q["THJ3"])
        T = T @ _turn((0, -1, 0), q["THJ2"]) @ _move(0, 0, 0.032)
        T = T @ _turn((0, 0, 1), -np.pi / 2) @ _turn((1, 0, 0), q["THJ1"])
    else:  # dex-urdf's way: the base turned by rpy, other axes
        T = T @ _rpy(-np.radians(45), 0, -np.pi / 2) @ _turn((0, 0, -1), q["THJ5"])
        T = T @ _turn((0, 1, 0), q["THJ4"]) @ _move(0, 0, 0.038) @ _turn((0, 1, 0), q["THJ3"])
        T = T @ _turn((1, 0, 0), q["THJ2"]) @ _move(0, 0, 0.032) @ _turn((1, 0, 0), q["THJ1"])
    tips["TH"] = (T @ _move(0, 0, 0.0275))[:3, 3]
    return tips


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("robots")
    path = build_bimanual_urdf(folder, left_base=BASES["left"], right_base=BASES["right"])
    return ET.parse(path).getroot()


def _numbers(element, key):
    return [float(v) for v in element.get(key).split()]


def _poses_of_the_file(robot, q):
    """Poses of all links by what the file says."""
    poses = {"root": np.eye(4)}
    for joint in robot.findall("joint"):
        origin = joint.find("origin")
        T = _move(*_numbers(origin, "xyz")) @ _rpy(*_numbers(origin, "rpy"))
        if joint.get("type") == "revolute":
            T = T @ _turn(_numbers(joint.find("axis"), "xyz"), q[joint.get("name")])
        poses[joint.find("child").get("link")] = poses[joint.find("parent").get("link")] @ T
    return poses


def _random_positions(seed):
    rng = np.random.default_rng(seed)
    limits = [
        np.radians(HAND_LIMITS.get(name.split("_", 1)[1], (-175, 175))) for name in JOINT_NAMES
    ]
    return {n: rng.uniform(*bounds) for n, bounds in zip(JOINT_NAMES, limits, strict=True)}


@pytest.mark.parametrize("seed", range(4))
def test_tool_and_fingertips_of_the_file_are_where_the_published_tables_say(robot, seed):
    q = _random_positions(seed)
    poses = _poses_of_the_file(robot, q)
    for side in SIDES:
        x, y, z, yaw = BASES[side]
        arm = [q[f"{side}_{name}"] for name in UR_LIMITS]
        tool = _move(x, y, z) @ _turn((0, 0, 1), yaw) @ _dh_tool(arm)
        ee = poses[f"{side}_ee"]
        assert np.abs(ee[:3, 3] - tool[:3, 3]).max() < 1e-6
        np.testing.assert_allclose(ee[:3, 0], tool[:3, 2], atol=1e-6)
        # Seen from the forearm, the left hand is the right one reflected in x.
        sign = -1 if side == "left" else 1
        hand = {name.partition("_")[2]: v for name, v in q.items() if name.startswith(side)}
        to_forearm = np.linalg.inv(poses[f"{side}_hand_forearm"])
        for finger, tip in _right_tips(hand).items():
            found = (to_forearm @ poses[f"{side}_{finger.lower()}_tip"])[:3, 3]
            assert np.abs(found - tip * [sign, 1, 1]).max() < 1e-6, (side, finger)


@pytest.mark.parametrize("pose", sorted(HAND_POSES))
def test_two_published_ways_to_write_thumb_and_metacarpal_agree(pose):
    names = [name.removeprefix("left_") for name in JOINT_NAMES[6:30]]
    q = dict(zip(names, HAND_POSES[pose], strict=True))
    first = _right_tips(q)
    other = _right_tips(q, thumb="dex-urdf", metacarpal="own frame")
    for finger in first:
        # the second model's metacarpal is 0.09 mm longer; everything else is the same chain
        bound = 1e-4 if finger == "LF" else 1e-12
        assert np.abs(first[finger] - other[finger]).max() < bound, finger


def test_limits_of_the_file_are_the_published_ones(robot):
    limits = {j.get("name"): j.find("limit") for j in robot.findall("joint[limit]")}
    assert set(limits) == set(JOINT_NAMES)
    for side in SIDES:
        for name, (low, high) in HAND_LIMITS.items():
            limit = limits[f"{side}_{name}"]
            assert float(limit.get("lower")) == pytest.approx(np.radians(low), abs=1e-6)
            assert float(limit.get("upper")) == pytest.approx(np.radians(high), abs=1e-6)
            assert 1.0 <= float(limit.get("effort")) <= 30.0
        for name, (angle, speed, torque) in UR_LIMITS.items():
            limit = limits[f"{side}_{name}"]
            assert float(limit.get("lower")) == pytest.approx(-np.radians(angle), abs=1e-6)
            assert float(limit.get("upper")) == pytest.approx(np.radians(angle), abs=1e-6)
            assert float(limit.get("velocity")) == pytest.approx(np.radians(speed), abs=1e-6)
            assert float(limit.get("effort")) == torque


def test_masses_of_the_file_are_the_published_ones(robot):
    assert HAND_MASS == HAND_MASSES
    masses = {
        link.get("name"): float(link.find("inertial/mass").get("value"))
        for link in robot.findall("link")
    }
    for side in SIDES:
        for name, mass in {**UR_MASSES, **HAND_MASSES}.items():
            assert masses.pop(f"{side}_{name}") == pytest.approx(mass), name
    # what is left are frames without a body
    assert sum(masses.values()) < 0.01


def test_inertias_of_the_file_are_physical(robot):
    for link in robot.findall("link"):
        i = {k: float(v) for k, v in link.find("inertial/inertia").items()}
        inertia = [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
        a, b, c = np.linalg.eigvalsh(inertia)
        assert a > 0, link.get("name")
        assert a + b >= 0.98 * c, link.get("name")  # published thin links round to the very edge
