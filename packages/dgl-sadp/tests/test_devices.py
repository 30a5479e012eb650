"""Several devices compute what one does: the same draws, gradients and weights, the same run."""

import dataclasses
import math
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys

import numpy as np
import pytest
import torch

from dgl_sadp import (
    DamagedEpisodeError,
    DiffusionPolicy,
    TrainConfig,
    TrainingProcessError,
    load_policy,
    train_policy,
)
from dgl_sadp._clouds import Augmentation
from dgl_sadp._random import Draws, Share
from dgl_sadp._train_data import Batches
from dgl_sadp._values_file import open_values, read_tensors
from dgl_sadp.synthetic import write_synthetic_episodes

pytestmark = pytest.mark.usefixtures("one_thread")

FRAMES = 7
WINDOWS = 3 * (FRAMES + 2)  # An odd number, so that the last batch of an epoch does not divide.
CONFIG = TrainConfig(epochs=2, batch=14, learning_rate=1e-3, validation_share=0.3, validate_every=1)
MUON = dataclasses.replace(CONFIG, muon_learning_rate=0.02)


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("episodes")
    write_synthetic_episodes(folder, 5, frames=FRAMES, points=32)
    return folder


@pytest.fixture
def train(episodes, tmp_path, tiny_config):
    def call(out="run", directory=episodes, config=CONFIG, **options):
        return train_policy(directory, tmp_path / out, tiny_config("sadp"), config, **options)

    return call


@pytest.fixture(scope="module")
def pair(episodes, tmp_path_factory, tiny_config, one_thread):
    """A whole run of two processes: its folder, result, and what it told."""
    out, told = tmp_path_factory.mktemp("pair") / "run", []
    result = train_policy(
        episodes, out, tiny_config("sadp"), CONFIG, devices=2, on_progress=told.append
    )
    return out, result, told


def read_state(folder):
    with open_values(folder / "state.safetensors", kind="dgl_sadp.training") as (file, _):
        return read_tensors(file)


def shares_of(total, processes):
    return [Share.of(total, process, processes) for process in range(processes)]


@pytest.mark.parametrize("total", [1, 2, 7, 8])
@pytest.mark.parametrize("processes", [1, 2, 3, 8])
def test_shares_are_all_of_a_batch_and_as_even_as_can_be(total, processes):
    shares = shares_of(total, processes)
    counted = [row for each in shares if each.weight for row in range(each.start, each.stop)]
    assert counted == list(range(total))
    sizes = {each.stop - each.start if each.weight else 0 for each in shares}
    assert sizes <= {total // processes, -(-total // processes)}
    assert all(0 <= each.start < each.stop <= total for each in shares)
    assert sum(each.weight for each in shares) == pytest.approx(processes)


def test_a_share_draws_its_rows_of_what_the_whole_batch_draws(seeded):
    def draw(draws, rows):
        return [
            draws.normal((rows, 3, 4)),
            draws.permutation(6).expand(rows, 6),
            draws.uniform((rows,)),
            draws.integers(100, (rows, 2)),
        ]

    whole = draw(Draws(seeded()), 5)
    parts = [draw(Draws(seeded(), each), each.stop - each.start) for each in shares_of(5, 2)]
    for drawn, *of_shares in zip(whole, *parts, strict=True):
        assert torch.equal(drawn, torch.cat(of_shares))
    with pytest.raises(ValueError, match="must have its share of 2 rows; got 5"):
        Draws(seeded(), Share.of(5, 0, 2)).normal((5,))


@pytest.fixture
def double_precision():
    """Use float64: rounding is then far below any real difference."""
    before = torch.get_default_dtype()
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(before)


@pytest.mark.usefixtures("double_precision")
@pytest.mark.parametrize("group", [1, 2])
@pytest.mark.parametrize("processes", [2, 3, 8])
def test_gradients_of_the_shares_make_that_of_the_batch(
    method, processes, group, tiny_config, random_batch, seeded
):
    config = tiny_config(method)
    policy = DiffusionPolicy.make(config, seed=0)
    groups = 5  # Which neither divides nor suffices for eight.
    batch = random_batch(config, count=groups * group)
    batch |= {key: batch[key][::group] for key in config.stage_keys}
    augmentation = Augmentation()

    def find_gradients(share):
        policy.zero_grad()
        rows, encoded = slice(share.start, share.stop), share.divide(group)
        part = {key: values[rows] for key, values in batch.items()}
        part |= {key: batch[key][encoded.start : encoded.stop] for key in config.stage_keys}
        (policy(part, seeded(), augmentation, share) * share.weight).backward()
        return [p.grad.clone() for p in policy.parameters() if p.grad is not None]

    whole = find_gradients(Share.of(groups).multiply(group))
    parts = [find_gradients(each.multiply(group)) for each in shares_of(groups, processes)]
    scale = max(gradient.abs().max() for gradient in whole)
    for wanted, *found in zip(whole, *parts, strict=True):
        assert wanted.dtype == torch.float64
        torch.testing.assert_close(sum(found) / processes, wanted, rtol=1e-8, atol=1e-10 * scale)


def test_processes_read_the_batches_of_one_and_go_on_where_they_stopped():
    counts = np.array([WINDOWS])
    whole = list(Batches(counts=counts, config=CONFIG).iterate(0))
    assert [len(batch) for batch in whole] == [14, 13, 14, 13]
    parts = [Batches(counts=counts, config=CONFIG, process=p, processes=2) for p in range(2)]
    read = list(zip(*(part.iterate(0) for part in parts), strict=True))
    assert [first + second for first, second in read] == whole
    assert list(parts[1].iterate(3)) == [read[3][1]]


def test_windows_come_in_groups_of_one_stage_and_each_at_least_once():
    counts = np.array([10, 3, 7, 1])
    config = dataclasses.replace(CONFIG, batch=8, group=4, epochs=2)
    batches = list(Batches(counts=counts, config=config).iterate(0))
    assert [len(batch) for batch in batches] == [8, 8, 8, 4] * 2
    parts = [Batches(counts=counts, config=config, process=p, processes=2) for p in range(2)]
    read = [first + second for first, second in zip(*(p.iterate(0) for p in parts), strict=True)]
    assert read[:3] == batches[:3]
    part_of = np.repeat(np.arange(4), counts)
    for epoch in (batches[:4], batches[4:]):
        groups = np.concatenate(epoch).reshape(-1, 4)
        assert set(groups.ravel().tolist()) == set(range(21))
        assert (part_of[groups] == part_of[groups[:, :1]]).all()
        assert np.unique(groups, return_counts=True)[1].max() == 4  # The one window of the last.
    assert batches[:4] != batches[4:]
    assert list(Batches(counts=counts, config=config).iterate(6)) == batches[6:]


def test_devices_that_do_not_fit_are_refused_before_anything_is_read(train, monkeypatch, tmp_path):
    for options, message in (
        ({"devices": 3}, "batch must be a multiple of the 3 devices x group = 1; got 14"),
        ({"devices": 0}, "devices must be at least 1, or 'auto'; got 0"),
        ({"devices": "all"}, "devices must be at least 1, or 'auto'; got 'all'"),
        ({"devices": "auto"}, "devices 'auto' is for 'cuda'"),
    ):
        with pytest.raises(ValueError, match=message):
            train(directory=tmp_path / "nothing", **options)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 3)
    for devices, message in (
        (4, r"devices must be at most the 3 CUDA device\(s\) here; got 4"),
        ("auto", "batch must be a multiple of the 3 devices x group = 1; got 14"),
    ):
        with pytest.raises(ValueError, match=message):
            train(directory=tmp_path / "nothing", device="cuda", devices=devices)


@pytest.mark.slow
def test_two_processes_come_to_the_weights_of_one(train, tmp_path, pair):
    one, (folder, two, told) = train("one"), pair
    assert [progress.step for progress in told] == [1, 2, 3, 4]
    # Their sums round differently. An AdamW's step moves a weight by up to 1e-3.
    first, second = (load_policy(result.policy).state_dict() for result in (one, two))
    for name, weight in first.items():
        torch.testing.assert_close(second[name], weight, rtol=1e-4, atol=5e-5)
    assert two.loss == pytest.approx(one.loss, rel=1e-5)
    assert two.validation.epoch == one.validation.epoch
    assert two.validation.loss == pytest.approx(one.validation.loss, rel=1e-5)
    assert two.validation.error == pytest.approx(one.validation.error, rel=1e-4)
    assert dataclasses.replace(two, policy=one.policy, loss=0.0, validation=None) == (
        dataclasses.replace(one, loss=0.0, validation=None)
    )
    first, second = (
        {path.name.partition(".")[0] for path in out.rglob("*")}
        for out in (tmp_path / "one", folder)
    )
    assert first == second
    assert len(list((folder / "logs").iterdir())) == 1


@pytest.mark.slow
def test_gradients_of_two_processes_with_muon_are_those_of_one(train, tmp_path):
    # Of the step itself little can be said: Muon's iterations round to bfloat16, and make a whole
    # direction of what is next to nothing. Moments after one step are gradients, but for a factor.
    for out, devices in (("one", 1), ("two", 2)):
        train(out, config=MUON, devices=devices, stop_after=1)
    one, two = (read_state(tmp_path / out) for out in ("one", "two"))
    names = [name for name in one if name.startswith(("exp_avg/", "momentum_buffer/"))]
    assert {name.partition("/")[0] for name in names} == {"exp_avg", "momentum_buffer"}
    scale = max(one[name].abs().max() for name in names)
    for name in names:
        torch.testing.assert_close(two[name], one[name], rtol=1e-4, atol=1e-6 * scale)


@pytest.mark.slow
def test_two_processes_that_are_interrupted_go_on_to_the_same_weights(train, tmp_path, pair):
    def interrupt(progress):
        if progress.step == 1:
            os.kill(os.getpid(), signal.SIGINT)

    folder, whole, _ = pair
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        train("parts", devices=2, on_progress=interrupt)
    assert signal.getsignal(signal.SIGINT) is before
    assert not multiprocessing.active_children()
    shutil.copytree(tmp_path / "parts", tmp_path / "on_one")
    told = []
    resumed = train("parts", devices=2, is_resumed=True, on_progress=told.append)
    assert 1 < told[0].step <= 4
    # The weights of the second process, of which nothing is kept, were those of the first: it took
    # them over.
    states = [read_state(out) for out in (folder, tmp_path / "parts")]
    assert set(states[0]) == set(states[1])
    assert all(torch.equal(tensor, states[1][name]) for name, tensor in states[0].items())
    assert (resumed.loss, resumed.validation) == (whole.loss, whole.validation)
    on_one = train("on_one", is_resumed=True)
    assert on_one.steps == whole.steps
    assert on_one.loss == pytest.approx(whole.loss, rel=1e-2)


@pytest.mark.slow
def test_what_goes_wrong_in_a_process_is_raised_and_ends_all(train, tmp_path):
    folder = tmp_path / "episodes"
    paths = write_synthetic_episodes(folder, 5, frames=FRAMES, points=32)

    def damage(progress):
        for path in paths:
            path.write_bytes(path.read_bytes()[:5000])

    with pytest.raises(DamagedEpisodeError, match="remove the file"):
        train("damaged", directory=folder, devices=2, keep_bytes=0, on_progress=damage)
    assert not multiprocessing.active_children()

    def kill(progress):
        max(multiprocessing.active_children(), key=lambda process: process.pid).kill()

    with pytest.raises(TrainingProcessError, match="process 1 terminated with signal SIGKILL"):
        train("killed", devices=2, on_progress=kill)
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_processes_of_torchrun_train_as_those_that_are_started_here(pair, episodes, tmp_path):
    folder, here, _ = pair
    script = tmp_path / "script.py"
    script.write_text(
        "import sys\n"
        "from dgl_sadp import TrainConfig, load_policy, train_policy\n"
        "episodes, out, policy, devices = sys.argv[1:]\n"
        "train_policy(\n"
        "    episodes, out, load_policy(policy).config, devices=int(devices),\n"
        "    config=TrainConfig(epochs=2, batch=14, learning_rate=1e-3, validation_share=0.3, "
        "validate_every=1),\n"
        "    on_progress=lambda progress: print(progress.step),\n"
        ")\n"
    )

    def launch(out, devices, *, processes):
        launcher = [sys.executable, "-m", "torch.distributed.run", f"--nproc-per-node={processes}"]
        words = [script, episodes, tmp_path / out, here.policy, devices]
        return subprocess.run(
            [*launcher, *map(str, words)], check=False, capture_output=True, text=True
        )

    run = launch("launched", 2, processes=2)
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == ["1", "2", "3", "4"]
    launched = read_state(tmp_path / "launched")
    assert all(torch.equal(tensor, launched[name]) for name, tensor in read_state(folder).items())
    refused = launch("refused", 2, processes=1)
    assert "must be the 1 process(es) that a launcher has started; got 2" in refused.stderr


@pytest.mark.slow
def test_policies_of_pictures_train_on_two_processes_in_bfloat16(episodes, tmp_path, tiny_config):
    config = dataclasses.replace(CONFIG, epochs=1, precision="bf16")
    result = train_policy(episodes, tmp_path, tiny_config("dp"), config, devices=2)
    assert math.isfinite(result.loss)
    assert load_policy(result.policy).config.method == "dp"
