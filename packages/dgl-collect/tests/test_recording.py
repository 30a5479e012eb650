"""Recording of a stage, frame by frame, over several tries."""

from types import SimpleNamespace

import numpy as np
import pytest

from dgl_collect import EpisodeRecorder, StageRecorder
from dgl_collect.stage_runner import StageRunner
from dgl_collect.steps import Approach, Demonstration, Grasp, HandPose, Stage
from dgl_tasks import get_task
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.messages import StageBegins
from dgl_tasks.observation import Observation

TASK = get_task("FoldTops-v1")
ENV = SimpleNamespace(
    task=TASK
)  # all that a recorder asks of an environment: where its cameras stand
POINTS = {"left_cuff": np.array([-0.4, 0.7, 0.01]), "right_cuff": np.array([0.4, 0.7, 0.01])}


def make_start():
    return StageBegins(
        name="left_sleeve",
        garment_point_cloud=np.zeros((2048, 3), np.float32),
        points_affordance_feature=np.zeros((2048, 2), np.float32),
        seen_at=30,
    )


def record(recorder, steps):
    observed = []

    def observe():
        observed.append(len(observed))
        ee_pose = np.zeros((2, 7), np.float32)
        ee_pose[:, 3] = 1.0
        return Observation(
            joint_state=np.full(60, len(observed), np.float32),
            ee_pose=ee_pose,
            image=np.zeros((480, 640, 3), np.uint8),
            env_point_cloud=np.zeros((2048, 6), np.float32),
        )

    target = np.zeros(60, np.float32)
    for step in range(steps):
        target[:] = step  # one buffer, reused as a controller does
        recorder.before_step(target, observe)
    return len(observed)


@pytest.mark.parametrize(("steps", "frames"), [(1, 1), (5, 1), (6, 2), (40, 8)])
def test_every_fifth_step_is_a_frame_and_only_that_renders(steps, frames):
    recorder = StageRecorder(make_start())
    assert record(recorder, steps) == frames == recorder.frame_count


def test_the_action_is_the_last_target_before_the_next_frame():
    recorder = StageRecorder(make_start())
    record(recorder, 12)
    stage = recorder.finish()
    np.testing.assert_array_equal(stage.action[:, 0], [4, 9, 11])
    np.testing.assert_array_equal(stage.joint_state[:, 0], [1, 2, 3])


def test_what_comes_before_the_stage_is_its_approach():
    recorder = StageRecorder(make_start())
    record(recorder, 10)
    recorder.begin(step=40)
    record(recorder, 7)
    stage = recorder.finish()
    assert (stage.frame_count, stage.approach_frames, stage.first_step) == (4, 2, 30)


def test_an_approach_of_part_of_a_frame_is_refused():
    recorder = StageRecorder(make_start())
    record(recorder, 7)
    with pytest.raises(ValueError, match="whole frames of 5 steps; got 7"):
        recorder.begin(step=40)


def test_a_stage_without_frames_is_refused():
    with pytest.raises(ValueError, match="at least one frame"):
        StageRecorder(make_start()).finish()


def test_a_target_of_another_size_is_refused():
    recorder = StageRecorder(make_start())
    record(recorder, 5)
    recorder.before_step(np.zeros(30), lambda: recorder._observations[0])
    with pytest.raises(ValueError, match="all input arrays must have the same shape"):
        recorder.finish()


def test_what_does_not_change_in_a_stage_is_that_of_its_beginning():
    start = make_start()
    points = {"left_cuff": {"xyz": [-0.4, 0.7, 0.01], "uv": [200.0, 260.5]}}
    recorder = StageRecorder(start, points=points)
    record(recorder, 5)
    stage = recorder.finish()
    assert (stage.name, stage.cloud_step, stage.points) == ("left_sleeve", 30, points)
    assert stage.object_point_cloud is None
    assert stage.garment_point_cloud is start.garment_point_cloud


# Episodes ---------------------------------------------------------------------------------------


class Acts:
    """Holds still for `frames` frames in each try; a negative number loses the garment then."""

    is_sent, follows_steps = False, False

    def __init__(self, **frames):
        self.frames = {name: list(counts) for name, counts in frames.items()}

    def act(self, work):
        count = self.frames[work.stage.name].pop(0)
        for _ in range(abs(count)):
            hands = work.hands
            hands.motion.reset(hands.motion.target + 1e-3)
            yield from hands.send(hands.motion.hold(5), recorded="stage")
        if count < 0:
            work.react(set(work.stage.hands))


class Anywhere:
    """Finds every point at the first place of the cloud."""

    def match(self, source_cloud, source_points, target_cloud):
        count = len(source_points)
        return np.zeros(count, int), np.ones((count, len(target_cloud)))


class Rule:
    landmarks, frames = (), ()

    def __call__(self, view):
        return SimpleNamespace(value=0.0, success=False)


def make_stage(name, *steps, **changes):
    steps = (Approach(), *(steps or (HandPose(pose="close"),)))
    return Stage(name=name, grasp={"left": Grasp(points=("left_cuff",))}, steps=steps, **changes)


@pytest.fixture
def record_episode(make_world, monkeypatch):
    """Runs stages in a world whose clock is its control steps; the recorder, and the world."""

    def run(actor, *stages, rounds=1, with_approach=False, prepare=None):
        world = make_world(cloud=np.tile(POINTS["left_cuff"], (2048, 1)))
        world.image = np.zeros((480, 640, 3), np.uint8)
        world.listener = recorder = EpisodeRecorder(ENV, with_approach=with_approach)
        monkeypatch.setattr("time.perf_counter", lambda: float(world.step))
        if prepare is not None:
            prepare(world)
        demonstration = Demonstration(
            task=TASK.id, garment="any", points=POINTS, stages=stages, rounds=rounds
        )
        runner = StageRunner(
            demonstration=demonstration,
            demo_cloud=np.zeros((3, 3)),
            rule=Rule(),
            get_matcher=Anywhere,
            actor=actor,
        )
        world.run(runner)
        return recorder, world

    return run


def count_frames(recorder):
    return {name: stage.frame_count for name, stage in recorder.records.items()}


def test_every_stage_of_an_episode_is_recorded(record_episode):
    actor = Acts(one=[3], two=[2])
    recorder, world = record_episode(actor, make_stage("one"), make_stage("two"))
    assert count_frames(recorder) == {"one": 3, "two": 2}
    for name, stage in recorder.records.items():
        (begins,) = (m for m in world.get_marks(StageBegins) if m.name == name)
        assert stage.name == name
        assert (stage.cloud_step, stage.approach_frames) == (begins.seen_at, 0)
        first = stage.first_step
        assert world.commands[first].recorded == "stage"
        assert world.commands[first - 1].recorded is None
        sent = [world.commands[first + 5 * k + 4].target for k in range(stage.frame_count)]
        np.testing.assert_allclose(stage.action, sent, atol=1e-6)
        np.testing.assert_array_equal(stage.garment_point_cloud, begins.garment_point_cloud)
    assert set(recorder.seconds) == {"one", "two"}
    assert recorder.seconds["one"] == 15.0


def test_points_are_named_with_where_they_are_seen(record_episode):
    recorder, _ = record_episode(Acts(one=[1]), make_stage("one"))
    points = recorder.records["one"].points
    assert set(points) == set(POINTS)
    seen = points["left_cuff"]
    np.testing.assert_allclose(seen["xyz"], POINTS["left_cuff"], atol=1e-6)
    camera = ENV.task.cameras["environment_camera"]
    np.testing.assert_allclose(seen["uv"], camera.project(np.array([seen["xyz"]]))[0, :2])


@pytest.mark.parametrize("with_approach", [False, True])
def test_the_way_to_the_grasp_points_is_recorded_where_it_is_wanted(record_episode, with_approach):
    class Sent(Acts):
        is_sent = True

    recorder, world = record_episode(Sent(one=[2]), make_stage("one"), with_approach=with_approach)
    stage = recorder.records["one"]
    approach = sum(command.recorded == "approach" for command in world.commands)
    assert approach > 0
    assert stage.approach_frames == (approach // 5 if with_approach else 0)
    assert stage.frame_count == 2 + stage.approach_frames
    begins = stage.first_step + 5 * stage.approach_frames
    assert [world.commands[k].recorded for k in (begins - 1, begins)] == ["approach", "stage"]


def test_of_several_tries_the_one_that_counted_is_kept(record_episode):
    recorder, _ = record_episode(
        Acts(one=[-4, -3, 2], two=[1]), make_stage("one"), make_stage("two")
    )
    assert count_frames(recorder) == {"one": 2, "two": 1}
    # what the others took is time that the stage has taken
    assert recorder.seconds["one"] == 5.0 * (4 + 3 + 2)


def begin_in_vain(record_episode, cause):
    """An episode whose second stage is lost, and cannot be begun again."""
    looks = []

    def hide(world):
        see = world.see_garment

        def see_garment():
            looks.append(world.step)
            if len(looks) == 4:  # as a whole, then for stage one, two, and two again
                raise cause
            return see()

        world.see_garment = see_garment

    stages = [make_stage(name) for name in ("one", "two", "three")]
    actor = Acts(one=[1], two=[-4], three=[2])
    recorder, world = record_episode(actor, *stages, prepare=hide)
    assert len(looks) == 5
    return recorder, world, looks


NOTHING_THERE = PerceptionError("nothing lies where it lay")


@pytest.mark.parametrize("cause", [NOTHING_THERE, UnreachableError("too far")])
def test_where_a_further_try_could_not_begin_the_one_before_is_kept(record_episode, cause):
    recorder, world, _ = begin_in_vain(record_episode, cause)
    assert count_frames(recorder) == {"one": 1, "two": 4, "three": 2}
    begins = {mark.name: mark for mark in world.get_marks(StageBegins)}
    assert recorder.records["two"].cloud_step == begins["two"].seen_at


def test_no_time_of_a_stage_is_counted_twice(record_episode):
    recorder, _, looks = begin_in_vain(record_episode, NOTHING_THERE)
    assert 20.0 <= recorder.seconds["two"] <= looks[3] - looks[2]


def test_of_several_rounds_the_last_is_kept(record_episode):
    stages = (make_stage("one", again=False), make_stage("two"))
    recorder, world = record_episode(Acts(one=[5], two=[4, 3, 2]), *stages, rounds=3)
    assert count_frames(recorder) == {"one": 5, "two": 2}
    *_, last = world.get_marks(StageBegins)
    assert recorder.records["two"].cloud_step == last.seen_at


def test_what_was_given_up_does_not_take_the_place_of_what_was_carried_out(record_episode):
    fling = make_stage("fling", on_loss="lay down")
    recorder, _ = record_episode(Acts(fling=[4, -3]), fling, rounds=2)
    assert count_frames(recorder) == {"fling": 4}
    recorder, _ = record_episode(Acts(fling=[-3]), fling)
    assert recorder.records == {}


def test_what_nobody_learns_is_not_recorded(record_episode):
    plain = make_stage("plain", HandPose(pose="close", recorded=False))
    recorder, world = record_episode(Acts(two=[2]), plain, make_stage("two"))
    assert count_frames(recorder) == {"two": 2}
    assert [mark.name for mark in world.get_marks(StageBegins)] == ["plain", "two"]


def test_nothing_is_observed_but_for_what_is_recorded(record_episode):
    looks = []

    def watch(world):
        observe = world.observe
        world.observe = lambda: looks.append(world.step) or observe()

    recorder, _ = record_episode(Acts(one=[3]), make_stage("one"), prepare=watch)
    first = recorder.records["one"].first_step
    assert looks == [first, first + 5, first + 10]
