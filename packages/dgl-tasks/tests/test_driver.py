"""One episode is stepped, filmed and told, and truth is kept beside beliefs."""

import dataclasses
from functools import partialmethod
from itertools import zip_longest

import gymnasium
import numpy as np
import pytest

import dgl_tasks
from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks.driver import PASSAGE_FILM_STEPS, Driver
from dgl_tasks.grasps import GRASP_ORIENTATIONS
from dgl_tasks.hand_span import HandPoseActions
from dgl_tasks.handling import Handling, plan_approach
from dgl_tasks.messages import BeginsAgain, Believes, Carrying, Command, StageEnds
from dgl_tasks.observation import STEPS_PER_ACTION
from dgl_tasks.policy import FromStart
from dgl_tasks.sensing import Sensed

joint_slice = DEFAULT_ROBOT.joint_slice

TASK = dgl_tasks.get_task("FoldTops-v1")
GARMENT = "Tops_LongSleeve/000000"
POINT = {"left": np.array([-0.4, 0.7, 0.1])}
STANDARD = {"left": GRASP_ORIENTATIONS["standard"]["left"]}


# Courses ---------------------------------------------------------------------------------------


def wander(sensed, number, steps, *, marks=True):
    """A course whose commands depend on what is sensed before each of them."""
    for _ in range(steps):
        target = sensed.joint_state + 0.1 * number + 0.01 * sensed.step
        sensed = yield Command(target)
        if marks and sensed.step % 3 == 0:
            sensed = yield Believes(values={"step": float(sensed.step)})


def test_a_course_is_sent_what_is_sensed_after_each_step(make_env):
    env = make_env()
    driver = Driver(env, seed=4)
    steps = []

    def course(sensed):
        for _ in range(3):
            steps.append((sensed.step, sensed.seed, float(sensed.joint_state[0])))
            sensed = yield Command(np.full(60, 0.5))
        steps.append((sensed.step, sensed.seed, float(sensed.joint_state[0])))

    driver.drive(course(driver.reset("tops/1")))
    assert env.resets == [(4, {"garment": "tops/1"})]
    # the arms come half way to the target in each step
    assert steps == [(0, 4, 0.0), (1, 4, 0.25), (2, 4, 0.375), (3, 4, 0.4375)]
    assert [command.dtype for command in driver.commands] == [np.float32] * 3
    np.testing.assert_array_equal(driver.commands, env.sent)


def test_each_command_is_given_once_its_step_is_made(make_env):
    env = make_env()
    driver = Driver(env, seed=0)
    course = driver.follow(wander(driver.reset(), 1, 4))
    assert env.resets == [(0, {})]
    assert env.sent == []  # nothing is done before it is asked for
    for number, command in enumerate(course, start=1):
        assert isinstance(command, Command)  # and no mark
        assert len(env.sent) == len(driver.commands) == number
        np.testing.assert_array_equal(env.sent[-1], command.target.astype(np.float32))
    assert number == 4


def test_courses_in_one_loop_go_on_as_each_does_alone(make_env):
    """Two environments, one after the other and in turns, for courses of different lengths."""
    numbers, lengths = (1, 2), (12, 7)

    def begin(number, steps):
        driver = Driver(make_env(), seed=number)
        return driver, driver.follow(wander(driver.reset(), number, steps))

    alone = []
    for number, steps in zip(numbers, lengths, strict=True):
        driver, course = begin(number, steps)
        assert len(list(course)) == steps
        alone.append(driver)
    together = [begin(number, steps) for number, steps in zip(numbers, lengths, strict=True)]
    order = []
    for driver, _ in together:
        advance = driver.env.advance

        def note(target, number=driver.seed, advance=advance):
            order.append(number)
            advance(target)

        driver.env.advance = note
    for _ in zip_longest(*(course for _, course in together)):
        pass
    for one, (other, _) in zip(alone, together, strict=True):
        np.testing.assert_array_equal(other.commands, one.commands)
        np.testing.assert_array_equal(other.env.sent, one.env.sent)
        assert other.beliefs == one.beliefs
    assert order == [1, 2] * 7 + [1] * 5  # each step is made when it is asked for
    assert not np.array_equal(alone[0].commands[:7], alone[1].commands)


def test_commands_are_brought_into_the_control_mode_and_kept_as_they_were_sent(make_env):
    env, converter = make_env(), HandPoseActions(DEFAULT_ROBOT)
    env.agent.control_mode = "pd_hand_poses"
    env.agent.make_action, env.agent.read_targets = converter.from_joints, converter.to_joints
    env.advance = env.sent.append
    notes = Notes()
    driver = Driver(env, seed=0, listener=notes)
    target = DEFAULT_ROBOT.compute_start("pinch")
    target[joint_slice("right", "hand")][3] += 0.3  # no pose bends one finger alone
    driver.step(Command(target))
    (action,), (command,) = env.sent, driver.commands
    assert action.shape == (22,)
    np.testing.assert_allclose(command, converter.to_joints(action), atol=1e-6)
    np.testing.assert_array_equal(notes.told[0][0].target, command)
    np.testing.assert_allclose(command[:30], target[:30], atol=3e-5)
    assert 0.05 < np.abs(command - target).max() < 0.3


def test_an_error_of_a_course_is_nobody_elses(make_env):
    def course():
        yield Command(np.zeros(60))
        raise ValueError("no such stage")

    driver = Driver(make_env(), seed=0)
    with pytest.raises(ValueError, match="no such stage"):
        driver.drive(course())
    assert len(driver.commands) == 1


# Marks -----------------------------------------------------------------------------------------


class Notes:
    """Notes all it is told, and the control step."""

    def __init__(self):
        self.told = []

    def before_step(self, command, look):
        self.told.append((command, look().step))

    def note(self, mark, sensed):
        self.told.append((mark, sensed.step))


def test_a_listener_is_told_all_in_order_and_commands_before_their_step(make_env):
    items = [
        Believes(values={"value": 0.1}),
        Command(np.zeros(60), "approach", is_passage=True),
        StageEnds(name="fold", counts=True),
        Command(np.ones(60), "stage"),
    ]
    notes, env = Notes(), make_env()
    before = []
    notes.before_step = lambda command, look: (
        notes.told.append((command, look().step)),
        before.append(len(env.sent)),
    )
    driver = Driver(env, seed=0, listener=notes)
    driver.drive(item for item in items)
    assert [item for item, _ in notes.told] == items
    assert [step for _, step in notes.told] == [0, 0, 1, 1]
    assert before == [0, 1]


def carry(stage, hands=("left",), *, is_first=True):
    return Carrying(stage=stage, hands=hands, is_first=is_first, where="lift")


def drive(env, *marks):
    driver = Driver(env, seed=0)
    driver.drive(mark for mark in marks)
    return driver


def test_a_hand_that_holds_nothing_is_a_mishap(make_env):
    driver = drive(make_env(), carry("fold"))
    (mishap,) = driver.mishaps
    assert mishap == (
        "fold",
        "missed grasp",
        "fold, lift, left hand: nearest raised cloth nothing raised",
    )
    driver = drive(make_env(), carry("fold", SIDES, is_first=False))
    assert [reason for _, reason, _ in driver.mishaps] == ["slipped", "slipped"]
    assert [where.split(":")[0] for *_, where in driver.mishaps] == [
        "fold, lift, left hand",
        "fold, lift, right hand",
    ]


def test_what_is_carried_is_told_from_the_particles(make_env):
    """The hands are 0.4 m above the ground; what is not raised or near is not held."""
    env = make_env()
    env.particles = np.array([[-0.4, 0.7, 0.3], [0.4, 0.7, 0.2]])
    driver = drive(env, carry("fold", SIDES))
    assert driver.mishaps == [
        ("fold", "missed grasp", "fold, lift, right hand: nearest raised cloth 0.20 m")
    ]
    env.particles = np.array([[-0.4, 0.7, 0.3], [0.4, 0.7, 0.3]])
    assert drive(env, carry("fold", SIDES)).mishaps == []
    # low hands need not have raised anything
    assert drive(make_env(grasp_points=((-0.4, 0.7, 0.1),) * 2), carry("fold")).mishaps == []


def test_what_is_done_again_drops_its_mishaps_and_keeps_those_of_other_stages(make_env):
    marks = (carry("left"), carry("right"), carry("up"), carry("right", is_first=False))
    assert len(drive(make_env(), *marks).mishaps) == 4
    driver = drive(make_env(), *marks, BeginsAgain(what="try", stages=("right",)))
    assert [where.split(",")[0] for *_, where in driver.mishaps] == ["left", "up"]
    driver = drive(
        make_env(), *marks, BeginsAgain(what="round", stages=("left", "up")), carry("left")
    )
    assert [where.split(",")[0] for *_, where in driver.mishaps] == ["right", "right", "left"]
    # each mishap is still told from the others after some are gone
    driver = drive(
        make_env(),
        *marks,
        BeginsAgain(what="try", stages=("left",)),
        carry("left"),
        BeginsAgain(what="round", stages=("right", "up")),
    )
    assert [where.split(",")[0] for *_, where in driver.mishaps] == ["left"]


def test_the_first_try_is_judged_once(make_env):
    env = make_env(value=0.3)
    driver = Driver(env, seed=0)

    def course():
        yield Command(np.zeros(60))
        assert driver.first_try is None
        yield BeginsAgain(what="try", stages=("left",))
        env.value = 0.5
        yield BeginsAgain(what="round", stages=("left", "right"))
        env.value = 0.9
        yield BeginsAgain(what="try", stages=("left",))

    driver.drive(course())
    assert driver.first_try.value == 0.3
    assert driver.measurements["further_tries"] == 2
    assert driver.measurements["further_rounds"] == 1


def test_the_last_belief_of_each_name_is_kept(make_env):
    marks = ({"share": 0.2, "speed": 1.0}, {"share": 0.7}, {"area": 0.4})
    driver = drive(make_env(), *(Believes(values=values) for values in marks))
    assert driver.beliefs == {"share": 0.7, "speed": 1.0, "area": 0.4}
    assert driver.first_try is None
    assert driver.mishaps == []
    assert driver.commands == []


# Films and measurements ------------------------------------------------------------------------


def test_films_run_three_times_as_fast_while_the_arms_come_and_go(make_env):
    pictures = []
    driver = Driver(make_env(), seed=0, film=pictures.append)
    acts = [Command(np.zeros(60))] * 30 + [Command(np.zeros(60), is_passage=True)] * 50
    driver.drive(command for command in acts)
    assert pictures == [*range(0, 30, STEPS_PER_ACTION), *range(30, 80, PASSAGE_FILM_STEPS)]


def test_the_largest_strain_of_each_fifth_step_and_the_largest_force_of_all_are_kept(make_env):
    env = make_env()
    driver = Driver(env, seed=0)

    def course():
        for step, strain in enumerate([0.1, 9.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.0, 0.2]):
            env.strain = strain
            yield Command(np.full(60, float(step)))

    driver.drive(course())
    assert driver.measurements == pytest.approx(
        {
            "max_strain_mean": 0.15,
            "max_strain_p999": 0.2997,
            "max_penetration_m": 0.001,
            "max_force_on_person_N": 8.0,
        }
    )


# The simulation --------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def made(coarse_garments):
    """A coarse garment that still falls after a reset, so that every step counts."""
    made = gymnasium.make(
        "FoldTops-v1",
        task=dataclasses.replace(TASK, start=dataclasses.replace(TASK.start, settle_frames=2)),
        obs_mode="none",
        reward_mode="none",
        sim_backend="physx_cpu",
        render_backend="none",
        reconfiguration_freq=0,
    )
    yield made
    made.close()


class Replay:
    """A policy that gives actions made before, some at a time."""

    def __init__(self, actions, chunk=2):
        self.chunks = [actions[k : k + chunk] for k in range(0, len(actions), chunk)]

    def reset(self, observation):
        pass

    def act(self, observation):
        return self.chunks.pop(0)


@pytest.mark.parametrize("dtype", [np.float64, pytest.param(np.float32, marks=pytest.mark.slow)])
def test_actions_of_a_policy_do_the_same_as_steps_and_in_an_episode(
    made, motion, observe_without_cameras, dtype
):
    env = made.unwrapped
    rng = np.random.default_rng(0)
    start = motion.robot.compute_start("open")
    actions = (start + 0.05 * rng.uniform(-1, 1, (5, len(start)))).astype(dtype)

    def read():
        return env.get_particles().copy(), env.agent.read_joints().copy()

    made.reset(seed=3, options={"garment": GARMENT})
    before = read()
    for action in actions:
        made.step(action)
    stepped = read()
    driver = Driver(env, seed=3)
    hands = Handling(motion, driver.reset(GARMENT))
    for old, new in zip(before, read(), strict=True):
        np.testing.assert_array_equal(new, old)
    driver.drive(FromStart(policy=Replay(actions), actions=len(actions)).run(hands))
    assert len(driver.commands) == STEPS_PER_ACTION * len(actions)
    for old, new, first in zip(stepped, read(), before, strict=True):
        np.testing.assert_array_equal(new, old)
        assert np.abs(old - first).max() > 0.01  # something has moved


def sense_blindly(driver, sense, *cameras):
    return sense(driver)


@pytest.fixture
def driver(made, monkeypatch):
    """An episode in the simulation, without cameras."""
    made = Driver(made.unwrapped, seed=0)
    monkeypatch.setattr(Sensed, "see_points", lambda self: made.env.get_particles())
    monkeypatch.setattr(Driver, "sense", partialmethod(sense_blindly, Driver.sense))
    return made


def test_parked_hands_do_not_tell_how_long_ago_the_arms_swung(driver, motion):
    hands = Handling(motion, driver.reset(GARMENT))
    driver.drive(hands.park())
    started = hands.sensed.joint_state
    np.testing.assert_allclose(started, motion.target, atol=1e-3)
    above = {"left": POINT["left"] + (0, 0, 0.3)}  # no cloth comes along from there
    plan_approach(motion, above, STANDARD)
    driver.drive(hands.execute(motion.target[None]))
    driver.drive(hands.retreat())
    np.testing.assert_allclose(hands.sensed.joint_state, started, atol=1e-3)
    # without the wait they would: the swing itself leaves them elsewhere
    driver.drive(hands.send(motion.reach(above, STANDARD)))
    driver.drive(hands.send(motion.park()))
    assert np.abs(hands.sensed.joint_state - started).max() > 0.02


def test_wherever_a_policy_ends_the_hands_open_and_park(driver, motion):
    hands = Handling(motion, driver.reset(GARMENT))
    plan_approach(motion, POINT, STANDARD)
    action = motion.target.copy()
    action[joint_slice("left", "hand")] = HAND_POSES["close"]
    driver.drive(hands.execute(action[None]))
    driver.drive(hands.retreat(("left",)))
    joints = hands.sensed.joint_state
    for side in SIDES:
        np.testing.assert_allclose(
            joints[joint_slice(side, "arm")], DEFAULT_ROBOT.arm.parked[side], atol=0.01
        )
    np.testing.assert_allclose(joints[joint_slice("left", "hand")], HAND_POSES["open"], atol=0.1)
    assert len(driver.commands) > 100  # rolled, drawn back and risen, not torn away
