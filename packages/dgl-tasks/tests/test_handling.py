"""Approach, retreat, park and wait, without a simulator: arms are at their targets."""

from contextlib import contextmanager

import numpy as np
import pytest

from dgl_assets.robots import DEFAULT_ROBOT, HAND_POSES, SIDES
from dgl_tasks.errors import PerceptionError, UnreachableError
from dgl_tasks.grasps import GRASP_ORIENTATIONS, wrist_to_grasp
from dgl_tasks.handling import (
    APPROACH_FROM,
    ARRIVAL_FRAMES,
    CAUGHT_DISTANCE,
    FREE_BACKS,
    FREE_ROLLS,
    PARKED_FRAMES,
    RELEASE_FRAMES,
    SETTLE_FRAMES,
    SETTLE_WAITS,
    STILL_SHARE,
    TAUT_MOST,
    WayOut,
    plan_approach,
    plan_leave,
    plan_way_out,
)
from dgl_tasks.messages import Believes
from dgl_tasks.motion import HAND_FRAMES
from dgl_tasks.observation import STEPS_PER_ACTION

joint_slice = DEFAULT_ROBOT.joint_slice

POINT = {"left": np.array([-0.4, 0.7, 0.1])}
STANDARD = {"left": GRASP_ORIENTATIONS["standard"]["left"]}
BOTH = {"left": np.array([-0.4, 0.7, 0.1]), "right": np.array([0.4, 0.7, 0.1])}
OUTS = {
    "level": WayOut(),
    # what lets cloth slide off the thumb first
    "raised": WayOut(roll=np.radians(60), rise=0.04, wait=15, back=(0.04, 0.02, 0.0), up=0.1),
}


def grasp_point(motion, row, side="left"):
    with motion.rehearsal():
        motion.reset(row)
        pose = motion.compute_poses()[side]
    return wrist_to_grasp(pose[:3], pose[3:], side)


def targets(commands):
    return np.array([command.target for command in commands])


# Ways ------------------------------------------------------------------------------------------


def test_a_hand_comes_down_from_above_and_waits_at_the_grasp_point(motion):
    rows = plan_approach(motion, POINT, STANDARD)
    part = joint_slice("left", "arm")
    path = np.array([grasp_point(motion, row) for row in rows])
    np.testing.assert_allclose(path[-1], POINT["left"], atol=1e-3)
    wait = rows[-ARRIVAL_FRAMES:, part]
    np.testing.assert_array_equal(wait, np.tile(rows[-1, part], (ARRIVAL_FRAMES, 1)))
    assert (rows[-ARRIVAL_FRAMES - 1, part] != rows[-ARRIVAL_FRAMES - 2, part]).any()
    low = path[:, 2] < POINT["left"][2] + APPROACH_FROM[2] - 0.01
    # whatever is near the cloth is right above the goal
    assert np.abs(path[low, :2] - POINT["left"][:2]).max() < 5e-3


def test_hands_may_come_from_outside_and_slower(motion):
    orientations = GRASP_ORIENTATIONS["standard"]
    counts = []
    for spacing in (0.01, 0.002):
        motion.reset(motion.robot.compute_start("open"))
        rows = plan_approach(
            motion, BOTH, orientations, come_from=(0.1, -0.05, 0.02), spacing=spacing
        )
        counts.append(len(rows))
    for side, outwards in (("left", -1), ("right", 1)):
        way = np.array([grasp_point(motion, row, side) for row in rows]) - BOTH[side]
        np.testing.assert_allclose(way[-1], 0, atol=1e-3)
        beside = np.array([outwards * 0.1, -0.05, 0.02])
        assert np.linalg.norm(way - beside, axis=1).min() < 2e-3
        # straight from there
        last = way[np.argmin(np.linalg.norm(way - beside, axis=1)) :]
        along = np.outer(last @ beside, beside) / (beside @ beside)
        assert np.linalg.norm(last - along, axis=1).max() < 2e-3
        assert np.linalg.norm(np.diff(last, axis=0), axis=1).max() < 0.0022
    assert counts[1] > counts[0] + 20


@pytest.mark.parametrize("name", sorted(OUTS))
def test_a_hand_rolls_draws_back_and_rises(motion, name):
    out = OUTS[name]
    plan_approach(motion, POINT, STANDARD)
    first, wait, back, up = plan_leave(motion, POINT, STANDARD, out)
    rolled = motion.compute_poses()["left"][3:]
    ends = [grasp_point(motion, rows[-1]) - POINT["left"] for rows in (first, back, up)]
    heights = [end[2] for end in ends]
    np.testing.assert_allclose(heights, [out.rise, out.rise, out.rise + out.up], atol=2e-3)
    level = [float(np.linalg.norm(end[:2])) for end in ends]
    np.testing.assert_allclose(level, [0.0, out.back[0], out.back[0]], atol=2e-3)
    assert len(wait) == out.wait
    angle = 2 * np.arccos(min(1.0, abs(float(np.dot(rolled, STANDARD["left"])))))
    assert angle == pytest.approx(out.roll, abs=1e-2)


class ShortArm:
    """Reaches grasp points that are not nearer to the robot than `nearest`."""

    def __init__(self, nearest):
        self.nearest, self.goals = nearest, []

    @contextmanager
    def rehearsal(self):
        before = len(self.goals)
        yield
        del self.goals[before:]

    def hold(self, frames):
        return np.zeros((frames, 60))

    def move(self, points, orientations, *, spacing):
        for side, point in points.items():
            if point[1] < self.nearest[side]:
                raise UnreachableError(f"{side} arm cannot reach")
        self.goals.append(points)
        return np.zeros((1, 60))


def test_each_hand_draws_back_as_far_as_its_arm_can(motion):
    orientations = {"left": np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])}  # fingers ahead, along y
    orientations["right"] = orientations["left"]
    out = WayOut(back=(0.12, 0.08, 0.04, 0.0))
    arm = ShortArm({"left": 0.65, "right": 0.5})
    plan_way_out(arm, BOTH, orientations, out)
    ends = arm.goals[-1]
    np.testing.assert_allclose(ends["left"], BOTH["left"] + [0, -0.04, 0.15], atol=1e-9)
    np.testing.assert_allclose(ends["right"], BOTH["right"] + [0, -0.12, 0.15], atol=1e-9)
    with pytest.raises(UnreachableError, match="right arm cannot reach"):
        plan_way_out(ShortArm({"left": 0.65, "right": 0.71}), BOTH, orientations, out)


# Parts of courses ------------------------------------------------------------------------------


def test_hands_are_taken_over_as_a_reset_has_left_them(world):
    start = world.motion.robot.compute_start("open")
    np.testing.assert_array_equal(world.motion.target, start)
    assert not world.hands.is_parked


def test_parking_opens_closed_hands_and_waits_for_the_fingers(world):
    commands = world.play(world.hands.park())
    assert world.hands.is_parked
    np.testing.assert_array_equal(
        targets(commands[-PARKED_FRAMES:]), np.tile(world.target, (PARKED_FRAMES, 1))
    )
    assert all(command.is_passage and command.recorded is None for command in commands)
    # from a parking place with open hands the wait is all there is
    assert len(world.play(world.hands.park())) == PARKED_FRAMES
    world.play(world.hands.send(world.motion.set_hands({"left": "close"})))
    assert len(world.play(world.hands.park())) == HAND_FRAMES + PARKED_FRAMES
    np.testing.assert_allclose(world.target[joint_slice("left", "hand")], HAND_POSES["open"])


def test_an_approach_is_recorded_by_whole_frames_counted_from_its_end(jumping_world):
    rows = np.arange(13.0)[:, None] * np.ones(60)
    commands = jumping_world.play(jumping_world.hands.approach(rows))
    np.testing.assert_array_equal(targets(commands), rows)
    assert [c.recorded for c in commands] == [None] * 3 + ["approach"] * 10
    assert all(command.is_passage for command in commands)


def test_an_action_is_reached_within_five_steps_and_planning_goes_on_from_the_last(jumping_world):
    world, start = jumping_world, jumping_world.motion.target.copy()
    actions = np.stack([start, start + 0.01]).astype(np.float32)  # as commands are
    commands = world.play(world.hands.execute(actions, recorded="stage"))
    assert len(commands) == 2 * STEPS_PER_ACTION
    expected = start + 0.01 * np.array([0, 0, 0, 0, 0, 0.2, 0.4, 0.6, 0.8, 1])[:, None]
    np.testing.assert_allclose(targets(commands), expected, atol=1e-6)
    np.testing.assert_array_equal(world.motion.target, actions[-1])
    assert {(c.recorded, c.is_passage) for c in commands} == {("stage", False)}
    assert world.play(world.hands.execute(np.zeros((0, 60)))) == []


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.zeros(60), r"actions must have shape \(N, 60\); got \(60,\)"),
        (np.zeros((4, 59)), r"actions must have shape \(N, 60\); got \(4, 59\)"),
        (np.full((1, 60), np.nan), "actions must be finite"),
    ],
)
def test_actions_that_no_robot_can_take_are_refused(jumping_world, actions, message):
    with pytest.raises(ValueError, match=message):
        jumping_world.play(jumping_world.hands.execute(actions))
    assert jumping_world.step == 0


def test_a_mark_takes_no_time(jumping_world):
    mark = Believes(values={"value": 0.5})
    assert jumping_world.play(jumping_world.hands.mark(mark)) == []
    assert jumping_world.marks == [mark]


def leave_and_count(world, distances, out=WayOut()):  # noqa: B008 - cannot be changed
    """Retreat the left hand, cloth so far below it look after look [m]; gives the commands."""
    looks = iter(distances)

    def see(camera=None):
        distance = next(looks)
        if distance is None:
            raise PerceptionError("no pixel of the garment")
        return world.get_grasp_point("left")[None] - [0, 0, distance]

    world.see_points = see
    plan_approach(world.motion, POINT, STANDARD)
    commands = world.play(world.hands.retreat(("left",), out))
    check_parked(world)
    assert next(looks, "all") == "all"
    return commands


def check_parked(world):
    for side in SIDES:
        np.testing.assert_allclose(
            world.target[joint_slice(side, "arm")], world.motion.robot.arm.parked[side]
        )
        np.testing.assert_allclose(world.target[joint_slice(side, "hand")], HAND_POSES["open"])


def test_hands_wait_leave_flat_and_are_open_again_once_parked(world):
    commands = leave_and_count(world, [1.0])
    rows, part = targets(commands), joint_slice("left", "hand")
    np.testing.assert_array_equal(rows[:RELEASE_FRAMES], np.tile(rows[0], (RELEASE_FRAMES, 1)))
    heights = np.array([grasp_point(world.motion, row)[2] for row in rows])
    rising = (heights > POINT["left"][2] + 0.02) & (heights < POINT["left"][2] + 0.14)
    assert rising.any()
    np.testing.assert_allclose(
        rows[rising, part], HAND_POSES["flat"] * np.ones((rising.sum(), 1)), atol=1e-5
    )
    assert all(command.is_passage for command in commands)


def test_what_hangs_on_a_risen_hand_is_put_down_again(world):
    near, far = CAUGHT_DISTANCE - 0.01, CAUGHT_DISTANCE + 0.01
    plain = len(leave_and_count(world, [far]))
    assert len(leave_and_count(world, [None])) == plain  # nothing is seen of the garment
    once = leave_and_count(world, [near, far])
    assert len(once) > plain + 60  # down, a wait, back and up again
    path = np.array([grasp_point(world.motion, row) for row in targets(once)])
    risen = int(np.flatnonzero(path[:, 2] > POINT["left"][2] + 0.149)[0])
    again = path[risen:]
    assert again[:, 2].min() == pytest.approx(POINT["left"][2], abs=3e-3)
    low = again[np.abs(again[:, 2] - POINT["left"][2]) < 3e-3]
    drawn = np.linalg.norm(low[-1, :2] - low[0, :2])
    assert drawn == pytest.approx(0.04, abs=5e-3)  # as far as this arm can
    assert 0.04 in FREE_BACKS
    # after the last try it goes away with what it has
    assert len(leave_and_count(world, [near] * len(FREE_ROLLS))) > len(once) + 60


def test_nobody_looks_after_a_hand_that_is_not_to_get_free(world):
    plain = len(leave_and_count(world, [1.0]))
    assert len(leave_and_count(world, [], WayOut(frees=False))) == plain


def test_a_hand_that_does_not_get_free_rolls_on(world, monkeypatch):
    planned = []

    def note(motion, starts, orientations, out):
        planned.append(orientations["left"])
        return plan_way_out(motion, starts, orientations, out)

    monkeypatch.setattr("dgl_tasks.handling.plan_way_out", note)
    leave_and_count(world, [0.0] * len(FREE_ROLLS))
    _, *again = planned  # the first is how it has left
    turns = [2 * np.arccos(min(1.0, abs(float(np.dot(again[0], q))))) for q in again]
    np.testing.assert_allclose(turns, np.cumsum(FREE_ROLLS), atol=2e-3)
    assert FREE_ROLLS[0] == 0.0 < turns[-1]


def test_a_hand_that_cannot_go_down_again_parks_with_what_it_has(world, monkeypatch):
    plain, asked = len(leave_and_count(world, [1.0])), []

    def refuse(motion, starts, orientations, out):
        if asked:  # it has left
            raise UnreachableError("no way down")
        asked.append(True)
        return plan_way_out(motion, starts, orientations, out)

    monkeypatch.setattr("dgl_tasks.handling.plan_way_out", refuse)
    assert len(leave_and_count(world, [0.0])) == plain


def reach_out(world, pose):
    """Bring the left hand to the grasp point, as a policy might."""
    plan_approach(world.motion, POINT, STANDARD)
    world.play(world.hands.execute(world.motion.target[None]))
    action = world.motion.target.copy()
    action[joint_slice("left", "hand")] = HAND_POSES[pose]
    world.play(world.hands.execute(action[None]))


def test_wherever_a_policy_ends_the_hands_open_and_park(world):
    reach_out(world, "close")
    commands = world.play(world.hands.retreat(("left",)))
    check_parked(world)
    assert world.hands.is_parked
    # it opens where it is, and that is no passage yet
    opening = [command for command in commands if not command.is_passage]
    assert len(opening) == HAND_FRAMES
    np.testing.assert_allclose(
        opening[-1].target[joint_slice("left", "hand")], HAND_POSES["open"], atol=1e-9
    )
    path = np.array([grasp_point(world.motion, c.target) for c in commands])
    drawn = np.linalg.norm(path[:, :2] - POINT["left"][:2], axis=1)
    low = np.abs(path[:, 2] - POINT["left"][2]) < 2e-3
    # rolled, drawn back and risen, not torn away
    assert drawn[low].max() == pytest.approx(WayOut().back[0], abs=3e-3)


def test_open_hands_leave_without_being_opened(world):
    reach_out(world, "open")
    commands = world.play(world.hands.retreat(("left",)))
    assert all(command.is_passage for command in commands)
    check_parked(world)


def test_hands_may_retreat_in_another_way(world):
    reach_out(world, "close")
    commands = world.play(world.hands.retreat(("left",), OUTS["raised"]))
    path = np.array([grasp_point(world.motion, c.target) for c in commands])
    risen = np.abs(path[:, 2] - POINT["left"][2] - 0.04) < 1e-3
    drawn = np.linalg.norm(path[risen, :2] - POINT["left"][:2], axis=1)
    assert drawn.max() == pytest.approx(0.04, abs=3e-3)


def test_where_there_is_no_way_straight_up_the_arms_park_at_once(world, monkeypatch):
    reach_out(world, "close")

    def refuse(*_):
        raise ValueError("fingers must not point straight up or down")

    monkeypatch.setattr("dgl_tasks.handling.plan_leave", refuse)
    commands = world.play(world.hands.retreat())
    check_parked(world)
    rows = targets(commands)[HAND_FRAMES:]
    np.testing.assert_array_equal(rows[:RELEASE_FRAMES], np.tile(rows[0], (RELEASE_FRAMES, 1)))


# Rest ------------------------------------------------------------------------------------------


def make_masks(changes, pixels=1000):
    """Two looks for each wait, between which so many pixels change."""
    masks = []
    for change in changes:
        before = np.zeros(2 * pixels, bool)
        before[:pixels] = True
        after = before.copy()
        after[:change] = False
        masks += [before, after]
    return masks


ENOUGH = int(1000 * STILL_SHARE) + 1


@pytest.mark.parametrize(
    ("changes", "waits"),
    [
        ([0], 1),
        ([ENOUGH - 1], 1),
        ([ENOUGH, 0], 2),
        ([500, ENOUGH, 0], 3),
        ([500] * SETTLE_WAITS, SETTLE_WAITS),
    ],
)
def test_what_is_seen_to_move_is_waited_for(jumping_world, changes, waits):
    world = jumping_world
    world.masks = make_masks(changes)
    commands = world.play(world.hands.settle())
    assert len(commands) == waits * SETTLE_FRAMES
    assert world.masks == []
    np.testing.assert_array_equal(
        targets(commands), np.tile(world.motion.target, (len(commands), 1))
    )
    assert world.play(world.hands.settle()) == []  # has been waited for


def test_what_comes_into_sight_moves_too(jumping_world):
    jumping_world.masks = [np.zeros(4, bool), np.ones(4, bool), *make_masks([0])]
    assert len(jumping_world.play(jumping_world.hands.settle())) == 2 * SETTLE_FRAMES


def test_a_garment_out_of_sight_is_seen_to_be_still(jumping_world):
    jumping_world.masks = [np.zeros(4, bool)] * 2
    assert len(jumping_world.play(jumping_world.hands.settle())) == SETTLE_FRAMES


def test_what_has_been_touched_since_is_waited_for_again(jumping_world):
    world = jumping_world
    world.play(world.hands.settle())
    world.play(world.hands.send(world.motion.hold(1)))
    assert len(world.play(world.hands.settle())) == SETTLE_FRAMES


# Taut --------------------------------------------------------------------------------------------


class Band:
    """A world whose left hand holds an elastic band that comes from a place."""

    STIFFNESS = 40.0  # N/m

    def __init__(self, world, place, length):
        self.world, self.place, self.length = world, place, length
        world.pulls = {side: np.zeros(3) for side in SIDES}

    def play(self, rows, tension):
        part = self.world.hands.send_taut(rows, {"left": tension}, towards=self.place)
        item = next(part)
        while True:
            self.world.target = np.array(item.target)
            way = self.place - self.world.get_grasp_point("left")
            far = np.linalg.norm(way)
            self.world.pulls["left"] = self.STIFFNESS * max(far - self.length, 0.0) * way / far
            try:
                item = part.send(self.world)
            except StopIteration:
                return


@pytest.mark.parametrize(("length", "moved"), [(0.25, "towards"), (0.45, "away from")])
def test_a_hand_keeps_a_band_taut(world, length, moved):
    world.motion.reset(world.target)
    world.motion.move(POINT, STANDARD)
    rows = world.motion.hold(400)
    place = POINT["left"] + [0.36, 0.0, 0.05]
    band = Band(world, place, length)
    band.play(rows, 2.0)  # 5 cm longer than its length
    assert np.linalg.norm(world.pulls["left"]) == pytest.approx(2.0, rel=0.05)
    end = world.get_grasp_point("left")
    closer = np.linalg.norm(place - end) < np.linalg.norm(place - POINT["left"])
    assert closer == (moved == "towards")
    np.testing.assert_allclose(end[1:], POINT["left"][1:], atol=2e-3)  # level, along the band


def test_a_slack_band_leads_a_hand_no_farther_than_allowed(world):
    world.motion.reset(world.target)
    world.motion.move(POINT, STANDARD)
    place = POINT["left"] - [0.36, 0.0, 0.0]
    Band(world, place, 2.0).play(world.motion.hold(400), 2.0)
    assert np.linalg.norm(world.get_grasp_point("left") - POINT["left"]) == pytest.approx(
        TAUT_MOST, abs=2e-3
    )
