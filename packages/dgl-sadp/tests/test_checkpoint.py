import dataclasses
import json
import zlib

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file

from dgl_files.tensors import seal
from dgl_sadp import CheckpointError, DiffusionPolicy, load_policy, read_card, save_policy
from dgl_sadp.normalizer import Range


@pytest.fixture
def policy(tiny_config):
    policy = DiffusionPolicy.make(tiny_config("sadp"), seed=0)
    policy.normalizer.of("action").fit(Range(np.full(60, -1.5), np.full(60, 2.0)))
    return policy


@pytest.fixture
def path(tmp_path, policy):
    save_policy(tmp_path / "new" / "policy.safetensors", policy, {"note": 2})
    return tmp_path / "new" / "policy.safetensors"


def rewrite(path, *, tensors=None, **metadata):
    """Write the file again with checksums that fit, as another program might."""
    with safe_open(path, framework="pt") as file:
        after = {**file.metadata(), **metadata}
    tensors = load_file(path) if tensors is None else tensors
    plain = {n: t.numpy() for n, t in tensors.items() if t.dtype != torch.float8_e4m3fn}
    save_file(tensors, path, seal(after, plain))


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
    assert read_card(path) == {"note": 2}


def test_nothing_is_left_beside_the_file(path):
    assert [each.name for each in path.parent.iterdir()] == ["policy.safetensors"]


def test_a_failed_write_leaves_the_former_file(path, policy, monkeypatch):
    before = path.read_bytes()

    def fail(*_, **__):
        raise OSError("disk full")

    monkeypatch.setattr("dgl_files.tensors.save_file", fail)
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
    rewrite(path, version="4")
    with pytest.raises(CheckpointError, match="version must be '3'; got '4'"):
        load_policy(path)
    for values in ("{", "[1]"):
        rewrite(path, version="3", values=values)
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


def test_a_card_beyond_the_bounds_is_refused_before_memory_is_taken(path, policy):
    for change, message in (
        ({"joints": 10**9}, r"joints should be less than or equal to 1024; got 1000000000"),
        ({"joints": True}, "joints should be a valid integer; got True"),
        ({"joints": 60.0}, r"joints should be a valid integer; got 60\.0"),
        ({"horizon": 2**40}, r"horizon should be less than or equal to 1024"),
        ({"unet": {"groups": -8}}, r"groups should be greater than or equal to 1; got -8"),
        ({"unet": {"groups": 0}}, r"groups should be greater than or equal to 1; got 0"),
        ({"unet": {"widths": [800] * 3}}, "do not fit its configuration"),
        ({"unet": {"widths": [8000] * 3}}, "at most 536870912 weights; got"),
        ({"unet": {"widths": [10**9]}}, r"widths\[0\] should be less than or equal to 8192"),
        ({"unet": {"widths": "ab"}}, r"unet\.widths should be a valid array; got 'ab'"),
        ({"unet": 5}, "unet should be an object; got 5"),
        (
            {"diffusion": {"training_steps": 10**9}},
            r"training_steps should be less than or equal to 10000",
        ),
        ({"diffusion": {"beta_end": 1e-9}}, "beta_start must be positive and at most beta_end"),
        ({"environment": {"points": 10**9}}, r"points should be less than or equal to 65536"),
        ({"environment": {"points": 65536, "widths": [8192]}}, "points x the widest layer must"),
        ({"state": [[1]]}, r"state\[0\] should be a valid integer; got \[1\]"),
    ):
        values = dataclasses.asdict(policy.config)
        for key, value in change.items():
            values[key] = {**values[key], **value} if isinstance(value, dict) else value
        rewrite(path, values=json.dumps({"policy": values, "card": {}}))
        with pytest.raises(CheckpointError, match=message) as caught:
            load_policy(path)
        assert str(caught.value).startswith(str(path))
        assert "\n" not in str(caught.value)


def test_numbers_and_nesting_of_any_size_are_refused_in_one_line(path, policy):
    for text, message in (
        ("9" * 400, "joints should be less than or equal to 1024; got a whole number of 1329 bits"),
        ("1e999", "a number must be finite"),
        ("NaN", "a number must be finite"),
        ("[" * 100_000 + "]" * 100_000, "recursion limit exceeded"),
        ('{"a":' * 40 + "1" + "}" * 40, "joints should be a valid integer; got {'a'"),
        ("true", "joints should be a valid integer; got True"),
        ('1, "a\\nb": 1e999', "a number must be finite"),
    ):
        values = json.dumps({"policy": dataclasses.asdict(policy.config), "card": {}})
        rewrite(path, values=values.replace('"joints": 60', f'"joints": {text}'))
        with pytest.raises(CheckpointError, match=message):
            load_policy(path)


def test_a_card_of_wrong_types_is_refused(path, policy):
    for card, message in (
        ({"tasks": "FoldTops-v1"}, r"card\.tasks should be a valid list"),
        ({"tasks": []}, "should have at least 1 item"),
        ({"measured": 48}, r"card\.measured should be a valid string; got 48"),
        ({"license": ["mit"]}, r"card\.license should be a valid string"),
        ({"tasks": [1]}, r"card\.tasks\[0\] should be a valid string; got 1"),
        ({"longest": 12}, r"card\.longest should be a valid list; got 12"),
        ({"longest": []}, "should have at least 1 item"),
        ({"longest": [10**9]}, r"card\.longest\[0\] should be less than or equal to 1000000"),
        ({"training": []}, r"card\.training should be a valid dictionary"),
        (
            {"training": {"with_approach": "no"}},
            "with_approach should be a valid boolean; got 'no'",
        ),
    ):
        save_policy(path, policy, card)
        for read in (read_card, load_policy):
            with pytest.raises(CheckpointError, match=message):
                read(path)


def test_a_card_of_numbers_that_are_not_finite_is_not_written(tmp_path, policy):
    with pytest.raises(ValueError, match="not JSON compliant"):
        save_policy(tmp_path / "policy.safetensors", policy, {"loss": float("nan")})


@pytest.mark.parametrize("dtype", [torch.int64, torch.float64, torch.float8_e4m3fn, torch.bool])
def test_weights_of_other_types_are_refused(path, dtype):
    tensors = load_file(path)
    name = next(iter(tensors))
    rewrite(path, tensors={**tensors, name: torch.zeros(tensors[name].shape).to(dtype)})
    with pytest.raises(CheckpointError, match=f"{name} must be of type F16 or F32; got"):
        load_policy(path)


def test_a_changed_configuration_is_found_by_its_checksum(path):
    content = path.read_bytes()
    assert content.count(b"beta_end") == 1
    where = content.index(b"0.02", content.index(b"beta_end"))
    path.write_bytes(content[:where] + b"0.03" + content[where + 4 :])
    for read in (read_card, load_policy):
        with pytest.raises(CheckpointError, match="metadata are damaged: their checksum"):
            read(path)


def test_files_of_earlier_versions_are_read_and_checked(path, policy):
    """Their checksum names types as torch does; version 2 has a checksum of the plain values."""
    tensors = load_file(path)
    with safe_open(path, framework="pt") as file:
        values = file.metadata()["values"]
    checksum = 0
    for name, tensor in sorted(tensors.items()):
        head = f"{name} {tensor.dtype} {tuple(tensor.shape)}"
        checksum = zlib.crc32(head.encode(), checksum)
        checksum = zlib.crc32(tensor.numpy().tobytes(), checksum)
    old = {
        "format": "dgl_sadp.policy",
        "version": "2",
        "checksum": f"{checksum:08x}",
        "values": values,
        "values_checksum": f"{zlib.crc32(values.encode()):08x}",
    }
    without = {name: text for name, text in old.items() if name != "values_checksum"}
    for metadata in (old, {**without, "version": "1"}):
        save_file(tensors, path, metadata)
        found = load_policy(path)
        assert found.config == policy.config
        assert all(torch.equal(t, tensors[name]) for name, t in found.state_dict().items())
        save_file(tensors, path, {**metadata, "checksum": "00000000"})
        with pytest.raises(CheckpointError, match="is damaged: its checksum"):
            load_policy(path)
    save_file(tensors, path, {**old, "values": values.replace("0.02", "0.03")})
    with pytest.raises(CheckpointError, match="metadata are damaged: their checksum"):
        load_policy(path)


def test_what_is_no_file_is_refused(tmp_path):
    import os

    pipe, link = tmp_path / "pipe.safetensors", tmp_path / "link.safetensors"
    os.mkfifo(pipe)
    link.symlink_to(link)
    refused = {pipe: "it is no file", link: "cannot be read", tmp_path: "No such file"}
    for path, message in refused.items():
        with pytest.raises(CheckpointError, match=message):
            load_policy(path)


def test_weights_are_written_in_16_bits_where_that_is_asked_for(tmp_path, policy):
    path = tmp_path / "half.safetensors"
    save_policy(path, policy, is_half=True)
    kept, found = load_file(path), load_policy(path).state_dict()
    learned = dict(policy.named_parameters())
    for name, tensor in policy.state_dict().items():
        assert kept[name].dtype == (torch.float16 if name in learned else torch.float32)
        assert found[name].dtype == torch.float32
        assert torch.equal(found[name], tensor.half().float() if name in learned else tensor)
    with torch.no_grad():
        next(policy.parameters()).view(-1)[0] = 1e5
    with pytest.raises(ValueError, match="must lie within the range of float16"):
        save_policy(path, policy, is_half=True)
