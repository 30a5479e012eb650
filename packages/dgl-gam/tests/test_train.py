import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.numpy import save_file

from dgl_files.tensors import seal
from dgl_gam import GamCheckpointError
from dgl_gam.checkpoint import load_checkpoint, save_checkpoint
from dgl_gam.config import PRESETS, GamLevelConfig, NetworkConfig, YawConfig
from dgl_gam.data import GarmentFolder, write_garment
from dgl_gam.data.batches import Batch, BatchConfig, BatchMaker
from dgl_gam.loss import compute_info_nce
from dgl_gam.network import GarmentNetwork
from dgl_gam.train import TRAIN_PRESETS, GamTrainConfig, get_train_config, train

TINY = NetworkConfig(
    levels=(
        GamLevelConfig(centres=64, radius=0.2, neighbours=8, widths=(16, 32)),
        GamLevelConfig(centres=16, radius=0.5, neighbours=8, widths=(32,)),
    ),
    up=((32,), (32,)),
    attention_blocks=1,
    attention_heads=2,
    head_width=32,
    features=32,
)
CONFIG = GamTrainConfig(
    network="tiny",
    steps=6,
    warmup=2,
    save_every=2,
    batch=BatchConfig(groups=1, group_size=2, points=512, positives=4, negatives=20),
)


@pytest.fixture(autouse=True)
def tiny(monkeypatch):
    monkeypatch.setitem(PRESETS, "tiny", TINY)


@pytest.fixture
def folder(shirts):
    return GarmentFolder(shirts, split="train")


def test_info_nce_agrees_with_loops():
    generator = torch.Generator().manual_seed(0)

    def draw(*shape, high):
        return torch.randint(high, shape, generator=generator)

    features = torch.nn.functional.normalize(torch.randn(3, 40, 8, generator=generator), dim=2)
    batch = Batch(
        points=torch.zeros(3, 40, 3),
        category=torch.zeros(3, dtype=torch.int64),
        turned=torch.zeros(3, 40, 3),
        yaw=torch.zeros(3),
        yaw_weight=torch.ones(3),
        clouds=torch.tensor([[0, 1], [2, 0]]),
        source=draw(2, 5, high=40),
        positive=draw(2, 5, high=40),
        negative=draw(2, 5, 7, high=40),
        is_used=draw(2, 5, high=4) > 0,
        is_negative=draw(2, 5, 7, high=4) > 0,
    )
    losses, right = [], []
    for p in range(2):
        a, b = batch.clouds[p]
        for s in range(5):
            if not batch.is_used[p, s]:
                continue
            anchor = features[a, batch.source[p, s]]
            positive = float(anchor @ features[b, batch.positive[p, s]])
            negatives = [
                float(anchor @ features[b, batch.negative[p, s, n]])
                for n in range(7)
                if batch.is_negative[p, s, n]
            ]
            total = sum(math.exp(x / 0.1) for x in [positive, *negatives])
            losses.append(-math.log(math.exp(positive / 0.1) / total))
            right.append(positive > max(negatives))
    loss, accuracy = compute_info_nce(features, batch, temperature=0.1)
    assert loss.item() == pytest.approx(sum(losses) / len(losses), rel=1e-5)
    assert accuracy.item() == pytest.approx(sum(right) / len(right))


def test_one_batch_can_be_learned_by_heart(folder):
    torch.manual_seed(0)
    network = GarmentNetwork(TINY)
    batch = BatchMaker(
        folder, BatchConfig(groups=1, group_size=3, points=512, positives=10), seed=0
    ).make(0)
    optimizer = torch.optim.Adam(network.parameters(), lr=5e-3)
    losses, yaw_losses = [], []
    for _ in range(80):
        loss, accuracy = compute_info_nce(network(batch.points), batch, temperature=0.07)
        yaw_loss = network.yaw.compute_loss(network.yaw(batch.turned), batch.yaw, batch.yaw_weight)
        optimizer.zero_grad()
        (loss + yaw_loss).backward()
        optimizer.step()
        losses.append(loss.item())
        yaw_losses.append(yaw_loss.item())
    assert losses[0] > 3
    assert losses[-1] < 0.6
    assert accuracy > 0.8
    assert yaw_losses[-1] < 0.6 * yaw_losses[0]


def read_weights(path: Path) -> dict[str, torch.Tensor]:
    return load_checkpoint(path).network.state_dict()


def test_a_resumed_run_ends_as_one_without_interruption(folder, tmp_path):
    whole = train(folder, tmp_path / "whole", CONFIG)
    train(folder, tmp_path / "cut", CONFIG, stop_after=3)
    resumed = train(folder, tmp_path / "cut", CONFIG, is_resumed=True)
    first, second = read_weights(whole), read_weights(resumed)
    assert all(torch.equal(first[name], second[name]) for name in first)
    logs = [
        [json.loads(line) for line in (tmp_path / run / "log.jsonl").read_text().splitlines()]
        for run in ("whole", "cut")
    ]
    assert [line["step"] for line in logs[1]] == [1, 2, 3, 4, 5, 6]
    assert [line["loss"] for line in logs[0]] == [line["loss"] for line in logs[1]]
    assert {p.name for p in (tmp_path / "cut").iterdir()} == {
        "config.json",
        "log.jsonl",
        "network.safetensors",
        "state.safetensors",
    }

    class KilledError(Exception):
        pass

    def kill(progress):
        if progress.step == 5:
            raise KilledError

    with pytest.raises(KilledError):  # Between two states: the steps since are repeated.
        train(folder, tmp_path / "killed", CONFIG, on_progress=kill)
    third = read_weights(train(folder, tmp_path / "killed", CONFIG, is_resumed=True))
    assert all(torch.equal(first[name], third[name]) for name in first)
    assert len((tmp_path / "killed" / "log.jsonl").read_text().splitlines()) == 6


def test_a_run_that_died_before_its_first_state_is_not_resumed_as_another(folder, tmp_path):
    train(folder, tmp_path, CONFIG, stop_after=1)
    (tmp_path / "state.safetensors").unlink()
    with pytest.raises(GamCheckpointError, match="begun with another train"):
        train(folder, tmp_path, dataclasses.replace(CONFIG, steps=2), is_resumed=True)
    (tmp_path / "config.json").write_text("rubbish")
    with pytest.raises(GamCheckpointError, match=r"config\.json cannot be read"):
        train(folder, tmp_path, CONFIG, is_resumed=True)


def test_one_network_is_trained_for_several_categories(tmp_path, shirt_fields):
    for category in ("Gown", "Shirt"):
        for seed in (0, 1):
            fields = shirt_fields(seed, category=category)
            write_garment(tmp_path / "data" / f"{category}{seed}.safetensors", **fields)
    both = GarmentFolder(tmp_path / "data")
    config = dataclasses.replace(CONFIG, steps=3, batch=dataclasses.replace(CONFIG.batch, groups=4))
    path = train(both, tmp_path / "together", config)
    network = load_checkpoint(path).network
    assert network.config.categories == ("Gown", "Shirt")
    assert network.category is not None
    # Refined for one of them, it stays a network for both.
    gown = GarmentFolder(tmp_path / "data", categories=["Gown"])
    refined = train(gown, tmp_path / "gown", dataclasses.replace(config, steps=1), start=path)
    assert load_checkpoint(refined).network.config.categories == ("Gown", "Shirt")


def test_training_starts_from_other_weights(folder, tmp_path):
    first = train(folder, tmp_path / "first", CONFIG)
    config = dataclasses.replace(CONFIG, steps=1, lr=1e-9, weight_decay=0.0)
    second = read_weights(train(folder, tmp_path / "second", config, start=first))
    card = load_checkpoint(tmp_path / "second" / "network.safetensors").card
    assert card["earlier"] == [
        {"steps_done": CONFIG.steps, "garments": 9, "deformed": 9, "parts": "all"}
    ]
    for name, tensor in read_weights(first).items():
        torch.testing.assert_close(second[name], tensor, atol=1e-6, rtol=0)


def test_what_cannot_be_resumed_or_started_is_refused(folder, tmp_path):
    with pytest.raises(GamCheckpointError, match="holds no run to resume"):
        train(folder, tmp_path / "none", CONFIG, is_resumed=True)
    path = train(folder, tmp_path / "run", CONFIG, stop_after=1)
    with pytest.raises(FileExistsError, match="holds a run already"):
        train(folder, tmp_path / "run", CONFIG)
    with pytest.raises(GamCheckpointError, match="begun with another train"):
        train(folder, tmp_path / "run", dataclasses.replace(CONFIG, lr=1.0), is_resumed=True)
    network = load_checkpoint(path)
    network.network.config = dataclasses.replace(TINY, categories=("Hat",))
    save_checkpoint(tmp_path / "hat.safetensors", network)
    with pytest.raises(GamCheckpointError, match="is for Hat; the data have Shirt"):
        train(folder, tmp_path / "new", CONFIG, start=tmp_path / "hat.safetensors")


def test_the_presets_are_as_documented():
    paper = get_train_config("paper")
    assert paper.network == "paper"
    assert (paper.batch.groups, paper.batch.group_size) == (32, 2)
    assert (paper.batch.positives, paper.batch.negatives, paper.steps) == (20, 150, 40_000)
    assert TRAIN_PRESETS["cpu"].batch.groups * TRAIN_PRESETS["cpu"].batch.group_size == 16
    with pytest.raises(ValueError, match=r"one of \['cpu', 'paper', 'tune', 'yaw'\]; got 'gpu'"):
        get_train_config("gpu")
    with pytest.raises(ValueError, match="lr must be positive"):
        GamTrainConfig(lr=0.0)


def test_parts_are_trained_without_the_others(folder, tmp_path):
    first = read_weights(train(folder, tmp_path / "first", dataclasses.replace(CONFIG, steps=1)))
    start = tmp_path / "first" / "network.safetensors"
    for parts in ("yaw", "features"):
        config = dataclasses.replace(CONFIG, steps=2, parts=parts)
        seen = []
        out = tmp_path / parts
        path = train(folder, out, config, start=start, on_progress=seen.append)
        for name, tensor in read_weights(path).items():
            is_trained = name.startswith("yaw.") == (parts == "yaw")
            assert torch.equal(tensor, first[name]) != is_trained, name
        assert all((p.yaw_loss > 0) == (parts == "yaw") for p in seen)
        assert all((p.loss > 0) == (parts == "features") for p in seen)


def test_a_new_network_of_the_yaw_leaves_the_features_alone(folder, tmp_path):
    first = train(folder, tmp_path / "first", dataclasses.replace(CONFIG, steps=1))
    config = dataclasses.replace(CONFIG, steps=1, parts="yaw", new_yaw=YawConfig(width=24))
    second = train(folder, tmp_path / "second", config, start=first)
    assert load_checkpoint(second).network.config.yaw.width == 24
    before, after = read_weights(first), read_weights(second)
    kept = [name for name in before if not name.startswith("yaw.")]
    assert kept
    assert all(torch.equal(before[name], after[name]) for name in kept)
    with pytest.raises(ValueError, match="new_yaw must be None"):
        dataclasses.replace(config, parts="features")


def test_a_run_that_ends_early_keeps_its_learning_rate(folder, tmp_path):
    fields = {"steps": 3, "warmup": 1, "save_every": 1}
    short = dataclasses.replace(CONFIG, **fields, decay=100)
    long = dataclasses.replace(CONFIG, **{**fields, "steps": 100})
    ended = train(folder, tmp_path / "ended", short)
    stopped = train(folder, tmp_path / "stopped", long, stop_after=3)
    first, second = read_weights(ended), read_weights(stopped)
    assert all(torch.equal(first[name], second[name]) for name in first)
    with pytest.raises(ValueError, match="decay must not be below steps; got 2 and 3"):
        dataclasses.replace(short, decay=2)


def test_a_damaged_state_is_refused_in_one_line(folder, tmp_path):
    train(folder, tmp_path, CONFIG, stop_after=1)
    path = tmp_path / "state.safetensors"
    whole = path.read_bytes()
    with safe_open(path, framework="np") as file:
        metadata = file.metadata()
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118

    def refuse(message):
        with pytest.raises(GamCheckpointError, match=message) as caught:
            train(folder, tmp_path, CONFIG, is_resumed=True)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)

    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    refuse("is damaged: its checksum does not fit")
    for name, text, message in (
        ("step", "1e999", "metadata are damaged: a number must be finite"),
        ("step", "-1", "step should be greater than or equal to 0"),
        (
            "step",
            "9" * 400,
            "step should be less than or equal to 1099511627776; got a whole number",
        ),
        ("described", "[" * 100_000, "recursion limit exceeded"),
        ("described", "", "metadata are damaged: EOF while parsing"),
        ("version", "3", "version must be '2'; got '3'"),
        ("format", "other", "is no state of a training: .*; got 'other'"),
    ):
        save_file(arrays, path, metadata=seal({**metadata, name: text}, arrays))
        refuse(message)
    name = next(name for name in arrays if name.startswith("exp_avg/"))
    other = name.replace("exp_avg/", "exp_avg_sq/")
    for changed, message in (
        ({name: arrays[name][:0]}, f"{name} must have shape"),
        ({name: arrays[name].astype(np.int32)}, f"{name} must be of type F32; got I32"),
    ):
        save_file({**arrays, **changed}, path, metadata=seal(metadata, {**arrays, **changed}))
        refuse(message)
    fewer = {key: array for key, array in arrays.items() if key != other}
    save_file(fewer, path, metadata=seal(metadata, fewer))
    refuse(f"lacks {other}")
