"""Success follows from the ground truth at the end; the robot's beliefs are kept beside it."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from dgl_collect import AttemptResult
from dgl_collect.attempt import Attempts, describe_episode
from dgl_collect.stage_runner import StageRunner
from dgl_collect.steps import Approach, Demonstration, Grasp, HandPose, Stage
from dgl_physics import PhysicsError
from dgl_tasks import get_task
from dgl_tasks.driver import Driver
from dgl_tasks.errors import PerceptionError, RenderingUnavailableError, UnreachableError
from dgl_tasks.evaluation import EpisodeResult, run_episode
from dgl_tasks.messages import Command
from dgl_tasks.success import Criterion, ShareInBox, Verdict

TASK = get_task("FoldTops-v1")
LEFT, RIGHT = np.array([-0.4, 0.7, 0.01]), np.array([0.4, 0.7, 0.01])
INSIDE, OUTSIDE = np.array([0.0, 0.75, 0.0]), np.array([0.0, 1.5, 0.0])
RULE = ShareInBox(
    left=("left_cuff",),
    right=("right_cuff",),
    near="left_cuff",
    far="right_cuff",
    margins=(0.1, 0.1, 0.1, 0.1),
    threshold=0.5,
)


class Env:
    """A simulation with ground truth only, as the rule judges it."""

    def __init__(self, world, garment):
        self.world, self.garment_at = world, garment
        self.task, self.agent = TASK, SimpleNamespace(control_mode="pd_joint_pos")
        self.garment = SimpleNamespace(name="Tops_LongSleeve/000001")
        self.draws = {"x": 0.1, "garment": "Tops_LongSleeve/000001"}
        self.cloth = SimpleNamespace(
            measure_strain=lambda: np.array([0.02, 0.04]),
            solver=SimpleNamespace(measure_penetration=lambda state: [0.001]),
            state=None,
        )

    def reset(self, *, seed, options):
        assert self.world.commands == []

    def advance(self, target):
        self.world.target = np.array(target, dtype=float)
        self.world.commands.append(Command(target))

    def get_particles(self):
        return self.garment_at

    def measure_touch(self):
        return {}

    def take_picture(self, camera):
        return SimpleNamespace(rgb=np.zeros((2, 2, 3), np.uint8))

    def judge(self):
        view = SimpleNamespace(
            landmarks={"left_cuff": LEFT, "right_cuff": RIGHT}, top=self.garment_at, frames={}
        )
        return RULE(view)


class Knows:
    """Finds the cuffs where they are; or, where it is `wrong`, far away from there."""

    def __init__(self, *, wrong):
        self.wrong = wrong

    def match(self, source_cloud, source_points, target_cloud):
        wanted = np.array([3 if self.wrong else int(point[0] > 0) for point in source_points])
        return wanted, np.eye(len(target_cloud))[wanted]


class Still:
    """Does nothing; `then` is called each time."""

    is_sent, follows_steps = False, False

    def __init__(self, then=lambda: None):
        self.times, self.then = 0, then

    def act(self, work):
        self.times += 1
        self.then()
        yield from work.hands.send(work.hands.motion.hold(1), recorded="stage")


@pytest.fixture
def run(make_world, monkeypatch):
    """Runs an episode in which the garment is really somewhere, and seen somewhere."""

    def run_one(*, truth, wrong, rounds=3, moves=None):
        far = np.array([3.0, 3.0, 0.0])
        world = make_world(cloud=np.array([LEFT, RIGHT, INSIDE, far]))
        monkeypatch.setattr(Driver, "sense", lambda driver, *cameras: world)
        env = Env(world, np.array([truth] * 4))
        actor = Still(lambda: moves(env, actor) if moves else None)
        stage = Stage(
            name="one",
            grasp={"left": Grasp(points=("left_cuff",))},
            steps=(Approach(), HandPose(pose="close")),
        )
        demonstration = Demonstration(
            task=TASK.id,
            garment="any",
            points={"left_cuff": LEFT, "right_cuff": RIGHT},
            stages=(stage,),
            rounds=rounds,
        )
        runner = StageRunner(
            demonstration=demonstration,
            demo_cloud=np.zeros((4, 3)),
            rule=RULE,
            get_matcher=lambda: Knows(wrong=wrong),
            actor=actor,
        )
        return run_episode(env, world.motion, runner, seed=3), actor

    return run_one


@pytest.mark.parametrize("truth", [INSIDE, OUTSIDE], ids=["done", "not done"])
def test_a_matcher_with_wrong_points_changes_beliefs_and_not_the_verdict(run, truth):
    (right, mover), (wrong, other) = (run(truth=truth, wrong=wrong) for wrong in (False, True))
    assert right.verdict == wrong.verdict
    assert right.success is wrong.success is (truth is INSIDE)
    assert right.beliefs["value"] == 0.75
    assert wrong.beliefs["value"] == 0.25
    # what is believed decides how often it is done again
    assert (mover.times, other.times) == (1, 3)
    assert right.measurements.get("further_rounds", 0.0) == 0.0
    assert wrong.measurements["further_rounds"] == 2.0


def test_the_first_try_is_judged_by_the_truth_before_anything_is_done_again(run):
    """A garment that is done at first and undone by the second round, and the reverse."""

    def undo(env, actor):
        if actor.times == 2:
            env.garment_at = np.array([OUTSIDE] * 4)

    result, _ = run(truth=INSIDE, wrong=True, moves=undo)
    assert (result.first_try.success, result.success) == (True, False)

    def mend(env, actor):
        if actor.times == 2:
            env.garment_at = np.array([INSIDE] * 4)

    result, _ = run(truth=OUTSIDE, wrong=True, moves=mend)
    assert (result.first_try.success, result.success) == (False, True)
    result, _ = run(truth=INSIDE, wrong=False)
    assert result.first_try is result.verdict  # nothing was done again


# What is told of an episode ----------------------------------------------------------------------


def make_result(value, **changes):
    share = Criterion(name="share", value=value, comparison=">=", threshold=0.8)
    still = Criterion(
        name="speed",
        value=0.01,
        comparison="<",
        threshold=0.05,
        unit=" m/s",
        failure="still moving",
    )
    verdict = Verdict(criteria=(share, still))
    content = {
        "garment": "Tops_LongSleeve/000001",
        "verdict": verdict,
        "first_try": verdict,
        "picture": np.zeros((2, 2, 3), np.uint8),
        "commands": np.zeros((7, 60), np.float32),
        "measurements": {"max_strain_mean": 0.02},
        "beliefs": {"value": 0.3, "flat_area": 0.4},
        "draws": {},
    }
    return EpisodeResult(**(content | changes))


def describe(ended):
    placed = {"placement_error_m": 0.03}
    garment = "Tops_LongSleeve/000001"
    return describe_episode(ended, measurements=placed, index=2, seed=7, garment_id=garment)


def test_a_result_follows_the_verdict_and_keeps_the_beliefs_beside():
    believed = {"value": 0.99}
    done, not_done = (describe(make_result(v, beliefs=believed)) for v in (0.85, 0.75))
    assert (done.success, done.reason, done.detail) == (True, None, "")
    assert not not_done.success
    assert not_done.reason == "below the threshold"
    assert not_done.detail == "share: 0.750, needed >= 0.8"
    for result, value in ((done, 0.85), (not_done, 0.75)):
        assert result.value == value
        assert result.beliefs == believed
        assert [criterion.name for criterion in result.criteria] == ["share", "speed"]
        assert result.measurements == {
            "max_strain_mean": 0.02,
            "steps": 7.0,
            "placement_error_m": 0.03,
        }
        assert (result.index, result.seed) == (2, 7)
        assert AttemptResult.from_line(result.to_line()) == result
        assert json.loads(result.to_line())["beliefs"] == believed


def test_the_first_try_of_a_result_is_the_truth_of_that_time():
    other = make_result(0.75).verdict
    assert not describe(make_result(0.85, first_try=other)).first_try
    assert describe(make_result(0.75, first_try=make_result(0.85).verdict)).first_try
    assert describe(make_result(0.85)).first_try


def test_what_went_wrong_on_the_way_says_more_than_the_result():
    mishaps = (("slipped", "left_sleeve, move 2, left hand"), ("missed grasp", "bottom_up, move 1"))
    failed = describe(make_result(0.75, mishaps=mishaps))
    assert failed.reason == "slipped"
    assert failed.detail == "left_sleeve, move 2, left hand; share: 0.750, needed >= 0.8"
    done = describe(make_result(0.85, mishaps=mishaps))  # in spite of it
    assert (done.success, done.reason, done.detail) == (True, None, "")


def test_the_placement_error_is_measured_where_a_task_has_a_place():
    def measure(task, middle):
        env = SimpleNamespace(
            task=get_task(task),
            get_particles=lambda: np.array([middle, middle]),
            get_frames=lambda: {"hook": {"target": np.array([0.1, 0.8, 1.1])}},
        )
        attempts = Attempts(SimpleNamespace(env=env, options=None), None, recorded=None)
        return attempts._measure_placement()

    assert measure("HangCoat-v1", [0.1, 0.7, 0.9]) == {"placement_error_m": pytest.approx(0.1)}
    assert measure("HangCoat-v1", [np.nan, 0.7, 0.9]) == {}
    assert measure("FoldTops-v1", [0.1, 0.7, 0.9]) == {}


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (UnreachableError("left arm cannot reach it"), "unreachable"),
        (PerceptionError("the camera sees nothing of the garment"), "perception"),
        (RenderingUnavailableError("no usable Vulkan device"), "rendering unavailable"),
        (PhysicsError("the cloth exploded"), "physics"),
    ],
)
def test_an_error_that_ends_an_episode_is_its_reason(error, reason):
    result = describe(error)
    assert not result.success
    assert not result.first_try
    assert (result.reason, result.detail) == (reason, str(error))
    assert result.measurements == {"placement_error_m": 0.03}  # where the garment was left
    assert result.value is None
    assert result.beliefs == {}
