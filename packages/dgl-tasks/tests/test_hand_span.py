"""Coordinates of a hand: weights of its named poses."""

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT
from dgl_tasks.hand_span import HandPoseActions, HandSpan


def test_named_poses_have_their_own_coordinate():
    span = HandSpan(DEFAULT_ROBOT)
    assert span.to_coordinates(DEFAULT_ROBOT.get_hand_pose("open")) == pytest.approx(np.zeros(5))
    poses = np.stack([DEFAULT_ROBOT.get_hand_pose(name) for name in span.names])
    assert span.to_coordinates(poses) == pytest.approx(np.eye(5), abs=1e-9)
    assert span.to_joints(np.eye(5)) == pytest.approx(poses)


def test_mixtures_come_back_and_other_joints_go_to_the_nearest_mixture():
    span, rng = HandSpan(DEFAULT_ROBOT), np.random.default_rng(0)
    weights = rng.uniform(0, 1, (7, 5))
    assert span.to_coordinates(span.to_joints(weights)) == pytest.approx(weights)
    joints = rng.uniform(-1, 1, 24)
    nearest = span.to_joints(span.to_coordinates(joints))
    distance = np.linalg.norm(joints - nearest)
    for _ in range(20):
        other = span.to_joints(span.to_coordinates(joints) + rng.normal(0, 0.1, 5))
        assert np.linalg.norm(joints - other) > distance > 0


def test_actions_hold_arms_and_hand_poses_exactly_and_other_fingers_nearly():
    actions, rng = HandPoseActions(DEFAULT_ROBOT), np.random.default_rng(1)
    assert len(actions.names) == 22
    assert actions.names[6:11] == tuple(f"left_hand_{name}" for name in HandSpan.names)
    assert actions.bounds[:, 6:11].tolist() == [[0] * 5, [1] * 5]
    joints = rng.uniform(-1, 1, (3, 60))
    for side in ("left", "right"):
        close, pinch = (DEFAULT_ROBOT.get_hand_pose(name) for name in ("close", "pinch"))
        share = rng.uniform(0, 1, (3, 1))
        joints[:, DEFAULT_ROBOT.joint_slice(side, "hand")] = share * close + (1 - share) * pinch
    assert actions.to_joints(actions.from_joints(joints)) == pytest.approx(joints, abs=3e-5)
    joints[0, 7] += 0.2  # one finger of the left hand leaves the span
    back = actions.to_joints(actions.from_joints(joints))
    assert back[:, 30:] == pytest.approx(joints[:, 30:], abs=3e-5)
    assert 0.05 < np.abs(back[0] - joints[0]).max() < 0.2
    short = actions.from_joints(joints).astype(np.float32)
    long = actions.to_joints(short).astype(np.float32)
    np.testing.assert_array_equal(actions.from_joints(long).astype(np.float32), short)
