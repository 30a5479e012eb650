import dataclasses
import json
import math
import os
import shutil
import signal

import h5py
import numpy as np
import pytest
import torch

from dgl_sadp import (
    CheckpointError,
    DiffusionPolicy,
    EpisodeDataset,
    TrainConfig,
    TrainingDivergedError,
    get_train_config,
    load_policy,
    read_card,
    train_policy,
)
from dgl_sadp._values_file import open_values, read_tensors, write_values
from dgl_sadp.normalizer import Range
from dgl_sadp.synthetic import write_synthetic_episodes
from dgl_sadp.validation import compute_validation

pytestmark = pytest.mark.usefixtures("one_thread")

FRAMES = 8
CONFIG = TrainConfig(
    epochs=2,
    batch=8,
    learning_rate=1e-3,
    muon_learning_rate=0.02,
    validation_share=0.3,
    validate_every=1,
    keep_every=1,
)


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("episodes")
    write_synthetic_episodes(folder, 5, frames=FRAMES, points=32)
    return folder


@pytest.fixture
def train(episodes, tmp_path, tiny_config):
    def call(out="run", method="sadp", directory=episodes, config=CONFIG, **options):
        return train_policy(directory, tmp_path / out, tiny_config(method), config, **options)

    return call


@pytest.fixture(scope="module")
def whole(episodes, tmp_path_factory, tiny_config, one_thread):
    """A run that was never interrupted."""
    out = tmp_path_factory.mktemp("whole") / "run"
    return train_policy(episodes, out, tiny_config("sadp"), CONFIG)


SHORT = dataclasses.replace(CONFIG, epochs=1)


@pytest.fixture(scope="module")
def short(episodes, tmp_path_factory, tiny_config, one_thread):
    """A finished run of one epoch."""
    out = tmp_path_factory.mktemp("short") / "run"
    return train_policy(episodes, out, tiny_config("sadp"), SHORT)


@pytest.fixture
def short_run(short, tmp_path):
    """A copy of the short run's folder, to be changed."""
    return shutil.copytree(short.policy.parent, tmp_path / "run")


def weights(result):
    return load_policy(result.policy).state_dict()


def assert_equal(first, second):
    assert set(first) == set(second)
    assert all(torch.equal(tensor, second[name]) for name, tensor in first.items())


def test_a_run_leaves_the_averaged_policy_its_card_and_its_logs(train, tmp_path):
    told = []
    result = train(on_progress=told.append)
    windows = 3 * (FRAMES + 2)
    steps = 2 * math.ceil(windows / 8)
    assert (result.episodes, result.validation_episodes, result.windows) == (3, 2, windows)
    assert [progress.step for progress in told] == list(range(1, steps + 1))
    assert [progress.epoch for progress in told] == sorted([1, 2] * (steps // 2))
    assert told[-1].seconds_left == 0.0
    assert result.validation == told[-1].validation
    assert result.validation.epoch == 2
    card = read_card(result.policy)
    assert (card["longest"], card["tasks"], card["epochs_done"]) == ([FRAMES], ["Synthetic-v1"], 2)
    assert card["cloud"] == "segmented"
    assert len(card["episodes"]) == 3
    assert not set(card["episodes"]) & set(card["validation_episodes"])
    assert card["training"]["seed"] == 42
    assert set(card["versions"]) >= {"dgl-sadp", "torch", "diffusers"}
    run = tmp_path / "run"
    assert json.loads((run / "config.json").read_text())["training"]["epochs"] == 2
    assert [each.name for each in sorted((run / "policies").iterdir())] == [
        "epoch-00001.safetensors",
        "epoch-00002.safetensors",
    ]
    assert list((run / "logs").iterdir())


def test_every_policy_trains(method, train):
    result = train(method=method, config=SHORT)
    assert load_policy(result.policy).config.method == method
    assert math.isfinite(result.loss)
    assert 0 < result.validation.error < math.pi


@pytest.mark.parametrize("at", [1, 3])  # Within an epoch of three steps, and at its end.
def test_a_resumed_run_ends_as_if_it_had_not_been_interrupted(train, whole, at):
    train("parts", stop_after=at)
    resumed = train("parts", is_resumed=True)
    assert_equal(weights(whole), weights(resumed))
    assert (resumed.loss, resumed.validation) == (whole.loss, whole.validation)
    again = train("parts", is_resumed=True)  # Nothing is left to do.
    assert again.steps == whole.steps
    assert again.loss == whole.loss


@pytest.mark.parametrize("rate", [None, 0.02])
def test_muon_trains_the_matrices_where_it_is_asked_for_and_adamw_the_rest(train, tmp_path, rate):
    result = train(config=dataclasses.replace(CONFIG, epochs=1, muon_learning_rate=rate))
    state = tmp_path / "run" / "state.safetensors"
    with open_values(state, kind="dgl_sadp.training") as (file, _):
        kept = set(file.found)
    parts = {name: tensor.ndim for name, tensor in weights(result).items() if "range" not in name}
    by_muon = {name.partition("/")[2] for name in kept if name.startswith("momentum_buffer/")}
    by_adamw = {name.partition("/")[2] for name in kept if name.startswith("exp_avg/")}
    trained = {name.partition("/")[2] for name in kept if name.startswith("weight/")}
    assert by_muon | by_adamw == trained
    assert not by_muon & by_adamw
    hidden = {name for name in trained if parts[name] == 2 and "film" not in name}
    assert by_muon == (hidden if rate else set())
    assert any("unet" in name for name in by_muon) == (rate is not None)


def test_an_interruption_before_the_first_state_costs_what_was_done(train, whole, tmp_path):
    train("parts", stop_after=1)
    (tmp_path / "parts" / "state.safetensors").unlink()
    assert_equal(weights(whole), weights(train("parts", is_resumed=True)))


def test_ctrl_c_finishes_the_step_and_saves(train, whole):
    def interrupt(progress):
        if progress.step == 4:
            os.kill(os.getpid(), signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train("parts", on_progress=interrupt)
    assert signal.getsignal(signal.SIGINT) is before
    assert_equal(weights(whole), weights(train("parts", is_resumed=True)))


def test_two_runs_are_the_same_and_another_seed_is_another(train, short):
    before = torch.get_rng_state()
    assert_equal(weights(short), weights(train("again", config=SHORT)))
    assert torch.equal(torch.get_rng_state(), before)  # The global generator is left alone.
    other = weights(train("other", config=dataclasses.replace(SHORT, seed=7)))
    name = "unet.out.1.weight"
    assert not torch.equal(other[name], weights(short)[name])


def test_reading_by_other_processes_changes_nothing(train, short):
    assert_equal(weights(short), weights(train("workers", config=SHORT, workers=1, keep_bytes=0)))


def test_ranges_come_from_the_episodes_that_are_trained_on(short, episodes):
    used = read_card(short.policy)["episodes"]
    actions = []
    dataset = EpisodeDataset(episodes)
    arms = [*range(6), *range(30, 36)]
    names = [episode.path.name for episode in dataset.episodes]
    for window in dataset.select([names.index(name) for name in used]):
        window["action"][:, arms] -= window["start_joint_state"][arms]
        actions.append(window["action"])
    found = load_policy(short.policy).normalizer.of("action")
    normalized = found.normalize(torch.from_numpy(np.concatenate(actions)))
    assert normalized.abs().max() <= 1 + 1e-5
    varying = [0, 3, 10, 30, 59]
    torch.testing.assert_close(normalized.amax(0)[varying], torch.ones(5))
    torch.testing.assert_close(normalized.amin(0)[varying], -torch.ones(5))
    assert not normalized[:, [4, 5, 34, 35]].any()  # Joints that never move.


def test_damaged_episodes_are_left_out_by_name_and_the_rest_is_trained_on(train, tmp_path):
    folder = tmp_path / "episodes"
    paths = write_synthetic_episodes(folder, 5, frames=FRAMES, points=32)
    paths[1].write_bytes(paths[1].read_bytes()[:5000])
    with h5py.File(paths[3], "a") as file:
        file["stage_1/env_point_cloud"][2, 3, 1] = np.nan
    result = train(directory=folder, config=SHORT)
    assert sorted(error.path.name for error in result.refused) == [paths[1].name, paths[3].name]
    assert result.episodes + result.validation_episodes == 3


def test_what_does_not_fit_is_refused(train, tmp_path, short_run):
    with pytest.raises(FileExistsError, match="run holds a run already"):
        train()
    with pytest.raises(CheckpointError, match=r"another training \(epochs: 1 then, 2 now\)"):
        train(is_resumed=True)
    with pytest.raises(CheckpointError, match=r"another policy \(method: 'sadp' then, 'dp3' now"):
        train(method="dp3", is_resumed=True, config=SHORT)
    with pytest.raises(CheckpointError, match="holds no run to resume"):
        train("nothing", is_resumed=True)
    with pytest.raises(ValueError, match="device must be 'cpu' or 'cuda'; got 'tpu'"):
        train("other", device="tpu")
    with pytest.raises(FileNotFoundError, match="no episode files"):
        train("other", directory=tmp_path / "empty")


def test_a_run_over_other_episodes_is_not_resumed(train, tmp_path):
    folder = tmp_path / "episodes"
    write_synthetic_episodes(folder, 4, frames=FRAMES, points=32)
    train(directory=folder, stop_after=1)
    write_synthetic_episodes(folder, 4, frames=FRAMES, points=32, seed=1)
    with pytest.raises(CheckpointError, match="begun with another data"):
        train(directory=folder, is_resumed=True)
    for path in folder.glob("*-s1-*"):
        path.unlink()
    with h5py.File(next(iter(sorted(folder.glob("*.h5")))), "a") as file:
        file["stage_1/action"][0, 0] = 50.0
    with h5py.File(sorted(folder.glob("*.h5"))[1], "a") as file:
        file["stage_1/action"][0, 0] = 50.0
    with pytest.raises(CheckpointError, match="other values in its episodes"):
        train(directory=folder, is_resumed=True)


def test_a_damaged_state_is_refused(train, short_run):
    state = short_run / "state.safetensors"
    state.write_bytes(state.read_bytes()[:-100])
    with pytest.raises(CheckpointError, match=r"state\.safetensors cannot be read"):
        train(config=SHORT, is_resumed=True)


def test_a_loss_that_is_not_finite_ends_the_run(train):
    wild = dataclasses.replace(CONFIG, learning_rate=1e30, warmup_steps=0)
    with pytest.raises(TrainingDivergedError, match=r"loss of step .* is not finite; lower"):
        train(config=wild)


def test_the_validation_measures_the_averaged_policy_in_evaluation_mode(whole, episodes):
    policy = load_policy(whole.policy)
    card = read_card(whole.policy)
    dataset = EpisodeDataset(episodes)
    names = [episode.path.name for episode in dataset.episodes]
    validation = dataset.select([names.index(name) for name in card["validation_episodes"]])
    found = compute_validation(
        policy, validation, epoch=2, windows=CONFIG.validation_windows, seed=CONFIG.seed
    )
    # Floats differ in the last digits: batches of this dataset hold a pose more.
    assert found.loss == pytest.approx(whole.validation.loss, rel=1e-5)
    assert found.error == pytest.approx(whole.validation.error, rel=1e-5)
    assert found.largest_error == pytest.approx(whole.validation.largest_error, rel=1e-5)
    with pytest.raises(ValueError, match="must be in evaluation mode"):
        compute_validation(policy.train(), validation, epoch=4, windows=8, seed=0)


def test_validation_tells_the_joint_that_is_farthest_off(tmp_path, make_episode, tiny_config):
    make_episode(tmp_path / "0.h5", frames=1)  # All states are 0, all targets 0.5.
    policy = DiffusionPolicy.make(tiny_config("dp3"), seed=0).eval()
    constant = np.full(60, 0.5)
    constant[:6] = 0.25
    constant[59] = 3.5
    policy.normalizer.of("action").fit(Range(constant, constant))
    found = compute_validation(policy, EpisodeDataset(tmp_path), epoch=1, windows=8, seed=0)
    assert found.error == pytest.approx((6 * 0.25 + 3.0) / 60)
    assert found.largest_error == pytest.approx(3.0)


def test_bf16_is_trained_and_its_weights_stay_float32(train):
    result = train(config=dataclasses.replace(SHORT, precision="bf16"))
    assert math.isfinite(result.loss)
    assert all(tensor.dtype == torch.float32 for tensor in weights(result).values())


def test_configurations_out_of_range_are_refused():
    for name, value in {
        "epochs": 0,
        "batch": 0,
        "learning_rate": 0.0,
        "muon_learning_rate": 0.0,
        "validation_share": 1.0,
        "precision": "fp16",
        "keep_every": -1,
    }.items():
        with pytest.raises(ValueError, match=name):
            dataclasses.replace(CONFIG, **{name: value})


def test_paper_presets_are_the_published_ones():
    assert {
        name: (
            (c := get_train_config(name, "paper")).epochs,
            c.batch,
            c.keep_every,
            c.validate_every,
        )
        for name in ("sadp", "sadp-g", "dp3", "dp")
    } == {
        "sadp": (3000, 200, 100, 25),
        "sadp-g": (3000, 200, 100, 25),
        "dp3": (10000, 256, 500, 50),
        "dp": (500, 32, 50, 2),
    }
    config = get_train_config("sadp", "paper")
    assert (config.learning_rate, config.betas, config.weight_decay) == (1e-4, (0.95, 0.999), 1e-6)
    assert (config.warmup_steps, config.validation_share) == (500, 0.02)
    assert (config.ema_power, config.ema_decay) == (0.75, 0.9999)
    assert config.muon_learning_rate is None
    with pytest.raises(ValueError, match=r"method must be one of .*; got 'act'"):
        get_train_config("act")


def test_a_state_of_wrong_values_or_shapes_is_refused_in_one_line(train, short_run):
    path = short_run / "state.safetensors"
    with open_values(path, kind="dgl_sadp.training") as (file, values):
        tensors = read_tensors(file)
    schedules = values["schedules"]

    def with_schedule(**changes):
        return {"schedules": [{**schedules[0], **changes}, *schedules[1:]]}

    def with_tensor(kind):
        return {next(name for name in tensors if name.startswith(f"{kind}/")): torch.zeros(3, 3)}

    table = [
        ({"step": "many"}, {}, "step should be a valid integer; got 'many'"),
        ({"step": -1}, {}, "step should be greater than or equal to 0; got -1"),
        ({"step": None}, {}, "step should be a valid integer; got None"),
        ({"schedules": []}, {}, "schedules must be 2; got 0"),
        ({"schedules": [{}, {}]}, {}, r"schedules must have \[.*; got \[\]"),
        (with_schedule(_last_lr=[1.0, 1.0]), {}, r"schedules\._last_lr must be like"),
        (with_schedule(last_epoch="x"), {}, r"schedules\.last_epoch should be a valid integer"),
        (with_schedule(lr_lambdas=[{}]), {}, r"schedules\.lr_lambdas\[0\] should be a valid nu"),
        ({"last": {"validation": {"epoch": 1}}}, {}, r"last\.validation must have \["),
        ({"described": []}, {}, "described should be a valid dictionary"),
        ({}, with_tensor("weight"), "do not fit its configuration"),
        ({}, with_tensor("exp_avg"), "must have shape"),
    ]
    for changes, others, message in table:
        write_values(
            path, {**tensors, **others}, kind="dgl_sadp.training", values={**values, **changes}
        )
        with pytest.raises(CheckpointError, match=message) as caught:
            train(config=SHORT, is_resumed=True)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_one_episode_is_trained_on_without_validation(tmp_path, tiny_config):
    write_synthetic_episodes(tmp_path / "one", 1, frames=6, points=64)
    result = train_policy(
        tmp_path / "one",
        tmp_path / "out",
        tiny_config("dp3"),
        dataclasses.replace(CONFIG, epochs=1, validation_share=0.5),
    )
    assert (result.episodes, result.validation_episodes, result.validation) == (1, 0, None)


def test_one_policy_learns_all_stages_and_goes_on_to_the_same_weights(train, tmp_path, episodes):
    folder = tmp_path / "two"
    shutil.copytree(episodes, folder)
    for path in folder.glob("*.h5"):
        with h5py.File(path, "a") as file:
            file.copy("stage_1", "stage_2")
            file["stage_2/action"][:] += 1.0
    config = dataclasses.replace(CONFIG, group=4)
    result = train("whole", directory=folder, config=config)
    policy, card = load_policy(result.policy), read_card(result.policy)
    assert policy.config.stages == 2
    assert card["longest"] == [FRAMES, FRAMES]
    assert result.windows == result.episodes * 2 * (FRAMES + 2)
    train("part", directory=folder, config=config, stop_after=5)
    again = train("part", directory=folder, config=config, is_resumed=True)
    found = load_policy(again.policy).state_dict()
    assert all(torch.equal(found[k], v) for k, v in policy.state_dict().items())
