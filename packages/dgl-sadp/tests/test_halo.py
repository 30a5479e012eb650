from dataclasses import replace

import numpy as np
import pytest

from dgl_sadp import HALO, DiffusionPolicy, HaloStage, PolicyRunner, StageError

CLOUD = np.random.default_rng(0).uniform(-1, 1, (40, 3)).astype(np.float32)


class NearestMatcher:
    """Takes the garments to be the same: similar is what is near."""

    def __init__(self):
        self.calls = []

    def match(self, source_cloud, source_points, target_cloud):
        self.calls.append(source_points)
        distance = np.linalg.norm(target_cloud[None] - source_points[:, None], axis=2)
        return distance.argmin(axis=1), -distance


class SeesOneSide:
    """Takes both points for what is far to the left, and the right one a little for what is far to the right."""

    def match(self, source_cloud, source_points, target_cloud):
        x = target_cloud[:, 0]
        similarity = np.stack([-x, np.maximum(-x, 0.9 * x)])[: len(source_points)]
        return similarity.argmax(axis=1), similarity


class Recorder:
    """An environment without a robot: it notes what it is told, and counts what it has executed."""

    def __init__(self, losses=(), slips=(), done_after=0, nearly_done_after=()):
        self.told = []
        self.executed = 0
        self.losses, self.slips = losses, slips  # after how many targets a look says so
        self.done_after = done_after  # how many targets it takes
        self.nearly_done_after = nearly_done_after  # after how many it is seen to be nearly done

    def begin_stage(self, stage):
        self.told.append(("begin", stage))
        return {"garment_point_cloud": CLOUD, "object_point_cloud": CLOUD}

    def move_hands(self, left, right):
        self.told.append(("move", left, right))

    def observe(self):
        return {
            "joint_state": np.full(60, self.executed, np.float32),
            "env_point_cloud": np.zeros((20, 6), np.float32),
            "image": np.zeros((40, 48, 3), np.uint8),
        }

    def execute(self, target):
        assert target.shape == (60,)
        self.executed += 1
        return self.observe()

    def see_hold(self):
        if self.executed in self.losses:
            return "none"
        return "some" if self.executed in self.slips else "all"

    def end_stage(self, stage):
        self.told.append(("end", stage, self.executed))

    def is_done(self):
        self.told.append(("look",))
        return self.executed >= self.done_after

    def is_nearly_done(self):
        return self.executed in self.nearly_done_after


class Listener:
    """A policy that notes what it observes."""

    def __init__(self, steps=4):
        self.steps = steps
        self.stages, self.seeds, self.frames = [], [], []

    def reset(self, observation, *, seed=None):
        self.stages.append(observation)
        self.seeds.append(seed)

    def observe(self, observation):
        self.frames.append(("observe", observation["joint_state"][0]))

    def act(self, observation):
        self.frames.append(("act", observation["joint_state"][0]))
        return np.zeros((self.steps, 60), np.float32)


def make_stage(policy, chunks=2, left=CLOUD[3], right=CLOUD[8]):
    return HaloStage(policy=policy, chunks=chunks, source_cloud=CLOUD, left=left, right=right)


def test_hands_go_to_the_matched_points_and_then_the_policy_acts():
    policy, driver = Listener(), Recorder()
    (record,) = HALO(NearestMatcher(), [make_stage(policy, chunks=3)]).run(driver)
    begin, move, end = driver.told
    assert begin == ("begin", 1)
    np.testing.assert_array_equal(move[1], CLOUD[3])
    np.testing.assert_array_equal(move[2], CLOUD[8])
    assert end == ("end", 1, 12)
    assert record.targets == 12
    assert record.similarity == (0.0, 0.0)


def test_the_policy_gets_each_observation_once():
    policy = Listener()
    HALO(NearestMatcher(), [make_stage(policy)]).run(Recorder())
    assert [number for _, number in policy.frames] == list(range(8))
    assert [kind for kind, _ in policy.frames] == (["act"] + ["observe"] * 3) * 2


def test_the_affordance_is_the_scaled_similarity_of_both_hands():
    policy = Listener()
    HALO(NearestMatcher(), [make_stage(policy)]).run(Recorder())
    affordance = policy.stages[0]["points_affordance_feature"]
    assert affordance.shape == (40, 2)
    for column, index in ((0, 3), (1, 8)):
        distance = np.linalg.norm(CLOUD - CLOUD[index], axis=1)
        np.testing.assert_allclose(affordance[:, column], 1 - distance / distance.max(), atol=1e-6)


@pytest.mark.parametrize("turns_over", [False, True])
def test_the_sides_of_a_garment_on_its_face_are_exchanged_in_all_stages(turns_over):
    left, right = sorted((CLOUD[3], CLOUD[8]), key=lambda point: point[0])
    stages = [
        make_stage(Listener(), left=right, right=left),  # crossed, as this garment lies
        make_stage(Listener(), left=left, right=right),
    ]
    driver = Recorder()
    HALO(NearestMatcher(), stages, turns_over=turns_over).run(driver)
    first, second = (told[1:] for told in driver.told if told[0] == "move")
    np.testing.assert_array_equal(first, (left, right) if turns_over else (right, left))
    np.testing.assert_array_equal(second, (right, left) if turns_over else (left, right))
    HALO(NearestMatcher(), stages[1:], turns_over=turns_over).run(driver)  # not crossed
    np.testing.assert_array_equal(driver.told[-2][1:], (left, right))


@pytest.mark.parametrize("moved_at_most", [None, 9.0])
@pytest.mark.parametrize("apart", [0.0, 0.3, 9.0])
def test_two_hands_take_hold_of_two_places(apart, moved_at_most):
    driver = Recorder()
    stage = replace(make_stage(Listener()), moved_at_most=moved_at_most)
    HALO(SeesOneSide(), [stage, stage], apart=apart).run(driver)
    leftmost, rightmost = CLOUD[CLOUD[:, 0].argmin()], CLOUD[CLOUD[:, 0].argmax()]
    for move in (told for told in driver.told if told[0] == "move"):
        np.testing.assert_array_equal(move[1], leftmost)
        # nothing is as far as 9 m, and no distance is asked for
        np.testing.assert_array_equal(move[2], rightmost if apart == 0.3 else leftmost)


def test_one_hand_takes_hold_of_what_is_most_similar():
    driver = Recorder()
    HALO(SeesOneSide(), [replace(make_stage(Listener()), right=None)], apart=0.3).run(driver)
    np.testing.assert_array_equal(driver.told[1][1], CLOUD[CLOUD[:, 0].argmin()])


@pytest.mark.parametrize("of", ["both", "one"])
@pytest.mark.parametrize(
    ("losses", "tries", "ends", "executed"),
    [
        ((), 3, [8], 8),
        ((4,), 3, [4, 12], 12),  # begun again once
        ((8,), 3, [8, 16], 16),
        ((4, 8), 2, [4, 12], 12),  # the last try goes on to its end
        ((4,), 1, [8], 8),
    ],
)
def test_a_stage_that_has_lost_the_garment_is_begun_again(losses, tries, ends, executed, of):
    policy = Listener()
    driver = Recorder(losses) if of == "both" else Recorder(slips=losses)
    (record,) = HALO(NearestMatcher(), [make_stage(policy)], tries=tries).run(driver, seed=7)
    assert (record.targets, record.tries) == (executed, len(ends))
    assert [told[2] for told in driver.told if told[0] == "end"] == ends
    assert [told[0] for told in driver.told] == ["begin", "move", "end"] * len(ends)
    assert len(set(policy.seeds)) == len(ends)
    once = Listener()
    HALO(NearestMatcher(), [make_stage(once)], tries=1).run(Recorder(), seed=7)
    assert policy.seeds[0] == once.seeds[0]


@pytest.mark.parametrize(
    ("rounds", "again_from", "done_after", "begun", "looks"),
    [
        (1, 1, 99, [1, 2], 0),  # nobody asks where no round may follow
        (3, 1, 0, [1, 2], 1),
        (3, 1, 17, [1, 2, 1, 2, 1, 2], 2),  # the last round is the last
        (3, 2, 99, [1, 2, 2, 2], 2),
        (2, 2, 99, [1, 2, 2], 1),
    ],
)
def test_rounds_follow_while_the_task_is_seen_not_to_be_done(
    rounds, again_from, done_after, begun, looks
):
    policy, driver = Listener(), Recorder(done_after=done_after)
    stages = [make_stage(policy, chunks=1) for _ in range(2)]
    halo = HALO(NearestMatcher(), stages, rounds=rounds, again_from=again_from)
    records = halo.run(driver, seed=7)
    assert [told[1] for told in driver.told if told[0] == "begin"] == begun
    assert driver.told.count(("look",)) == looks
    assert [record.stage for record in records] == begun
    assert [record.round for record in records] == sorted(record.round for record in records)
    assert records[-1].round == (rounds if done_after else 1)
    assert len(set(policy.seeds)) == len(begun)


def test_what_a_further_round_begins_with_is_given_up_at_once_but_for_the_last_round():
    # Lost in the first round after 4 targets; in the second, the last one, twice, which is then gone through to the end.
    driver = Recorder(losses=(4, 8, 12, 16))
    halo = HALO(NearestMatcher(), [make_stage(Listener(), chunks=3)], tries=3, rounds=2)
    records = halo.run(driver)
    assert [(r.round, r.tries, r.targets) for r in records] == [(1, 1, 4), (2, 3, 4 + 4 + 12)]
    assert ("look",) not in driver.told  # what was lost is not done
    # A stage that no round begins with has its tries in every round.
    driver = Recorder(losses=(4,), done_after=99)
    stages = [make_stage(Listener(), chunks=1), make_stage(Listener(), chunks=1)]
    records = HALO(NearestMatcher(), stages, rounds=2, again_from=2).run(driver)
    assert [(r.stage, r.round, r.tries) for r in records] == [(1, 1, 2), (2, 1, 1), (2, 2, 1)]


@pytest.mark.parametrize(("losses", "targets"), [((), 12), ((8,), 8)])
def test_one_hand_lays_down_what_the_other_has_lost_before_a_further_round(losses, targets):
    driver = Recorder(slips=(4,), losses=losses)
    stages = [make_stage(Listener(), chunks=3), make_stage(Listener(), chunks=1)]
    records = HALO(NearestMatcher(), stages, rounds=2).run(driver)
    # The second stage, and the question whether the task is done, wait for a round in which nothing was lost.
    assert [(r.stage, r.round, r.targets) for r in records] == [
        (1, 1, targets), (1, 2, 12), (2, 2, 4),
    ]  # fmt: skip
    assert ("look",) not in driver.told


@pytest.mark.parametrize(
    ("losses", "nearly_done_after", "course"),
    [
        ((), (12,), [(1, 1, 12), (2, 1, 4)]),
        ((), (8,), [(1, 1, 12), (1, 2, 12), (2, 2, 4)]),
        # Thrown away by both hands it is not gone on with, as good as it may look.
        ((8,), (8,), [(1, 1, 8), (1, 2, 12), (2, 2, 4)]),
    ],
)
def test_what_one_hand_has_laid_down_nearly_right_is_gone_on_with(
    losses, nearly_done_after, course
):
    driver = Recorder(slips=(4,), losses=losses, nearly_done_after=nearly_done_after)
    stages = [make_stage(Listener(), chunks=3), make_stage(Listener(), chunks=1)]
    records = HALO(NearestMatcher(), stages, rounds=2).run(driver)
    assert [(r.stage, r.round, r.targets) for r in records] == course
    assert driver.told.count(("look",)) == (len(course) == 2)  # in the last round nobody asks


@pytest.mark.parametrize(
    ("again_from", "nearly_done_after", "begun"),
    [
        (1, (), [1, 2, 1, 2, 1, 2, 1, 2]),
        (1, range(99), [1, 2, 2, 1, 2, 2]),  # every second round mends what the one before has done
        (1, (16,), [1, 2, 1, 2, 2, 1, 2]),
        (2, range(99), [1, 2, 2, 2, 2]),  # there is no stage that could mend it
    ],
)
def test_what_is_nearly_done_is_mended_before_it_is_begun_again(
    again_from, nearly_done_after, begun
):
    driver = Recorder(done_after=99, nearly_done_after=nearly_done_after)
    stages = [make_stage(Listener(), chunks=1) for _ in range(2)]
    HALO(NearestMatcher(), stages, rounds=4, again_from=again_from).run(driver)
    assert [told[1] for told in driver.told if told[0] == "begin"] == begun


@pytest.mark.parametrize(
    ("fails", "rounds", "again_from", "begun", "looks"),
    [
        (
            [1],
            2,
            1,
            [1, 2, 1, 2],
            0,
        ),  # the second stage may bring it nearer; but the task is not done yet
        ([2], 2, 1, [1, 2, 1, 2], 0),
        ([3], 3, 1, [1, 2, 1, 2, 1, 2], 2),  # done before
        ([2, 3], 3, 2, [1, 2, 2], None),  # nothing of a round is in reach
        ([1, 2], 3, 1, [1, 2], None),
        ([1], 1, 1, [1], None),
        ([4], 2, 1, [1, 2, 1, 2], None),  # no further round goes through it
        ([1], 2, 2, [1], None),
    ],
)
def test_a_stage_out_of_reach_is_left_out_of_all_but_the_last_round(
    fails, rounds, again_from, begun, looks
):
    class Short(Recorder):
        def move_hands(self, left, right):
            super().move_hands(left, right)
            if [told[0] for told in self.told].count("move") in fails:
                raise StageError("left arm cannot reach it")

    driver = Short(done_after=99)
    stages = [make_stage(Listener(), chunks=1) for _ in range(2)]
    halo = HALO(NearestMatcher(), stages, rounds=rounds, again_from=again_from)
    if looks is None:
        with pytest.raises(StageError, match="left arm cannot reach it"):
            halo.run(driver)
    else:
        records = halo.run(driver)
        assert len(records) == len(begun) - len(fails)
        assert [told[1] for told in driver.told if told[0] == "end"] == begun
        assert driver.told.count(("look",)) == looks
    assert [told[1] for told in driver.told if told[0] == "begin"] == begun


@pytest.mark.parametrize(("rounds", "begun"), [(3, [1, 2, 2, 1, 2]), (2, [1, 2, 2])])
def test_what_cannot_be_mended_is_begun_again(rounds, begun):
    class Short(Recorder):
        def move_hands(self, left, right):
            super().move_hands(left, right)
            if [told[0] for told in self.told].count("move") == 3:
                raise StageError("left arm cannot reach it")

    driver = Short(done_after=99, nearly_done_after=range(99))
    stages = [make_stage(Listener(), chunks=1) for _ in range(2)]
    halo = HALO(NearestMatcher(), stages, rounds=rounds)
    if rounds == 2:  # there is no further round
        with pytest.raises(StageError, match="left arm cannot reach it"):
            halo.run(driver)
    else:
        halo.run(driver)
    assert [told[1] for told in driver.told if told[0] == "begin"] == begun


def test_a_further_try_that_cannot_begin_leaves_the_stage_as_it_is():
    class Short(Recorder):
        def move_hands(self, left, right):
            super().move_hands(left, right)
            if [told[0] for told in self.told].count("move") == 2:
                raise StageError("nothing of it lies where it lay")

    driver = Short(losses=(4,))
    stages = [make_stage(Listener(), chunks=2) for _ in range(2)]
    records = HALO(NearestMatcher(), stages).run(driver)
    assert [told[1] for told in driver.told if told[0] == "begin"] == [1, 1, 2]
    assert [told[1] for told in driver.told if told[0] == "end"] == [1, 1, 2]
    assert [(r.stage, r.tries, r.targets) for r in records] == [(1, 1, 4), (2, 1, 8)]


def test_each_round_looks_anew_on_which_side_the_garment_lies():
    class Turning(Recorder):
        """Lies mirrored whenever it has been looked at once."""

        def begin_stage(self, stage):
            sign = [-1, 1, 1] if ("look",) in self.told else [1, 1, 1]
            return super().begin_stage(stage) | {"garment_point_cloud": (CLOUD * sign).astype("f4")}

    class Mirrored(NearestMatcher):
        def match(self, source_cloud, source_points, target_cloud):
            sign = [target_cloud[0, 0] / source_cloud[0, 0], 1, 1]
            return super().match(source_cloud, source_points * sign, target_cloud)

    left, right = sorted((CLOUD[3], CLOUD[8]), key=lambda point: point[0])
    driver = Turning(done_after=99)
    stages = [make_stage(Listener(), left=left, right=right)]
    HALO(Mirrored(), stages, turns_over=True, rounds=2).run(driver)
    first, second = (told[1:] for told in driver.told if told[0] == "move")
    np.testing.assert_array_equal(first, (left, right))
    np.testing.assert_allclose(second, (right * [-1, 1, 1], left * [-1, 1, 1]))


@pytest.mark.parametrize(("field", "least"), [("tries", 1), ("rounds", 1), ("apart", 0)])
def test_there_is_at_least_one_try_and_one_round_and_no_negative_distance(field, least):
    with pytest.raises(ValueError, match=f"{field} must be at least {least}; got {least - 1}"):
        HALO(NearestMatcher(), [make_stage(Listener())], **{field: least - 1})


@pytest.mark.parametrize("again_from", [0, 2])
def test_a_further_round_begins_with_a_stage(again_from):
    with pytest.raises(ValueError, match=rf"again_from must lie in 1 \.\.\. 1; got {again_from}"):
        HALO(NearestMatcher(), [make_stage(Listener())], again_from=again_from)


def test_turning_over_takes_both_hands():
    with pytest.raises(ValueError, match="turns_over needs a point for both hands"):
        HALO(NearestMatcher(), [make_stage(Listener(), left=None)], turns_over=True)


@pytest.mark.parametrize("hand", ["left", "right"])
def test_the_other_hand_of_a_one_handed_stage_stays(hand):
    policy, driver = Listener(), Recorder()
    points = {"left": None, "right": None, hand: CLOUD[5]}
    (record,) = HALO(NearestMatcher(), [make_stage(policy, **points)]).run(driver)
    sent = dict(zip(("left", "right"), driver.told[1][1:], strict=True))
    np.testing.assert_array_equal(sent.pop(hand), CLOUD[5])
    assert list(sent.values()) == [None]
    affordance = policy.stages[0]["points_affordance_feature"]
    np.testing.assert_array_equal(affordance[:, 0], affordance[:, 1])
    assert affordance[5, 0] == pytest.approx(1.0)
    assert len(record.similarity) == 1


def test_without_the_matcher_hands_stay_and_there_is_no_affordance():
    policy, driver = Listener(), Recorder()
    stage = HaloStage(policy=policy, chunks=1)
    (record,) = HALO(None, [stage], use_gam=False).run(driver)
    assert [told[0] for told in driver.told] == ["begin", "end"]
    assert (record.left, record.right) == (None, None)
    affordance = policy.stages[0]["points_affordance_feature"]
    assert affordance.shape == (40, 2)
    assert not affordance.any()


def test_stages_follow_each_other_with_their_own_policies_and_seeds():
    policies, driver, chunks = [Listener(), Listener(steps=2)], Recorder(), []
    halo = HALO(NearestMatcher(), [make_stage(policy) for policy in policies])
    records = halo.run(driver, seed=5, on_chunk=lambda *numbers: chunks.append(numbers))
    assert [told[0] for told in driver.told] == ["begin", "move", "end"] * 2
    assert [record.targets for record in records] == [8, 4]
    assert chunks == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert policies[0].seeds != policies[1].seeds
    again = [Listener(), Listener()]
    HALO(NearestMatcher(), [make_stage(policy) for policy in again]).run(Recorder(), seed=5)
    assert [policy.seeds for policy in again] == [policy.seeds for policy in policies]


def test_every_policy_runs_and_repeats_itself(method, tiny_config):
    runner = PolicyRunner(DiffusionPolicy.make(tiny_config(method), seed=0))
    targets = []

    class Noting(Recorder):
        def execute(self, target):
            targets.append(target)
            return super().execute(target)

    for _ in range(2):
        HALO(NearestMatcher(), [make_stage(runner)]).run(Noting(), seed=1)
    np.testing.assert_array_equal(np.stack(targets[:8]), np.stack(targets[8:]))


def test_a_matcher_that_answers_in_other_shapes_is_refused():
    class Wrong:
        def match(self, *_):
            return np.zeros(2, int), np.zeros((2, 39))

    with pytest.raises(ValueError, match=r"must return shapes \(2,\) and \(2, 40\); got .*39"):
        HALO(Wrong(), [make_stage(Listener())]).run(Recorder())


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: HALO(NearestMatcher(), []), "at least one stage"),
        (lambda: HALO(None, [make_stage(Listener())]), "use_gam needs a matcher"),
        (
            lambda: HALO(NearestMatcher(), [HaloStage(policy=Listener(), chunks=1)]),
            "needs the source_cloud of stage 1",
        ),
        (lambda: make_stage(Listener(), chunks=0), "chunks must be at least 1; got 0"),
        (lambda: make_stage(Listener(), left=CLOUD), r"left must have shape \(3,\); got \(40, 3\)"),
    ],
)
def test_incomplete_parts_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


class Turncoat(Recorder):
    """From the second stage on, the garment is what it was in a mirror."""

    def begin_stage(self, stage):
        cloud = CLOUD if stage == 1 else CLOUD * [-1, 1, 1]
        return super().begin_stage(stage) | {"garment_point_cloud": cloud.astype(np.float32)}


@pytest.mark.parametrize("moved_at_most", [None, 0.3])
def test_points_are_looked_for_near_where_they_first_lay(moved_at_most):
    class Mirrored(NearestMatcher):
        """Is taken in by the mirror."""

        def match(self, source_cloud, source_points, target_cloud):
            turned = np.sign(target_cloud[0, 0]) != np.sign(CLOUD[0, 0])
            return super().match(
                source_cloud, source_points * ([-1, 1, 1] if turned else 1), target_cloud
            )

    policy, driver = Listener(), Turncoat()
    stages = [make_stage(policy), replace(make_stage(policy), moved_at_most=moved_at_most)]
    HALO(Mirrored(), stages).run(driver)
    moves = [told for told in driver.told if told[0] == "move"]
    np.testing.assert_array_equal(moves[0][1], CLOUD[3])
    distance = np.linalg.norm((moves[1][1] - CLOUD[3])[:2])
    if moved_at_most is None:
        np.testing.assert_allclose(moves[1][1], CLOUD[3] * [-1, 1, 1])
        assert distance > 0.3
    else:
        assert distance <= 0.3
        second = policy.stages[1]["points_affordance_feature"]
        far = np.linalg.norm((CLOUD * [-1, 1, 1] - CLOUD[3])[:, :2], axis=1) > 0.3
        assert second[far, 0].max() == 0
        assert second[:, 0].max() > 0.99


def test_points_that_are_gone_are_said_to_be():
    class Gone(Recorder):
        def begin_stage(self, stage):
            return super().begin_stage(stage) | {"garment_point_cloud": CLOUD + 9.0 * (stage - 1)}

    stages = [make_stage(Listener()), replace(make_stage(Listener()), moved_at_most=0.3)]
    with pytest.raises(StageError, match=r"stage 2: nothing of the garment lies within 0\.3 m"):
        HALO(NearestMatcher(), stages).run(Gone())
