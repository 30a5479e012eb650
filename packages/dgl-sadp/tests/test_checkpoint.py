import dataclasses
import json

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from dgl_sadp import CheckpointError, DiffusionPolicy, load_policy, read_card, save_policy
from dgl_sadp.normalizer import Range


@pytest.fixture
def policy(tiny_config):
    policy = DiffusionPolicy.make(tiny_config("sadp"), seed=0)
    policy.normalizer.of("action").fit(Range(np.full(60, -1.5), np.full(60, 2.0)))
    return policy


@pytest.fixture
def path(tmp_path, policy):
    save_policy(tmp_path / "new" / "policy.safetensors", policy, {"stage": 2})
    return tmp_path / "new" / "policy.safetensors"


def rewrite(path, *, tensors=None, **metadata):
    with safe_open(path, framework="pt") as file:
        before = file.metadata()
    save_file(load_file(path) if tensors is None else tensors, path, {**before, **metadata})


def test_a_policy_is_read_as_it_was_written(path, policy, random_batch):
    found = load_policy(path)
    assert found.config == policy.config
    assert not found.training
    state = policy.state_dict()
    assert set(found.state_dict()) == set(state)
    assert all(torch.equal(tensor, state[name]) for name, tensor in found.state_dict().items())
    batch, chunks = random_batch(policy.config), []
    for each in (policy, found):
        generator = torch.Generator().manual_seed(0)
        chunks.append(each.predict(batch, each.encode_stage(batch, generator), generator))
    assert torch.equal(*chunks)
    assert read_card(path) == {"stage": 2}


def test_nothing_is_left_beside_the_file(path):
    assert [each.name for each in path.parent.iterdir()] == ["policy.safetensors"]


def test_a_failed_write_leaves_the_former_file(path, policy, monkeypatch):
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr("dgl_sadp._tensor_file.save_file", fail)
    with pytest.raises(OSError, match="disk full"):
        save_policy(path, policy)
    assert path.read_bytes() == before
    assert len(list(path.parent.iterdir())) == 1


@pytest.mark.parametrize("share", [0.0, 0.001, 0.5, 0.999])
def test_truncated_files_are_refused(path, share):
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(CheckpointError, match=r"policy\.safetensors cannot be read"):
        load_policy(path)


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_flipped_bit_is_found(path, share):
    content = bytearray(path.read_bytes())
    header = 8 + int.from_bytes(content[:8], "little")
    content[header + int(share * (len(content) - header))] ^= 0x10
    path.write_bytes(content)
    with pytest.raises(CheckpointError, match=r"policy\.safetensors is damaged: its checksum"):
        load_policy(path)


def test_foreign_files_are_refused(tmp_path, path):
    with pytest.raises(CheckpointError, match=r"none\.safetensors cannot be read"):
        load_policy(tmp_path / "none.safetensors")
    text = tmp_path / "text.safetensors"
    text.write_text("a policy")
    with pytest.raises(CheckpointError, match=r"text\.safetensors cannot be read"):
        load_policy(text)
    other = tmp_path / "other.safetensors"
    save_file({"weight": torch.zeros(2)}, other)
    with pytest.raises(CheckpointError, match=r"its format must be 'dgl_sadp\.policy'; got None"):
        load_policy(other)


def test_other_versions_and_wrong_metadata_are_refused(path):
    rewrite(path, version="2")
    with pytest.raises(CheckpointError, match="version must be '1'; got '2'"):
        load_policy(path)
    for values in ("{", "[1]"):
        rewrite(path, version="1", values=values)
        with pytest.raises(CheckpointError, match="its metadata are damaged"):
            read_card(path)


def test_a_configuration_with_unknown_fields_is_refused(path, policy):
    values = {"policy": {**dataclasses.asdict(policy.config), "crop": 3}, "card": {}}
    rewrite(path, values=json.dumps(values))
    with pytest.raises(CheckpointError, match=r"its configuration is wrong.*crop"):
        load_policy(path)


def test_weights_of_another_configuration_are_refused(path, policy):
    other = dataclasses.replace(policy.config, state=(16, 16))
    rewrite(path, values=json.dumps({"policy": dataclasses.asdict(other), "card": {}}))
    with pytest.raises(CheckpointError, match="its tensors do not fit its configuration: "):
        load_policy(path)


def test_weights_that_are_not_finite_are_refused(path, policy):
    with torch.no_grad():
        next(policy.unet.parameters())[0] = float("nan")
    save_policy(path, policy)
    with pytest.raises(CheckpointError, match=r"must be finite; not so: unet"):
        load_policy(path)


def test_another_ending_is_refused(tmp_path, policy):
    with pytest.raises(ValueError, match=r"must end in \.safetensors; got .*policy\.pt"):
        save_policy(tmp_path / "policy.pt", policy)
