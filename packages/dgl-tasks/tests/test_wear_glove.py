"""A glove on its stand, the rule in an environment, and hands to which the rim sticks."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets.importing.topology import find_loops
from dgl_assets.props import GloveStandParameters, PersonParameters
from dgl_assets.robots import SIDES
from dgl_physics import ClothMaterial
from dgl_tasks.declaration import SceneObject, Start
from dgl_tasks.enclosing import EnclosesHand
from dgl_tasks.grasps import grasp_to_wrist, orient
from dgl_tasks.rim_grip import RimGrip

STAND = GloveStandParameters(height=0.5, foot_radius=0.09)
CUFF = ("back_cuff", "palm_cuff")
TASK = replace(
    dgl_tasks.get_task("HangTops-v1"),
    category="Glove",
    measures={"hand": "right", "cuff_ratio": (1.15, 1.35), "cuff_length": (0.045, 0.2)},
    start=Start(
        on="stand.foot",
        level="thumb_heel",
        yaw=-np.pi / 2,
        roll_range=(np.pi / 2, np.pi / 2),
        height=STAND.height - 0.024,
        settle_frames=90,
    ),
    objects=(
        SceneObject(
            name="stand",
            prop=STAND,
            position=(0.0, 0.42, 0.0),
            x_range=(-0.05, 0.05),
            friction=0.05,
            solid_to="garment",
        ),
        SceneObject(
            name="person",
            prop=PersonParameters(pose="offer_right"),
            position=(0.371, 0.852, 0.0),
            solid_to="garment",
        ),
    ),
    material=ClothMaterial(friction=1.0, bending_stiffness=1e-4, particle_adhesion_scale=0.0),
    stiffness=dict.fromkeys(CUFF, 300.0),
    rim_grip=0.04,
    success=EnclosesHand(frame="person.right_hand", hand="person.right"),
)
REACH = TASK.rim_grip


@pytest.fixture(scope="module")
def env():
    made = gymnasium.make("HangTops-v1", task=TASK, obs_mode="none", render_backend="none")
    yield made.unwrapped
    made.close()


@pytest.fixture(scope="module")
def start(env):
    """Begin an episode, and give its rim: indices and places [m]."""
    env.reset(seed=0)
    rim = find_loops(env.garment.faces)[0]
    return rim, env.get_particles()[rim]


def test_the_glove_stands_upright_and_open(env, start):
    """Its thumb is level with the boards, and both sides of the rim are apart and over them."""
    _, places = start
    marks = env.garment.landmarks
    stand = env.get_frames()["stand"]["target"]
    heel = env.get_particles()[marks["thumb_heel"]]
    assert heel[2] == pytest.approx(stand[2] - 0.024, abs=0.02)
    assert places[:, 2].min() > stand[2]
    assert np.ptp(places[:, 0]) > 0.02
    verdict = env.judge()
    assert [c.value for c in verdict.criteria[:2]] == [0, 0]
    assert verdict.reason == "not put on"


def _pose_hands(env, rim):
    """Poses of `ee` whose grasp points are at both ends of the rim in x, shape (2, 7)."""
    return _pose_hands_at(rim[[rim[:, 0].argmin(), rim[:, 0].argmax()]])


def _pose_hands_at(ends):
    quaternions = [orient("standard", side) for side in SIDES]
    wrists = [grasp_to_wrist(p, q, s) for p, q, s in zip(ends, quaternions, SIDES, strict=True)]
    return np.array([[*w, *q] for w, q in zip(wrists, quaternions, strict=True)])


def _measure_along(places, k):
    """Distance of each vertex of a closed line from the vertex `k`, along the line [m]."""
    steps = np.linalg.norm(np.diff(places, axis=0, append=places[:1]), axis=1)
    ways = np.array([steps[np.arange(k, k + n) % len(steps)].sum() for n in range(len(steps))])
    return np.roll(np.minimum(ways, steps.sum() - ways), k)


def _set_hands(env, pose):
    model = env.agent.model
    targets = model.compute_start("open")
    for side in SIDES:
        targets[model.joint_slice(side, "hand")] = model.get_hand_pose(pose)
    return targets


@pytest.mark.parametrize("pose", ["close", "pinch"])
def test_the_rim_sticks_to_closed_hands_until_they_open(env, start, pose):
    rim, places = start
    state = env.get_state_dict()
    grip = RimGrip(env.garment.faces, REACH, env.agent.model)
    hands = _pose_hands(env, places)
    near = rim[_measure_along(places, places[:, 0].argmin()) <= REACH]
    before = env.get_particles()[near, 2]

    grip.update(env.cloth, hands, _set_hands(env, "open"))
    assert grip.counts == {"left": 0, "right": 0}
    grip.update(env.cloth, hands, _set_hands(env, pose))
    assert grip.counts["left"] == len(near) > 2
    assert grip.counts["right"] > 2
    for _ in range(30):  # 6 cm up
        hands[:, 2] += 0.002
        grip.update(env.cloth, hands, _set_hands(env, pose))
        env.cloth.step()
    risen = env.get_particles()[near, 2] - before
    np.testing.assert_allclose(risen, 0.06, atol=1e-5)

    again = RimGrip(env.garment.faces, REACH, env.agent.model)
    again.write_state(grip.read_state())
    assert again.counts == grip.counts
    again.update(env.cloth, hands, _set_hands(env, "open"))
    for _ in range(30):
        env.cloth.step()
    assert (env.get_particles()[near, 2] < before + 0.05).all()
    env.set_state_dict(state)


def test_a_state_with_a_held_rim_goes_on_alike(env, start):
    _, places = start
    state = env.get_state_dict()
    hands = _pose_hands(env, places)
    env._rim_grip.update(env.cloth, hands, _set_hands(env, "close"))
    env._target = _set_hands(env, "close")
    held = env.get_state_dict()
    assert held["garment"]["rim_grip"].any()
    ends = []
    hands[:, 2] += 0.01
    for restored in (False, True):
        if restored:
            env.set_state_dict(held)
        env._rim_grip.update(env.cloth, hands, env._target)
        env.cloth.step()
        ends.append(env.get_particles())
    np.testing.assert_array_equal(*ends)
    env.set_state_dict(state)
    env.cloth.step()
    assert not env._rim_grip.read_state().any()


def test_a_hand_that_closed_on_nothing_takes_nothing_after_a_restore(env, start):
    _, places = start
    hands = _pose_hands(env, places)
    grip = RimGrip(env.garment.faces, REACH, env.agent.model)
    above = hands.copy()
    above[:, 2] += 0.5
    grip.update(env.cloth, above, _set_hands(env, "close"))
    again = RimGrip(env.garment.faces, REACH, env.agent.model)
    again.write_state(grip.read_state())
    again.update(env.cloth, hands, _set_hands(env, "close"))
    assert again.counts == {"left": 0, "right": 0}


def test_two_hands_at_one_place_hold_different_vertices(env, start):
    _, places = start
    grip = RimGrip(env.garment.faces, REACH, env.agent.model)
    grip.update(env.cloth, _pose_hands_at(places[[3, 3]]), _set_hands(env, "close"))
    left, right = (grip._held[side][0] for side in SIDES)
    assert len(left) > 2
    assert not set(left) & set(right)


def test_contact_alone_is_the_default():
    assert dgl_tasks.get_task("HangTops-v1").rim_grip is None
    with pytest.raises(ValueError, match="rim_grip"):
        replace(TASK, rim_grip=-0.01)
