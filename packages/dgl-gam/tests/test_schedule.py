import dataclasses
import json

import pytest
import torch

from dgl_gam import GamCheckpointError
from dgl_gam.checkpoint import load_checkpoint
from dgl_gam.config import PRESETS, GamLevelConfig, NetworkConfig
from dgl_gam.data import GarmentFolder
from dgl_gam.data.batches import BatchConfig
from dgl_gam.schedule import SCHEDULES, Schedule, ScheduleStage, get_schedule, train_schedule
from dgl_gam.train import GamTrainConfig, get_train_config

TINY = NetworkConfig(
    levels=(GamLevelConfig(centres=32, radius=0.4, neighbours=8, widths=(16,)),),
    up=((16,),),
    attention_blocks=0,
    attention_heads=1,
    head_width=16,
    features=16,
)
BASE = GamTrainConfig(
    network="tiny",
    warmup=1,
    save_every=1,
    batch=BatchConfig(points=256, group_size=2, positives=4, negatives=20),
)
SCHEDULE = Schedule(
    base=BASE,
    stages=(
        ScheduleStage(name="1_wide", steps=3, lr=1e-3, groups=1),
        ScheduleStage(name="2_narrow", steps=2, lr=5e-4, groups=1, margin=0.03, max_distance=0.015),
        ScheduleStage(name="3_yaw", steps=2, lr=1e-3, groups=2, parts="yaw", mirrored_share=0.5),
    ),
)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(PRESETS, "tiny", TINY)


@pytest.fixture
def folder(shirts):
    return GarmentFolder(shirts, split="train")


def read_weights(path):
    return load_checkpoint(path).network.state_dict()


def test_stages_follow_each_other_with_their_own_values(folder, tmp_path):
    seen = []
    path = train_schedule(folder, tmp_path / "run", SCHEDULE, seed=5, on_progress=seen.append)
    assert [p.step for p in seen] == [1, 2, 3, 4, 5, 6, 7]
    assert {p.steps for p in seen} == {SCHEDULE.steps} == {7}
    card = load_checkpoint(path).card
    assert [(s["steps_done"], s["parts"]) for s in card["earlier"]] == [(3, "all"), (2, "all")]
    stages = [
        json.loads((tmp_path / "run" / stage.name / "config.json").read_text())["train"]
        for stage in SCHEDULE.stages
    ]
    assert [s["batch"]["margin"] for s in stages] == [0.04, 0.03, 0.04]
    assert [s["lr"] for s in stages] == [1e-3, 5e-4, 1e-3]
    assert [s["seed"] for s in stages] == [5, 6, 7]
    # The features are those of the second stage, the yaw is that of the third.
    second, last = (
        read_weights(tmp_path / "run" / "2_narrow" / "network.safetensors"),
        read_weights(path),
    )
    differing = {name for name in last if not torch.equal(last[name], second[name])}
    assert differing == {name for name in last if name.startswith("yaw.")}


def test_a_resumed_schedule_ends_as_one_without_interruption(folder, tmp_path):
    whole = read_weights(train_schedule(folder, tmp_path / "whole", SCHEDULE))
    for cut in (2, 3, 4):  # Within a stage, between two, and after the first step of one.
        out, seen = tmp_path / str(cut), []
        train_schedule(folder, out, SCHEDULE, stop_after=cut)
        assert not (out / "network.safetensors").exists()
        resumed = train_schedule(folder, out, SCHEDULE, is_resumed=True, on_progress=seen.append)
        assert [p.step for p in seen] == list(range(cut + 1, 8))
        second = read_weights(resumed)
        assert all(torch.equal(whole[name], second[name]) for name in whole)


def test_what_is_no_run_or_another_one_is_refused(folder, tmp_path):
    with pytest.raises(GamCheckpointError, match="holds no run to resume"):
        train_schedule(folder, tmp_path / "none", SCHEDULE, is_resumed=True)
    train_schedule(folder, tmp_path / "run", SCHEDULE, stop_after=1)
    with pytest.raises(FileExistsError, match="holds a run already"):
        train_schedule(folder, tmp_path / "run", SCHEDULE)
    with pytest.raises(GamCheckpointError, match="begun with other stages"):
        train_schedule(folder, tmp_path / "run", SCHEDULE, seed=1, is_resumed=True)
    with pytest.raises(ValueError, match=r"named, each in its own way; got \['a', 'a'\]"):
        Schedule(
            stages=(
                ScheduleStage(name="a", steps=1, lr=1e-3),
                ScheduleStage(name="a", steps=1, lr=1e-3),
            )
        )
    with pytest.raises(ValueError, match="margin and near must be positive and grow"):
        Schedule(stages=(ScheduleStage(name="a", steps=1, lr=1e-3, margin=0.01),))


def test_a_shorter_schedule_has_all_stages_in_proportion():
    shipped = get_schedule("shipped")
    assert shipped is SCHEDULES["shipped"]
    for steps in (len(shipped.stages), 17, 200, shipped.steps):
        short = shipped.shorten(steps)
        assert short.steps == steps
        assert [s.name for s in short.stages] == [s.name for s in shipped.stages]
    assert shipped.shorten(shipped.steps) == shipped
    with pytest.raises(ValueError, match="one for each stage; got 1"):
        shipped.shorten(1)
    with pytest.raises(ValueError, match="schedule must be one of"):
        get_schedule("fast")


def test_the_stages_of_the_shipped_weights_narrow_their_margins():
    configs = get_schedule("shipped").configure(seed=0)
    assert [c.steps for c in configs][:4] == [1900, 3600, 1500, 750]
    assert [c.lr for c in configs][:4] == [1.5e-3, 1.5e-3, 1e-3, 6e-4]
    assert [c.batch.margin for c in configs][:4] == [0.04, 0.04, 0.03, 0.03]
    assert [c.batch.max_distance for c in configs][:4] == [0.02, 0.02, 0.015, 0.015]
    assert all((c.batch.points, c.batch.positives) == (1024, 48) for c in configs)


def test_the_shipped_yaw_is_trained_by_itself_as_its_preset_says():
    *features, last = get_schedule("shipped").configure(seed=0)
    assert [c.parts for c in features] == ["all"] * 4 + ["features"] * 6
    preset = get_train_config("yaw")
    assert (last.parts, last.lr) == ("yaw", preset.lr)
    batch = dataclasses.replace(preset.batch, positives=last.batch.positives)
    assert last.batch == batch  # which has no pairs, and so no positives
