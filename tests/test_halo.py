"""HALO from what comes with the packages, from a folder, and for the Hugging Face Hub."""

import re
import shutil
from importlib import resources
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

from dexgarmentlab.halo import HALO
from dgl_assets.robots import DEFAULT_ROBOT
from dgl_collect.demonstration import load_demonstration
from dgl_sadp import CheckpointError, DiffusionPolicy, get_policy_config
from dgl_tasks import get_task
from dgl_tasks.errors import UnknownTaskError

SHIPPED = sorted(Path(str(resources.files("dgl_sadp") / "policies")).glob("*.safetensors"))


@pytest.fixture(scope="module")
def halo() -> HALO:
    policy = DiffusionPolicy.make(get_policy_config("sadp-g"), seed=0).eval()
    return HALO(policy, {"tasks": ["HangCoat-v1"], "longest": [40], "license": "apache-2.0"})


def test_a_task_without_a_policy_says_how_to_make_one():
    with pytest.raises(CheckpointError, match=r"dgl train sadp-g --data DIR/episodes --out RUN"):
        HALO.load("FlingTops-v1")
    with pytest.raises(UnknownTaskError, match="FoldTops-v1"):
        HALO.load("FoldTops")


def test_a_folder_gives_back_the_same_policy_in_16_bits(tmp_path, halo, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    halo.save_pretrained(tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "README.md",
        "config.json",
        "policy.safetensors",
    ]
    card = (tmp_path / "README.md").read_text(encoding="utf-8")
    assert card.startswith("---\nlicense: apache-2.0\n")
    assert "SADP-G for HangCoat-v1" in card
    assert HALO(halo.policy, {}).generate_model_card().data.license == "unknown"
    again = HALO.from_pretrained(tmp_path)
    assert again.card == halo.card
    assert again.policy.config == halo.policy.config
    found = again.policy.state_dict()
    for name, weight in halo.policy.state_dict().items():
        assert found[name].dtype == torch.float32
        torch.testing.assert_close(found[name], weight, rtol=1e-3, atol=1e-6)
    assert (tmp_path / "policy.safetensors").stat().st_size < 5e6


def test_what_is_pushed_is_what_comes_back(tmp_path, halo, monkeypatch):
    class Hub:
        def __init__(self, **_): ...

        def create_repo(self, repo_id, **_):
            return SimpleNamespace(repo_id=repo_id)

        def upload_folder(self, *, repo_id, folder_path, **_):
            shutil.copytree(folder_path, tmp_path / repo_id)
            return "done"

    monkeypatch.setattr("huggingface_hub.hub_mixin.HfApi", Hub)
    assert halo.push_to_hub("someone/coat") == "done"
    assert HALO.from_pretrained(tmp_path / "someone/coat").card == halo.card


def test_a_policy_acts_in_an_environment_of_its_task_alone(halo):
    agent = SimpleNamespace(model=DEFAULT_ROBOT)
    env = SimpleNamespace(task=get_task("FoldTops-v1"), agent=agent, cloud="segmented")
    with pytest.raises(ValueError, match="must be of task FoldTops-v1; got HangCoat-v1"):
        halo.make_method(env)
    env.task, env.cloud = get_task("HangCoat-v1"), "scene"
    with pytest.raises(ValueError, match=r"must see segmented clouds.*; got scene"):
        halo.make_method(env)
    env.cloud = "segmented"
    learned_approach = HALO(halo.policy, {**halo.card, "training": {"with_approach": True}})
    with pytest.raises(ValueError, match="must be trained with --gam"):
        learned_approach.make_method(env)
    method = halo.make_method(env)
    assert [p.chunks for p in method.actor.policies.values()] == [10]


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_policies_that_come_with_the_package_fit_their_tasks(path: Path):
    halo = HALO.load(f"{path.stem}-v1")
    assert halo.card["tasks"] == [f"{path.stem}-v1"]
    assert len(halo.card["longest"]) == len(load_demonstration(f"{path.stem}-v1").learned_stages)
    assert halo.policy.config.stages == len(halo.card["longest"])
    assert re.match(r"\d+ of (50|100) episodes at the first try", halo.card["measured"])
    assert path.with_suffix(".md").is_file()


def test_the_policies_together_take_less_than_20_megabytes():
    assert sum(path.stat().st_size for path in SHIPPED) < 20e6
