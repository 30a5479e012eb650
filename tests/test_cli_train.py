"""The verbs `train sadp`, `sadp-g`, `dp3` and `dp`, on made-up episodes."""

import dataclasses
import json

import h5py
import pytest

import dgl_sadp
from dexgarmentlab.cli import main
from dgl_sadp import DiffusionPolicy, get_policy_config, load_policy, read_card, save_policy
from dgl_sadp.config import UNetConfig
from dgl_sadp.synthetic import write_synthetic_episodes


@pytest.fixture(autouse=True)
def _few_channels(monkeypatch):
    """Give the presets' U-Nets a few channels, and few denoising steps: they train in a second."""

    def make(method, size="small"):
        config = get_policy_config(method, size)
        diffusion = dataclasses.replace(config.diffusion, inference_steps=2)
        unet = UNetConfig(widths=(16, 32), step_embedding=8)
        return dataclasses.replace(config, unet=unet, diffusion=diffusion)

    monkeypatch.setattr(dgl_sadp, "get_policy_config", make)


@pytest.fixture(scope="module")
def episodes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("episodes")
    paths = write_synthetic_episodes(folder, 4, frames=6, points=300)
    paths[0].write_bytes(paths[0].read_bytes()[:4000])
    return folder


@pytest.mark.parametrize("method", ["sadp", "sadp-g", "dp3", "dp"])
def test_each_policy_is_trained(method, episodes, tmp_path, capsys):
    out = tmp_path / "run"
    command = ["train", method, "--data", str(episodes), "--out", str(out), "--epochs", "1"]
    assert main([*command, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert (result["method"], result["preset"]) == (method, "small")
    assert (result["episodes"], result["validation_episodes"], result["steps"]) == (2, 1, 1)
    assert 0 < result["validation_error_deg"] < result["validation_largest_error_deg"] < 180
    (refused,) = result["refused"]
    assert refused.endswith("Synthetic-v1-s0-00000.h5")
    assert load_policy(result["policy"]).config.method == method
    assert read_card(result["policy"])["tasks"] == ["Synthetic-v1"]

    assert main(command) == 1
    assert "run holds a run already; resume it" in capsys.readouterr().err
    assert main([*command, "--resume"]) == 0
    assert "2 episodes, 1 steps, loss" in capsys.readouterr().out


def test_a_policy_without_gam_learns_the_approach_and_sees_no_affordance(tmp_path, capsys):
    data = tmp_path / "episodes"
    paths = write_synthetic_episodes(data, 3, frames=9, points=300)
    command = ["train", "sadp-g", "--data", str(data), "--epochs", "1", "--json", "--out"]
    assert main([*command, str(tmp_path / "never"), "--no-gam"]) == 1
    assert "stage 1 must have its approach recorded" in capsys.readouterr().err
    for path in paths:
        with h5py.File(path, "a") as file:
            file["stage_1"].attrs["approach_frames"] = 3
    windows = {}
    for flag in ("--gam", "--no-gam"):
        assert main([*command, str(tmp_path / flag), flag]) == 0
        result = json.loads(capsys.readouterr().out)
        windows[flag] = result["windows"]
        assert read_card(result["policy"])["longest"] == [6 if flag == "--gam" else 9]
        assert read_card(result["policy"])["training"]["with_approach"] is (flag == "--no-gam")
        assert load_policy(result["policy"]).config.garment.use_affordance is (flag == "--gam")
    assert windows["--no-gam"] == windows["--gam"] + 2 * 3  # two episodes are trained on


def test_what_cannot_be_trained_is_said_in_one_line(episodes, tmp_path, capsys):
    command = ["train", "sadp", "--data", str(episodes), "--out", str(tmp_path / "run")]
    for words, message in (
        (["--resume"], "holds no run to resume"),
        (["--epochs", "0"], "epochs should be greater than or equal to 1; got 0"),
        (
            ["--epochs", "9" * 400],
            "epochs should be less than or equal to 1000000000; got a whole number of",
        ),
        (["--seed", str(2**70)], "seed should be less than or equal to 9223372036854775807; got"),
        (["--threads", "0"], "--threads must lie in 1 ... 1024; got 0"),
        (["--memory", "-1"], "--memory must be at least 0 GiB; got -1.0"),
        (["--memory", "nan"], "--memory must be at least 0 GiB; got nan"),
        (["--memory", "inf"], "--memory must be at least 0 GiB; got inf"),
        (["--data", str(tmp_path / "none")], "no episode files (*.h5) in"),
        (["--devices", "3"], "batch must be a multiple of the 3 devices x group = 4; got 64"),
        (["--devices", "auto"], "on the CPU give a number of processes"),
    ):
        assert main([*command, *words]) == 1
        error = capsys.readouterr().err.splitlines()
        assert message in error[-1]


def test_one_episode_is_trained_on_and_told_how_to_get_another(tmp_path, capsys):
    from dgl_sadp import EpisodeDataset

    data = tmp_path / "one" / "episodes"
    write_synthetic_episodes(data, 1, frames=6, points=300)
    command = ["train", "dp3", "--data", str(data), "--epochs", "1", "--json", "--out"]
    assert main([*command, str(tmp_path / "run")]) == 0
    told = capsys.readouterr()
    result = json.loads(told.out)
    assert (result["episodes"], result["validation_episodes"]) == (1, 0)
    assert result["windows"] == len(EpisodeDataset(data))
    hint = f"`dgl collect Synthetic-v1 --episodes 2 --resume --out {tmp_path / 'one'}`"
    assert hint in told.err.splitlines()[-1]


def test_the_command_for_another_episode_is_that_of_its_run(tmp_path):
    from dexgarmentlab.cli.train_policy import _advise_on_validation

    policy = tmp_path / "policy.safetensors"
    save_policy(policy, DiffusionPolicy(get_policy_config("dp3")), {"tasks": ["FoldTops-v1"]})
    run = {
        "run_format": 1,
        "task": "FoldTops-v1",
        "seed": 3,
        "attempt_factory": "dgl_collect.attempt:make_attempt_runner",
        "options": {},
        "versions": {},
        "commands": [],
    }
    data = tmp_path / "out" / "episodes"
    data.mkdir(parents=True)
    for commands, wanted in (
        (["dgl demo --out o"], "dgl collect FoldTops-v1 --seed 3"),
        (
            ["dgl collect FoldTops-v1 --episodes 9 --seed 3 --out o --look random --resume"],
            "dgl collect FoldTops-v1 --seed 3 --look random",
        ),
    ):
        (data.parent / "run.json").write_text(json.dumps({**run, "commands": commands}))
        told = _advise_on_validation(data, policy)
        assert f"`{wanted} --episodes 1 --resume --out {data.parent}`" in told


def test_an_episode_with_an_attribute_of_a_wrong_type_is_named_and_left_out(
    tmp_path, capsys, caplog
):
    data = tmp_path / "episodes"
    paths = write_synthetic_episodes(data, 4, frames=6, points=300)
    for path, (name, value) in zip(
        paths, (("format_version", "one"), ("success", "False")), strict=False
    ):
        with h5py.File(path, "a") as file:
            file.attrs[name] = value
    command = ["train", "dp3", "--data", str(data), "--out", str(tmp_path / "run"), "--epochs", "1"]
    assert main([*command, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["refused"] == [str(path) for path in paths[:2]]
    for path, text in zip(
        paths, ("format_version must be a whole number", "success must be true"), strict=False
    ):
        assert f"left out: {path}: attribute {text}" in caplog.text


@pytest.mark.slow
def test_devices_share_the_batches(episodes, tmp_path, capfd):
    out = tmp_path / "run"
    command = ["train", "sadp-g", "--data", str(episodes), "--out", str(out), "--epochs", "2"]
    assert main([*command, "--devices", "2", "--json"]) == 0
    result = json.loads(capfd.readouterr().out)  # Of two processes, whose output is one's.
    assert (result["episodes"], result["steps"]) == (2, 2)
    assert load_policy(result["policy"]).config.method == "sadp-g"


def test_help_has_an_example(capsys):
    assert main(["train", "sadp-g", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", "").split())
    assert "Example: dgl train sadp-g --data" in text
    assert "Example: --device cuda --devices 4" in text
