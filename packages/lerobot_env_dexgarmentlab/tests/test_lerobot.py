"""LeRobot reads our data sets, trains on them, and evaluates on our tasks."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from lerobot.configs.types import FeatureType
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.envs.factory import make_env

from dgl_collect import read_episode
from dgl_collect.exporting.origins import read_origins
from lerobot_env_dexgarmentlab import DexGarmentLabEnv
from lerobot_env_dexgarmentlab.env import GarmentLeRobotEnv

SCRIPTS = Path(sys.executable).parent
SMALL = ["--policy.dim_model=32", "--policy.n_heads=2", "--policy.dim_feedforward=32"]
SMALL += ["--policy.n_encoder_layers=1", "--policy.n_vae_encoder_layers=1"]
SMALL += ["--policy.chunk_size=5", "--policy.n_action_steps=5"]
SMALL += ["--policy.pretrained_backbone_weights=null", "--policy.push_to_hub=false"]


def test_features_follow_the_control_mode_and_the_cameras():
    config = DexGarmentLabEnv(task="HangTops-v1", cameras="environment_camera, video_camera")
    assert config.features["action"].shape == config.features["agent_pos"].shape == (60,)
    assert config.features["pixels/video_camera"].shape == (240, 320, 3)
    assert config.features_map["pixels/video_camera"] == "observation.images.video_camera"
    assert config.features["environment_state"].type is FeatureType.ENV
    short = DexGarmentLabEnv(task="HangTops-v1", control_mode="pd_hand_poses", cameras="")
    assert short.features["action"].shape == (22,)
    assert not any(key.startswith("pixels") for key in short.features)


def test_lerobot_reads_what_was_written(dataset):
    read = LeRobotDataset(repo_id="local/hang", root=dataset, video_backend="pyav")
    assert read.num_episodes == 2
    assert read.fps == 12
    frame = read[3]
    assert frame["action"].shape == frame["observation.state"].shape == (22,)
    assert frame["observation.images.left_wrist_camera"].shape == (3, 48, 64)
    places = DexGarmentLabEnv(task="HangTops-v1").features["environment_state"].shape
    assert frame["observation.environment_state"].shape == places
    assert "Hang" in frame["task"]


def test_exported_actions_succeed_in_the_evaluated_environment(dataset):
    command = [SCRIPTS / "dgl", "check", "lerobot", dataset, "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    found = json.loads(done.stdout)["episodes"]
    assert [each["recorded"] for each in found] == [True, True]
    assert any(each["reached"] for each in found)  # 12 Hz are not 60: one may be lost
    assert all(each["actions"] > 50 for each in found)


def test_vector_environments_of_lerobot_begin_where_the_episodes_did(dataset):
    origin = read_origins(dataset).episodes[0]
    config = DexGarmentLabEnv(
        task="HangTops-v1", control_mode="pd_hand_poses", width=64, height=48, matcher="exact"
    )
    (vector,) = make_env(config, n_envs=1)["dexgarmentlab"].values()
    seen, info = vector.reset(seed=[origin.seed], options={"garment": origin.garment})
    first = LeRobotDataset(repo_id="local/hang", root=dataset, video_backend="pyav")[0]
    np.testing.assert_allclose(seen["agent_pos"][0], first["observation.state"], atol=1e-4)
    np.testing.assert_allclose(
        seen["environment_state"][0], first["observation.environment_state"], atol=1e-3
    )
    assert seen["pixels"]["environment_camera"].shape == (1, 48, 64, 3)
    assert info["is_success"].tolist() == [False]
    assert vector.call("task_description")[0].startswith("Hang")
    assert vector.call("_max_episode_steps") == (400,)
    with pytest.raises(ValueError, match="actions must"):
        vector.step(np.zeros((1, 5)))
    vector.close()


def test_an_episode_may_begin_at_the_grasp_points(dataset):
    origin = read_origins(dataset).episodes[0]
    file = sorted((dataset.parent / "run/episodes").glob("*.h5"))[0]
    recorded = read_episode(file)
    env = GarmentLeRobotEnv(
        task="HangTops-v1", control_mode="pd_hand_poses", matcher="exact", start="grasped"
    )
    env.reset(seed=origin.seed, options={"garment": origin.garment})
    np.testing.assert_array_equal(
        np.stack(env._driver.commands), recorded.commands[: recorded.stages[0].first_step]
    )
    env.close()
    with pytest.raises(ValueError, match="start must be parked or grasped; got 'home'"):
        GarmentLeRobotEnv(task="HangTops-v1", start="home")


def test_two_environments_step_in_processes_of_their_own():
    config = DexGarmentLabEnv(task="FoldTops-v1", cameras="", episode_length=2, matcher="exact")
    (vector,) = config.create_envs(2, use_async_envs=True)["dexgarmentlab"].values()
    assert isinstance(vector, gymnasium.vector.AsyncVectorEnv)
    seen, _ = vector.reset(seed=[0, 1])
    assert seen["agent_pos"].shape == (2, 60)
    assert not np.allclose(seen["environment_state"][0], seen["environment_state"][1])
    _, _, _, truncated, _ = vector.step(seen["agent_pos"])
    assert truncated.tolist() == [False, False]
    vector.close()


def test_the_file_for_the_hub_makes_environments_as_lerobot_loads_it(monkeypatch):
    file = Path(__file__).parents[1] / "env.py"
    where = ("user/repository", "env.py", str(file), None)
    monkeypatch.setattr("lerobot.envs.factory._download_hub_file", lambda *_: where)
    (vector,) = make_env("user/repository", n_envs=2, trust_remote_code=True)[
        "dexgarmentlab"
    ].values()
    assert vector.num_envs == 2
    assert vector.call("task") == ("FoldTops-v1",) * 2
    vector.close()


def test_act_is_trained_and_evaluated_by_lerobots_own_commands(dataset, tmp_path):
    train = [
        SCRIPTS / "lerobot-train", "--dataset.repo_id=local/hang", f"--dataset.root={dataset}",
        "--dataset.video_backend=pyav", "--dataset.use_imagenet_stats=false", "--policy.type=act",
        "--policy.device=cpu", *SMALL, "--steps=2", "--batch_size=2", "--num_workers=0",
        "--save_freq=2", "--eval_freq=0", f"--output_dir={tmp_path / 'act'}",
        "--wandb.enable=false",
    ]  # fmt: skip
    subprocess.run(train, check=True)
    evaluate = [
        SCRIPTS / "lerobot-eval", "--env.discover_packages_path=lerobot_env_dexgarmentlab",
        "--env.type=dexgarmentlab", "--env.task=HangTops-v1", "--env.control_mode=pd_hand_poses",
        "--env.cameras=environment_camera,left_wrist_camera", "--env.width=64",
        "--env.height=48", "--env.episode_length=3", "--env.matcher=exact",
        f"--policy.path={tmp_path / 'act/checkpoints/000002/pretrained_model'}",
        "--policy.device=cpu", "--eval.n_episodes=1", "--eval.batch_size=1",
        f"--output_dir={tmp_path / 'eval'}",
    ]  # fmt: skip
    subprocess.run(evaluate, check=True)
    told = json.loads((tmp_path / "eval/eval_info.json").read_text())
    assert told["overall"]["n_episodes"] == 1
    assert told["overall"]["pc_success"] == 0.0  # two steps teach nothing
