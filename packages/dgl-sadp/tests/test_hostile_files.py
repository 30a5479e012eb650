"""Damaged and invented files: read right, or refused by the reader's own error."""

import dataclasses
import io
import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import load_file, save_file

from dgl_files.fields import decode_json, from_plain
from dgl_files.tensors import seal
from dgl_sadp import (
    CheckpointError,
    DamagedEpisodeError,
    DiffusionPolicy,
    EpisodeDataset,
    PolicyConfig,
    load_policy,
    read_card,
    save_policy,
)
from dgl_sadp.card import format_card
from dgl_sadp.ranges import measure_episodes

FEW = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
MANY = settings(FEW, max_examples=200)
SHOWN = ("tasks", "longest", "windows", "training", "validation", "measured", "license")


def check_told(error: Exception, path: Path | None = None) -> None:
    """An error says something, in one line, and names the file."""
    assert len(str(error).splitlines()) == 1
    assert path is None or str(path) in str(error)


@st.composite
def damages(draw: st.DrawFn) -> list[tuple[str, float, int, int]]:
    """Draw changes of a file: kind, place, size and byte."""
    kinds = st.sampled_from(("flip", "set", "cut", "insert", "delete", "repeat"))
    place = st.floats(0, 1, exclude_max=True)
    one = st.tuples(kinds, st.booleans(), place, st.integers(1, 64), st.integers(0, 255))
    return [
        (kind, where**4 if is_early else where, size, byte)
        for kind, is_early, where, size, byte in draw(st.lists(one, min_size=1, max_size=3))
    ]


def damage(whole: bytes, changes: list[tuple[str, float, int, int]]) -> bytes:
    content = bytearray(whole)
    for kind, where, size, byte in changes:
        at = int(where * max(1, len(content)))
        part = content[at : at + size]
        if kind == "flip" and part:
            content[at] ^= 1 << byte % 8
        elif kind == "set":
            content[at : at + size] = bytes([byte]) * len(part)
        elif kind == "cut":
            del content[at:]
        elif kind == "insert":
            content[at:at] = bytes([byte]) * size
        elif kind == "delete":
            del content[at : at + size]
        elif kind == "repeat":
            content[at:at] = part
    return bytes(content)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)


@pytest.fixture(scope="module")
def policy(tiny_config) -> DiffusionPolicy:
    return DiffusionPolicy.make(tiny_config("sadp"), seed=0)


@pytest.fixture(scope="module")
def whole(policy, tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "policy.safetensors"
    save_policy(path, policy, {"stage": 1, "tasks": ["FoldTops-v1"], "longest": 40})
    return path.read_bytes()


def check_policy_file(path: Path, content: bytes, policy: DiffusionPolicy) -> None:
    path.unlink(missing_ok=True)
    path.write_bytes(content)
    try:
        found, card = load_policy(path), read_card(path)
    except CheckpointError as error:
        check_told(error, path)
        return
    assert found.config == policy.config
    assert card == {"stage": 1, "tasks": ["FoldTops-v1"], "longest": 40}
    state = policy.state_dict()
    assert all(torch.equal(tensor, state[name]) for name, tensor in found.state_dict().items())


@FEW
@given(changes=damages())
def test_a_damaged_policy_is_refused_or_read_as_it_was(tmp_path, whole, policy, changes):
    check_policy_file(tmp_path / "policy.safetensors", damage(whole, changes), policy)


@pytest.mark.slow
@MANY
@given(changes=damages())
def test_many_damaged_policies(tmp_path, whole, policy, changes):
    check_policy_file(tmp_path / "policy.safetensors", damage(whole, changes), policy)


@FEW
@given(header=st.binary(max_size=60) | JSON.map(lambda v: json.dumps(v).encode()), data=st.binary())
def test_arbitrary_bytes_are_no_policy(tmp_path, header, data):
    path = tmp_path / "policy.safetensors"
    for content in (data, len(header).to_bytes(8, "little") + header + data):
        path.write_bytes(content)
        for read in (load_policy, read_card):
            with pytest.raises(CheckpointError, match=r"policy\.safetensors"):
                read(path)


@st.composite
def changed_values(draw: st.DrawFn, values: dict) -> dict:
    """A configuration with one value, somewhere in it, replaced by another."""
    values = json.loads(json.dumps(values))
    node, path = values, draw(st.lists(st.integers(0, 100), min_size=1, max_size=4))
    for number, step in enumerate(path):
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = keys[step % len(keys)]
        if number == len(path) - 1 or not isinstance(node[key], (dict, list)) or not node[key]:
            near = st.sampled_from((-8, -1, 0, 1, 2, 3, 8, 64, 8192, 2**31, 10**18, 0.5, "8"))
            node[key] = draw(near | JSON)
            break
        node = node[key]
    return values


@settings(FEW, max_examples=60)
@given(data=st.data())
def test_a_configuration_of_any_values_is_refused_or_builds_a_policy(policy, data):
    values = data.draw(changed_values(dataclasses.asdict(policy.config)))
    try:
        config = from_plain(PolicyConfig, values)
    except ValueError as error:
        check_told(error)
        return
    with torch.device("meta"):
        DiffusionPolicy(config)
    assert PolicyConfig.from_json(config.to_json()) == config


@FEW
@given(card=JSON, values=st.dictionaries(st.sampled_from(SHOWN), JSON))
def test_a_card_of_any_values_is_refused_or_can_be_shown(tmp_path, policy, whole, card, values):
    path = tmp_path / "policy.safetensors"
    path.unlink(missing_ok=True)
    path.write_bytes(whole)
    with safe_open(path, framework="np") as file:
        metadata = file.metadata()
    before = json.loads(metadata["values"])
    for new in (card, values):
        text = json.dumps({**before, "card": new})
        arrays = load_file(path)
        save_file(arrays, path, seal({**metadata, "values": text}, arrays))
        try:
            found = read_card(path)
        except CheckpointError:
            continue
        assert found == new
        assert all(isinstance(frames, int) for frames in found.get("longest", []))
        assert all(isinstance(task, str) for task in found.get("tasks", []))
        assert format_card(policy, found).startswith("---\nlicense: ")


@FEW
@given(value=JSON, text=st.text())
def test_json_is_decoded_or_refused(value, text):
    for each in (json.dumps(value), text):
        try:
            found = decode_json(each)
        except ValueError as error:
            check_told(error)
        else:
            assert found == json.loads(each)


def write_recorded(file: h5py.File) -> None:
    """Write an episode as it is recorded: compressed, and with a checksum of every chunk."""
    rng = np.random.default_rng(0)
    file.attrs.update({"format_version": 1, "task": "FoldTops-v1", "success": np.bool_(True)})
    group = file.create_group("stage_1")
    group.attrs["approach_frames"] = 1
    frames = 5
    for key, shape in {
        "joint_state": (frames, 60),
        "action": (frames, 60),
        "ee_pose": (frames, 2, 7),
        "env_point_cloud": (frames, 8, 6),
        "image": (frames, 4, 6, 3),
        "garment_point_cloud": (8, 3),
        "points_affordance_feature": (8, 2),
    }.items():
        values = rng.uniform(size=shape).astype(np.float32)
        values = (255 * values).astype(np.uint8) if key == "image" else values
        group.create_dataset(
            key, data=values, chunks=shape, compression="gzip", shuffle=True, fletcher32=True
        )


def make_episode(libver: str) -> bytes:
    content = io.BytesIO()
    with h5py.File(content, "w", libver=(libver, "v110")) as file:
        write_recorded(file)
    return content.getvalue()


EPISODES = {libver: make_episode(libver) for libver in ("v110", "earliest")}


def read_all(folder: Path) -> list[dict[str, np.ndarray]]:
    keys = ("joint_state", "ee_pose", "env_point_cloud", "image")
    dataset = EpisodeDataset(folder, observation_keys=keys, keep_bytes=10_000)
    measured = measure_episodes(dataset, ("action", "joint_state", "garment_point_cloud"))
    assert not measured.refused
    return list(measured.dataset)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> list[dict[str, np.ndarray]]:
    folder = tmp_path_factory.mktemp("recorded")
    (folder / "0.h5").write_bytes(EPISODES["v110"])
    return read_all(folder)


def check_episode_file(
    folder: Path, content: bytes, wanted: list[dict[str, np.ndarray]] | None
) -> None:
    """Read whatever is there; without `wanted` its values may be any, of the right shapes."""
    path = folder / "0.h5"
    path.unlink(missing_ok=True)
    path.write_bytes(content)
    keys = ("joint_state", "ee_pose", "env_point_cloud", "image")
    try:
        dataset = EpisodeDataset(folder, observation_keys=keys)
        windows = list(dataset)
    except DamagedEpisodeError as error:
        check_told(error, path)
        return
    except ValueError as error:  # It says that it did not succeed, or has other stages.
        check_told(error)
        is_changed = "succeeded" not in str(error)
        if is_changed and wanted is not None:
            raise
        return
    assert wanted is None or len(windows) == len(wanted)
    for number, window in enumerate(windows):
        assert window["action"].shape == (8, 60)
        for key, values in window.items():
            if wanted is not None:
                np.testing.assert_array_equal(values, wanted[number][key])


@FEW
@given(changes=damages())
def test_a_damaged_episode_is_refused_or_read_as_it_was(tmp_path, recorded, changes):
    check_episode_file(tmp_path, damage(EPISODES["v110"], changes), recorded)


@FEW
@given(changes=damages())
def test_a_damaged_episode_of_the_old_layout_raises_nothing_else(tmp_path, changes):
    """Its metadata have no checksums: what they say may have changed."""
    check_episode_file(tmp_path, damage(EPISODES["earliest"], changes), None)


@pytest.mark.slow
@MANY
@given(changes=damages(), libver=st.sampled_from(sorted(EPISODES)))
def test_many_damaged_episodes(tmp_path, recorded, changes, libver):
    wanted = recorded if libver == "v110" else None
    check_episode_file(tmp_path, damage(EPISODES[libver], changes), wanted)


@FEW
@given(content=st.binary(max_size=200), is_signed=st.booleans())
def test_arbitrary_bytes_are_no_episode(tmp_path, content, is_signed):
    path = tmp_path / "0.h5"
    path.unlink(missing_ok=True)
    path.write_bytes((b"\x89HDF\r\n\x1a\n" if is_signed else b"") + content)
    with pytest.raises(DamagedEpisodeError, match=r"0\.h5"):
        EpisodeDataset(tmp_path)


ATTRIBUTES = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats()
    | st.text(st.characters(codec="ascii", min_codepoint=1), max_size=300)
    | st.binary(min_size=1, max_size=5).map(np.void)
    | st.lists(st.integers(0, 5), max_size=3).map(lambda v: np.array(v, np.int32))
    | st.just(h5py.Empty("f4"))
)


@FEW
@given(
    name=st.sampled_from(("format_version", "success", "robot", "task", "approach_frames")),
    value=ATTRIBUTES,
)
def test_attributes_of_any_type_are_refused_or_right(tmp_path, name, value):
    path = tmp_path / "0.h5"
    path.unlink(missing_ok=True)
    path.write_bytes(EPISODES["v110"])
    with h5py.File(path, "a") as file:
        (file["stage_1"] if name == "approach_frames" else file).attrs[name] = value
    try:
        dataset = EpisodeDataset(tmp_path)
    except DamagedEpisodeError as error:
        check_told(error, path)
        return
    except ValueError as error:
        check_told(error)
        is_read_right = name == "success" and value is False
        if not is_read_right:
            raise
        return
    assert (
        type(value)
        is {
            "format_version": int,
            "success": bool,
            "robot": str,
            "task": str,
            "approach_frames": int,
        }[name]
    )
    (episode,) = dataset.episodes
    assert name != "task" or episode.task == value
