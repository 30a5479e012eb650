"""HALO in the laboratory: what it asks of an environment, and which policies it takes."""

import functools
from types import SimpleNamespace

import numpy as np
import pytest
from dexgarmentlab.evaluation.halo import (
    LEARNED,
    Guide,
    HaloDriver,
    HaloMethod,
    check_checkpoints,
    count_chunks,
)

from dexgarmentlab.evaluation.attempts import make_evaluation_runner
from dexgarmentlab.evaluation.methods import MethodOptions, check_method
from dgl_assets.robots import joint_slice
from dgl_collect.demonstration import load_demonstration, retarget_waypoints
from dgl_sadp import (
    DiffusionPolicy,
    EnvironmentDriver,
    StageError,
    get_policy_config,
    save_policy,
)
from dgl_tasks import get_task
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.observation import Observation

TASK = get_task("FoldTops-v1")


@functools.cache
def make_policy(method):
    return DiffusionPolicy.make(get_policy_config(method, "small"), seed=0)


def save(folder, *, method="sadp-g", stages=3, **card):
    """Policies that have learnt nothing."""
    policy = make_policy(method)
    for number in range(1, stages + 1):
        whole = {"stage": number, "tasks": ["FoldTops-v1"], **card}
        save_policy(folder / f"stage_{number}/policy.safetensors", policy, whole)
    return folder


@pytest.fixture(autouse=True)
def reachable(monkeypatch):
    """Everything is within reach of arms that are not there, but for what a test moves."""
    instead = {}
    monkeypatch.setattr(
        "dexgarmentlab.evaluation.halo.find_reachable",
        lambda motion, stage, side, point, cloud: instead.get(side, point),
    )
    return instead


class Recorder:
    """Notes what a driver is told, where one that moves a robot would be."""

    def __init__(self, *, is_parked=False):
        self.env = SimpleNamespace(task=TASK, props={})
        self.told, self.is_parked, self.motion = [], is_parked, None
        self.low, self.empty = {"left", "right"}, set()
        self.is_seen = True
        self.reason = None

    def see_garment(self):
        return np.ones((2048, 3), np.float32)

    def observe(self):
        return Observation(
            joint_state=np.zeros(60, np.float32),
            ee_pose=np.zeros((2, 7), np.float32),
            image=np.zeros((4, 4, 3), np.uint8),
            env_point_cloud=np.zeros((2048, 6), np.float32),
        )

    def is_low(self, side):
        return side in self.low

    def see_points(self):
        if not self.is_seen:
            raise PerceptionError("the camera sees nothing of the garment")
        return np.ones((5, 3))

    def find_empty(self, stage, points):
        assert points.shape == (5, 3)
        return dict.fromkeys(self.empty - self.low, 0.3)

    def approach(self, stage, points, rehearsals=()):
        self.told.append(("approach", stage.name, points))
        self.rehearsals = rehearsals

    def execute(self, actions):
        self.told.append(("execute", actions.shape))

    def retreat(self, sides, name):
        self.told.append(("retreat", sides, name))

    def settle(self):
        self.told.append(("settle",))

    def judge(self, points):
        self.told.append(("judge", points))
        return SimpleNamespace(reason=self.reason)

    def is_nearly_done(self, points):
        self.told.append(("nearly", points))
        return self.reason is None


def test_the_hands_go_to_the_points_at_the_height_of_the_stage():
    driver = Recorder()
    halo = HaloDriver(driver)
    assert set(halo.begin_stage(3)) == {"garment_point_cloud"}
    halo.move_hands(np.array([-0.2, 0.6, 0.3]), np.array([0.2, 0.6, 0.3]))
    kind, name, points = driver.told[0]
    assert (kind, name) == ("approach", "bottom_up")
    height = TASK.stages[2].grasp_height
    np.testing.assert_allclose(points["left"], [-0.2, 0.6, height])
    np.testing.assert_allclose(points["right"], [0.2, 0.6, height])
    halo.end_stage(3)
    assert driver.told[-1] == ("retreat", ("left", "right"), TASK.stages[2].leave)


def test_a_hand_goes_to_what_it_can_reach(reachable):
    driver = Recorder()
    halo = HaloDriver(driver)
    halo.begin_stage(3)
    reachable["right"] = np.array([0.1, 0.5, 0.02])
    halo.move_hands(np.array([-0.2, 0.6, 0.3]), np.array([0.2, 0.6, 0.3]))
    *_, points = driver.told[0]
    np.testing.assert_allclose(points["left"][:2], [-0.2, 0.6])
    np.testing.assert_allclose(points["right"], [0.1, 0.5, TASK.stages[2].grasp_height])


def test_a_hand_that_came_up_empty_has_lost_the_garment():
    driver = Recorder()
    halo = HaloDriver(driver)
    halo.begin_stage(3)

    def look(times=1):
        return [halo.see_hold() for _ in range(times)]

    driver.low, driver.empty = set(), {"left"}
    assert look(3) == ["all"] * 3  # has not been down yet
    driver.low = {"left", "right"}
    halo.observe()
    driver.low = set()
    assert look() == ["all"]  # a single look
    driver.is_seen = False
    assert look() == ["all"]
    driver.is_seen = True
    assert look() == ["some"]
    driver.empty = {"right"}
    assert look(2) == ["all", "some"]  # the other one
    driver.empty = {"left", "right"}
    assert look(2) == ["some", "none"]
    halo.begin_stage(3)
    assert look(3) == ["all"] * 3


def come_up_empty():
    """A driver in the first stage, whose only working hand has been down and holds nothing."""
    driver = Recorder()
    halo = HaloDriver(driver)
    halo.begin_stage(1)
    (side,) = TASK.stages[0].grasp
    driver.low = {side}
    halo.observe()
    driver.low, driver.empty = set(), {side}
    return halo, side


def test_the_only_hand_that_works_has_lost_all():
    halo, _ = come_up_empty()
    assert [halo.see_hold(), halo.see_hold()] == ["all", "none"]


@pytest.mark.parametrize(
    ("fingers", "expected"),
    [
        ([0.0, 0.2, 0.1], "none"),  # never closed: what it came for stayed where it was
        ([0.0, 0.7, 0.7], "none"),
        ([0.7, 0.7, 0.4], "none"),  # still closed by more than a half
        ([0.7, 0.7, 0.3], "all"),
        ([0.7, 0.1, 0.7], "none"),  # closed again
    ],
)
def test_a_hand_that_was_told_to_let_go_has_lost_nothing(fingers, expected):
    halo, side = come_up_empty()
    for angle in fingers:
        target = np.zeros(60)
        target[joint_slice(side, "hand")] = angle  # of 24 joints: 0.7 is 3.4 in all
        halo.execute(target)
    assert [halo.see_hold(), halo.see_hold()] == ["all", expected]


def test_what_was_let_go_is_waited_for_before_a_stage_is_begun_again():
    driver = Recorder()
    halo = HaloDriver(driver)
    for stage in (1, 2, 3):
        halo.begin_stage(stage)
    assert driver.told == []
    halo.begin_stage(2)
    assert driver.told == [("settle",)]


def test_one_hand_works_and_the_other_stays():
    driver = Recorder()
    halo = HaloDriver(driver)
    halo.begin_stage(1)
    halo.move_hands(np.zeros(3), None)
    assert set(driver.told[0][2]) == {"left"}
    seen = halo.execute(np.zeros(60))
    assert set(seen) == {"joint_state", "ee_pose", "image", "env_point_cloud"}
    assert driver.told[1] == ("execute", (1, 60))
    halo.end_stage(1)
    assert driver.told[2] == ("retreat", ("left",), TASK.stages[0].leave)
    parked = Recorder(is_parked=True)
    HaloDriver(parked).end_stage(1)
    assert parked.told == []


def test_hands_are_turned_so_that_as_much_as_can_be_of_the_stage_is_within_reach(
    setup, monkeypatch
):
    cloud = np.random.default_rng(0).uniform(-0.3, 0.3, (2048, 3)).astype(np.float32)
    demonstrated, asked = setup.demonstration, []

    class Matcher:
        """Finds the first points of the cloud."""

        def match(self, source_cloud, source_points, target_cloud):
            count = len(source_points)
            return np.arange(count), np.eye(count, len(target_cloud))

    setup.find_matcher = lambda env: Matcher()
    monkeypatch.setattr(
        "dexgarmentlab.evaluation.halo.rehearse_stage",
        lambda *args, leaves: asked.append((*args, leaves)),
    )
    driver = Recorder()
    driver.motion, driver.see_garment = object(), lambda: cloud
    halo = HaloDriver(driver, Guide(setup))
    halo.begin_stage(1)
    halo.move_hands(cloud[7], None)
    orientation = np.array([1.0, 0.0, 0.0, 0.0])
    for rehearse in driver.rehearsals:
        rehearse("left", orientation)
    motion, stage, side, turned, grasp, waypoints, leaves = asked[0]
    assert leaves
    assert (motion, stage, side) == (driver.motion, TASK.stages[0], "left")
    assert turned is orientation
    np.testing.assert_allclose(grasp[:2], cloud[7, :2])
    points = dict(zip(demonstrated.points, cloud.astype(float), strict=False))
    wanted = retarget_waypoints(demonstrated.get_stage(TASK.stages[0].name), points)
    for waypoint, other in zip(waypoints, wanted, strict=True):
        np.testing.assert_array_equal(waypoint.targets["left"], other.targets["left"])
    # what is left of it where that cannot be: ever fewer waypoints, in the end the approach alone
    assert [part for *_, part, _ in asked[1:]] == [
        waypoints[:count] for count in range(len(waypoints), -1, -1)
    ]
    assert not any(leaves for *_, leaves in asked[1:])


def test_the_task_is_seen_to_be_done_by_its_rule_at_the_places_that_were_found():
    driver, asked = Recorder(), []
    guide = SimpleNamespace(
        points={"hem": np.ones(3)}, look=lambda cloud: asked.append(cloud.shape)
    )
    halo = HaloDriver(driver, guide)
    halo.begin_stage(1)
    halo.begin_stage(2)  # what lies folded does not say any more where it was
    assert asked == [(2048, 3)]
    assert halo.is_done()
    assert [told[0] for told in driver.told] == ["settle", "judge"]
    assert set(driver.told[1][1]) == {"hem"}
    assert halo.is_nearly_done()
    assert set(driver.told[2][1]) == {"hem"}
    driver.reason = "below the threshold"
    assert not halo.is_done()
    assert not halo.is_nearly_done()


def test_the_driver_has_what_halo_asks_for():
    asked = {name for name in vars(EnvironmentDriver) if not name.startswith("_")}
    assert asked == {
        "begin_stage", "move_hands", "observe", "execute", "see_hold", "end_stage", "is_done",
        "is_nearly_done",
    }  # fmt: skip
    assert all(callable(getattr(HaloDriver, name)) for name in asked)


def test_a_stage_gets_enough_chunks_for_the_longest_recording():
    config = get_policy_config("sadp-g", "small")
    assert count_chunks(config, {"longest": 26}) == 7  # of 4 actions: 26 frames are 6.5
    assert count_chunks(config, {"longest": 28}) == 7
    with pytest.raises(ValueError, match="must tell the longest recording; got None"):
        count_chunks(config, {})


def test_policies_must_be_there_and_of_the_task(tmp_path):
    check_checkpoints(TASK, save(tmp_path / "good"), use_gam=True)
    with pytest.raises(ValueError, match=r"policy for stage 3; no .*stage_3/policy.safetensors"):
        check_checkpoints(TASK, save(tmp_path / "few", stages=2), use_gam=True)
    with pytest.raises(ValueError, match="must be of stage 1; got 2"):
        check_checkpoints(TASK, save(tmp_path / "stage", stage=2), use_gam=True)
    with pytest.raises(ValueError, match="must be of task FoldTops-v1; got FoldDress-v1"):
        check_checkpoints(TASK, save(tmp_path / "task", tasks=["FoldDress-v1"]), use_gam=True)
    with pytest.raises(ValueError, match="--policy halo needs --checkpoints"):
        check_method("halo", TASK, MethodOptions())
    with pytest.raises(ValueError, match="chunks must be at least 1; got 0"):
        MethodOptions(chunks=0)


def test_a_policy_begins_where_it_was_trained_to(tmp_path):
    at_points = save(tmp_path / "a", training={"with_approach": False})
    parked = save(tmp_path / "b", training={"with_approach": True})
    check_checkpoints(TASK, at_points, use_gam=True)
    check_checkpoints(TASK, parked, use_gam=False)
    with pytest.raises(ValueError, match="must be trained with --gam; got one of --no-gam"):
        check_checkpoints(TASK, parked, use_gam=True)
    with pytest.raises(ValueError, match="must be trained with --no-gam; got one of --gam"):
        check_method("sadp", TASK, MethodOptions(checkpoints=str(at_points)))


@pytest.fixture
def setup():
    return SimpleNamespace(
        env=SimpleNamespace(task=TASK),
        demonstration=load_demonstration("FoldTops-v1"),
        demo_cloud=np.zeros((100, 3), np.float32),
        find_matcher=lambda env: None,
    )


@pytest.mark.parametrize(
    ("name", "method", "use_gam"),
    [
        ("halo", "sadp-g", True),
        ("sadp", "sadp-g", False),
        ("gam-dp3", "dp3", True),
        ("dp3", "dp3", False),
    ],
)
def test_methods_are_halo_with_parts_taken_away(tmp_path, setup, name, method, use_gam):
    training = {"with_approach": not use_gam}
    made = HaloMethod(name, setup, save(tmp_path, method=method, training=training), chunks=2)
    assert made.halo.use_gam is use_gam
    assert [stage.chunks for stage in made.halo.stages] == [2, 2, 2]
    assert (made.halo.rounds, made.halo.again_from) == (1, 1)
    left, right = made.halo.stages[0].left, made.halo.stages[0].right
    np.testing.assert_array_equal(left, setup.demonstration.points["left_cuff"])
    assert right is None
    others = {method_ for other in LEARNED.values() for method_ in other.policies}
    for wrong in sorted(others - set(LEARNED[name].policies) - {"dp", "sadp"}):
        folder = save(tmp_path / wrong, method=wrong, training=training)
        with pytest.raises(ValueError, match=f"{name} takes a policy of .*; got {wrong}"):
            HaloMethod(name, setup, folder)


def test_rounds_are_those_of_the_task_unless_another_number_is_asked_for(tmp_path, setup):
    task = get_task("FoldTrousers-v1")
    setup.env.task, setup.demonstration = task, load_demonstration("FoldTrousers-v1")
    folder = save(tmp_path, stages=len(task.stages), tasks=[task.id])
    halo = HaloMethod("halo", setup, folder, chunks=1).halo
    assert (halo.rounds, halo.again_from) == (task.rounds, task.again_from + 1) == (3, 2)
    assert HaloMethod("halo", setup, folder, chunks=1, rounds=1).halo.rounds == 1
    with pytest.raises(ValueError, match="rounds must be at least 1; got 0"):
        MethodOptions(rounds=0)


@pytest.mark.parametrize(
    ("cause", "reason"),
    [
        (StageError("stage 2: nothing lies there"), "perception"),
        (PerceptionError("the camera sees nothing of the garment"), "perception"),
        (UnreachableError("left arm cannot reach it", distance=0.1), "unreachable"),
    ],
)
def test_a_method_that_cannot_go_on_ends_and_says_why(tmp_path, setup, monkeypatch, cause, reason):
    class Failing(Recorder):
        seed, events, measurements = 3, [], {}

        def approach(self, stage, points, rehearsals=()):
            raise cause

    training = {"with_approach": False}
    made = HaloMethod("halo", setup, save(tmp_path, training=training), chunks=1)
    halo = made.halo

    def run(driver, *, seed):
        assert seed == 3
        driver.move_hands(np.zeros(3), None)

    monkeypatch.setattr(halo, "run", run)
    monkeypatch.setattr(Guide, "plan", lambda *_: None)
    driver = Failing()
    made.run(driver)
    assert driver.events == [(reason, str(cause))]


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.render
def test_an_episode_of_halo_goes_to_every_stage_and_is_judged(tmp_path):
    """A policy that has learnt nothing: what is scripted still runs, and the garment is not folded."""
    (tmp_path / "out").mkdir()
    options = {
        "policy": "halo",
        "method": {"checkpoints": str(save(tmp_path / "policies")), "chunks": 1},
        "garments": "train",
    }
    runner = make_evaluation_runner("FoldTops-v1", options)
    try:
        result = runner.run(attempt_index=0, seed=5, out_dir=tmp_path / "out", episode_id="e")
    finally:
        runner.close()
    assert not result.success
    # What it does to the garment is chance: where it drags it away from where a later stage looks for it, it ends there.
    assert result.value is not None  # even where it is carried out of sight, as from this seed
    assert result.measurements["steps"] > 500
