"""Course and end of an episode, with a stand-in for the environment."""

import numpy as np
import pytest

from dgl_tasks.evaluation import plan_episode, run_episode
from dgl_tasks.handling import PARKED_FRAMES, SETTLE_FRAMES, Handling
from dgl_tasks.messages import BeginsAgain, Believes, Carrying
from dgl_tasks.policy import Nothing
from dgl_tasks.success import Criterion, Verdict

PARKING = 1 + PARKED_FRAMES


@pytest.fixture
def retreats(monkeypatch):
    """Control steps at which hands were drawn back, with 7 more; no way is planned."""
    begun = []

    def retreat(self):
        begun.append(self.sensed.step)
        yield from self.send(self.motion.hold(7), is_passage=True)

    monkeypatch.setattr(Handling, "retreat", retreat)
    return begun


class Acts:
    """Gives marks, then one action that leaves the arms somewhere."""

    def __init__(self, *marks, moves=True):
        self.marks, self.moves = marks, moves

    def run(self, hands):
        for mark in self.marks:
            yield from hands.mark(mark)
        if self.moves:
            yield from hands.execute(np.zeros((1, 60)))


def test_doing_nothing_is_judged_as_the_garment_fell(make_env, jumping_motion, retreats):
    env = make_env()
    result = run_episode(env, jumping_motion, Nothing(), seed=5, garment="tops/1")
    assert env.resets == [(5, {"garment": "tops/1"})]
    assert len(env.sent) == PARKING + SETTLE_FRAMES
    assert retreats == []
    assert result.commands.shape == (len(env.sent), 60)
    assert result.commands.dtype == np.float32
    np.testing.assert_array_equal(result.commands, env.sent)
    assert result.success
    assert (result.reason, result.detail, result.mishaps) == (None, "", ())
    assert result.first_try is result.verdict
    assert (result.garment, result.draws) == ("tops/1", {"garment": "tops/1", "x": 0.1})
    assert result.picture.shape == (4, 4, 3)
    assert env.pictures[-1] == env.task.picture_camera
    assert result.measurements["max_penetration_m"] == 0.001


def test_hands_that_are_not_parked_are_drawn_back_before_the_verdict(
    make_env, jumping_motion, retreats
):
    env = make_env()
    judged = []
    judge = env.judge
    env.judge = lambda: judged.append(len(env.sent)) or judge()
    run_episode(env, jumping_motion, Acts(), seed=0)
    assert env.resets == [(0, {})]
    assert retreats == [PARKING + 5]
    assert judged == [PARKING + 5 + 7 + SETTLE_FRAMES]


def test_what_has_been_waited_for_is_not_waited_for_again(make_env, jumping_motion):
    class Waits:
        def run(self, hands):
            yield from hands.settle()

    env = make_env()
    run_episode(env, jumping_motion, Waits(), seed=0)
    assert len(env.sent) == PARKING + SETTLE_FRAMES


LIFT = Carrying(stage="fold", hands=("left",), is_first=True, where="lift")


def test_the_first_mishap_says_more_than_the_verdict(make_env, jumping_motion):
    slip = Carrying(stage="fold", hands=("right",), is_first=False, where="carry")
    acts = Acts(LIFT, slip, moves=False)
    result = run_episode(make_env(value=0.3), jumping_motion, acts, seed=0)
    assert not result.success
    assert result.reason == "missed grasp"
    assert [reason for reason, _ in result.mishaps] == ["missed grasp", "slipped"]
    assert result.detail == (
        "fold, lift, left hand: nearest raised cloth nothing raised; share: 0.300, needed >= 0.8"
    )
    # what succeeds in spite of it has no reason
    result = run_episode(make_env(value=0.9), jumping_motion, acts, seed=0)
    assert (result.success, result.reason, result.detail) == (True, None, "")
    assert len(result.mishaps) == 2


def test_without_mishaps_the_verdict_says_why(make_env, jumping_motion):
    env = make_env()
    criteria = (
        Criterion(name="share", value=0.9, comparison=">=", threshold=0.8),
        Criterion(name="links", value=2.0, comparison="<=", threshold=0.0, failure="not released"),
    )
    env.judge = lambda: Verdict(criteria=criteria)
    result = run_episode(env, jumping_motion, Nothing(), seed=0)
    assert not result.success
    assert result.reason == "not released"
    assert result.detail == "links: 2.000, needed <= 0"


def test_the_first_try_and_the_beliefs_are_kept(make_env, jumping_motion):
    env = make_env(value=0.3)

    class Twice:
        def run(self, hands):
            yield from hands.mark(LIFT)
            yield from hands.mark(Believes(values={"value": 0.4}))
            yield from hands.mark(BeginsAgain(what="try", stages=("fold",)))
            env.value = 0.9
            yield from hands.mark(Believes(values={"value": 0.8}))

    result = run_episode(env, jumping_motion, Twice(), seed=0)
    assert (result.first_try.value, result.verdict.value) == (0.3, 0.9)
    assert not result.first_try.success
    assert result.success
    assert result.beliefs == {"value": 0.8}
    assert result.mishaps == ()
    assert result.measurements["further_tries"] == 1


def test_films_and_listeners_are_given_the_whole_episode(make_env, jumping_motion, retreats):
    class Notes:
        def __init__(self):
            self.commands, self.marks = [], []

        def before_step(self, command, look):
            self.commands.append(command)

        def note(self, mark, sensed):
            self.marks.append((mark, sensed.step))

    notes, film, env = Notes(), [], make_env()
    run_episode(env, jumping_motion, Acts(LIFT), seed=0, film=film.append, listener=notes)
    assert len(notes.commands) == len(env.sent)
    assert notes.marks == [(LIFT, PARKING)]
    assert film[0] == 0
    assert max(film) > PARKING


def test_a_course_needs_no_environment(jumping_world):
    """An episode is planned from what is sensed alone."""
    world = jumping_world
    mark = Believes(values={})
    commands = world.play(plan_episode(world.motion, Acts(mark, moves=False), world))
    assert len(commands) == PARKING + SETTLE_FRAMES
    assert world.marks == [mark]
