"""Episodes with the affordance of another matcher."""

import dataclasses

import numpy as np
import pytest

from dgl_assets import load_garment
from dgl_collect import read_episode, write_episode
from dgl_collect.demonstration import load_demonstration
from dgl_collect.relabel import Relabeller, relabel_episodes
from dgl_tasks import get_task, task_ids

TASK = "FlingTrousers-v1"
WAISTBAND, HEMS = ("left_waistband", "right_waistband"), ("left_hem_middle", "right_hem_middle")
GRASPS = {"fling": WAISTBAND, "pull_legs": HEMS, "spread_waist": WAISTBAND}
POINTS = load_demonstration(TASK).points
AHEAD = np.array([0.0, 0.6, 0.0])


class SamePlaces:
    """Takes a garment for the demonstration's own, laid elsewhere."""

    def match(self, source_cloud, source_points, target_cloud):
        away = np.linalg.norm(target_cloud - AHEAD - source_points[:, None], axis=2)
        return away.argmin(axis=1), np.exp(-away).astype(np.float32)


@pytest.fixture
def relabeller():
    return Relabeller(TASK, matcher=SamePlaces())


def make_episode(fakes, *, off=0.0, mirrored=False, **changes):
    """An episode whose hands went `off` beside the points that are matched."""
    cloud = np.random.default_rng(0).uniform((-1, 2, 0), (1, 3, 0), (2048, 3))  # far away
    stages = []
    side = [-1, 1, 1] if mirrored else [1, 1, 1]
    for number, (name, grasp) in enumerate(GRASPS.items()):
        cloud[:4] = [(POINTS[point] + AHEAD) * side for point in WAISTBAND + HEMS]
        cloud[4:6] = [(POINTS[point] + AHEAD) * side for point in grasp]
        cloud[4:6, 1] += off
        went = np.zeros((2048, 2), np.float32)
        went[4, int(mirrored)] = went[5, 1 - int(mirrored)] = 1.0
        stages.append(
            fakes.make_stage(
                number,
                name=name,
                garment_point_cloud=cloud.astype(np.float32),
                points_affordance_feature=went,
            )
        )
    return fakes.make_episode(**({"task": TASK, "stages": tuple(stages)} | changes))


@pytest.mark.parametrize("mirrored", [False, True], ids=["face up", "face down"])
def test_the_affordance_becomes_what_the_matcher_sees(relabeller, fakes, mirrored):
    episode = make_episode(fakes, off=0.05, mirrored=mirrored)
    relabelled, distance = relabeller.relabel(episode)
    assert distance == pytest.approx(0.05, abs=1e-6)
    assert (relabelled.matcher, relabelled.affordance_matcher) == ("exact", "gam")
    for before, after, grasp in zip(
        episode.stages, relabelled.stages, GRASPS.values(), strict=True
    ):
        feature = after.points_affordance_feature
        assert feature.max(axis=0) == pytest.approx((1.0, 1.0), abs=1e-6)
        peaks = after.garment_point_cloud[feature.argmax(axis=0)]
        matched = np.array([POINTS[point] + AHEAD for point in grasp])
        if mirrored:  # each hand takes what lies on its side
            matched = matched[::-1] * [-1, 1, 1]
        np.testing.assert_allclose(peaks, matched, atol=1e-6)
        assert peaks[0, 0] < peaks[1, 0]
        kept = dataclasses.replace(
            after, points_affordance_feature=before.points_affordance_feature
        )
        for name, value in vars(before).items():
            np.testing.assert_array_equal(getattr(kept, name), value)


def test_episodes_of_other_hands_and_damaged_files_are_left_out(relabeller, fakes, tmp_path):
    data, out = tmp_path / "data", tmp_path / "out"
    near = write_episode(data / "0.h5", make_episode(fakes, off=0.149))
    far = write_episode(data / "1.h5", make_episode(fakes, off=0.151))
    cut = write_episode(data / "2.h5", make_episode(fakes))
    cut.write_bytes(cut.read_bytes()[:5000])
    other = write_episode(data / "3.h5", make_episode(fakes, task="FlingTops-v1"))
    paths = [near, far, cut, other]

    result = relabel_episodes(paths, out, relabeller)
    assert [path.name for path in result.written] == ["0.h5"]
    assert result.left_out == {far: pytest.approx(0.151, abs=1e-5)}
    assert "not a whole HDF5 file" in result.refused[cut]
    assert "must be of FlingTrousers-v1; got one of FlingTops-v1" in result.refused[other]
    assert sorted(path.name for path in out.iterdir()) == ["0.h5"]
    assert read_episode(out / "0.h5").affordance_matcher == "gam"

    made = (out / "0.h5").stat().st_mtime_ns
    result = relabel_episodes(paths, out, relabeller, within=0.2)
    assert ([p.name for p in result.kept], [p.name for p in result.written]) == (["0.h5"], ["1.h5"])
    assert (out / "0.h5").stat().st_mtime_ns == made


def test_bad_requests_are_refused(relabeller, fakes, tmp_path):
    path = write_episode(tmp_path / "0.h5", make_episode(fakes))
    with pytest.raises(ValueError, match="out must not be the episodes' own folder"):
        relabel_episodes([path], tmp_path, relabeller)
    with pytest.raises(ValueError, match="within must be positive; got 0"):
        relabel_episodes([path], tmp_path / "out", relabeller, within=0)
    first = make_episode(fakes).stages[:1]
    with pytest.raises(ValueError, match=r"must have the stages .*; got \('fling',\)"):
        relabeller.relabel(make_episode(fakes, stages=first))


def make_episode_of(fakes, task, demonstration):
    """An episode of a task: the garment of the demonstration, seen lying ahead in every stage."""
    points = {name: xyz + AHEAD for name, xyz in demonstration.points.items()}
    rng = np.random.default_rng(0)
    low, high = (np.min([*points.values()], axis=0), np.max([*points.values()], axis=0))
    cloud = rng.uniform(low, high + 0.01, (2048, 3)).astype(np.float32)
    cloud[: len(points)] = list(points.values())
    found = {name: {"xyz": xyz.tolist()} for name, xyz in points.items()}
    stages = [
        fakes.make_stage(number, name=stage.name, garment_point_cloud=cloud, points=found)
        for number, stage in enumerate(demonstration.learned_stages)
    ]
    draws = {
        f"{item.name}_{axis}": float(item.position["xy".index(axis)])
        for item in task.objects
        for axis in "xy"
    }
    return fakes.make_episode(task=task.id, stages=tuple(stages), randomisation=draws)


def test_every_task_with_points_can_be_relabelled(fakes, monkeypatch):
    """The stage runner and relabelling share the names of formulas, also of grasps at positions."""
    any_garment = load_garment(load_demonstration(TASK).garment)  # the matcher does not use it
    monkeypatch.setattr("dgl_collect.relabel.load_demonstrated_garment", lambda _: any_garment)
    relabelled = []
    for task in map(get_task, task_ids()):
        demonstration = load_demonstration(task)
        if not demonstration.points:
            continue
        episode = make_episode_of(fakes, task, demonstration)
        after, _ = Relabeller(task.id, matcher=SamePlaces()).relabel(episode)
        assert all(stage.points_affordance_feature.max() > 0 for stage in after.stages)
        relabelled.append(task.id)
    assert len(relabelled) == len(task_ids()) - 1  # Wear Bowl Hat has no points
    assert "StoreTops-v1" in relabelled


def test_draws_without_an_object_are_refused(fakes):
    task = get_task("StoreTops-v1")
    episode = make_episode_of(fakes, task, load_demonstration(task))
    episode = dataclasses.replace(episode, randomisation={})
    with pytest.raises(ValueError, match="the draws must tell where platform stands"):
        Relabeller(task.id, matcher=SamePlaces()).relabel(episode)


def test_a_task_without_points_is_refused():
    with pytest.raises(ValueError, match="WearBowlHat-v1 has no points for a matcher"):
        Relabeller("WearBowlHat-v1", matcher=SamePlaces())
