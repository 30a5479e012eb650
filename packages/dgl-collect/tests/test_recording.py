import numpy as np
import pytest

from dgl_collect import Observation, StageRecorder, StageStart, VideoWriter


def make_start():
    return StageStart(
        name="left_sleeve",
        garment_point_cloud=np.zeros((2048, 3), np.float32),
        points_affordance_feature=np.zeros((2048, 2), np.float32),
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
    record(recorder, 1)
    with pytest.raises(ValueError, match=r"shape \(60,\); got \(30,\)"):
        recorder.before_step(np.zeros(30), lambda: None)
    with pytest.raises(ValueError, match=r"shape \(D,\); got \(1, 60\)"):
        StageRecorder(make_start()).before_step(np.zeros((1, 60)), lambda: None)


def test_every_frame_goes_to_the_film(tmp_path):
    with VideoWriter(tmp_path / "a.mp4") as video:
        record(StageRecorder(make_start(), video=video), 11)
        assert video.frame_count == 3
