"""Damaged and invented files: read right, or refused by the reader's own error."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors import safe_open
from safetensors.numpy import save_file

from dgl_files.tensors import seal
from dgl_gam import Calibration, DataError, GamCheckpointError
from dgl_gam.card import format_card
from dgl_gam.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from dgl_gam.config import GamLevelConfig, NetworkConfig, YawConfig
from dgl_gam.data import read_garment, read_header, write_garment
from dgl_gam.network import GarmentNetwork

FEW = settings(
    max_examples=30,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
MANY = settings(FEW, max_examples=150)

CONFIG = NetworkConfig(
    levels=(
        GamLevelConfig(centres=16, radius=0.3, neighbours=4, widths=(8,)),
        GamLevelConfig(centres=8, radius=0.6, neighbours=4, widths=(8,)),
    ),
    up=((8,), (8,)),
    attention_blocks=1,
    attention_heads=2,
    head_width=8,
    features=8,
    categories=("Shirt", "Gown"),
    yaw=YawConfig(bins=8, rings=4, width=8),
)
CARD = {"steps_done": 3, "train": {"seed": 0, "parts": "all"}, "states": ["flat"]}


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


@st.composite
def changed_values(draw: st.DrawFn, values: dict) -> dict:
    """Plain values with one of them, somewhere inside, replaced by another."""
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


@pytest.fixture(scope="module")
def checkpoint() -> Checkpoint:
    torch.manual_seed(0)
    return Checkpoint(network=GarmentNetwork(CONFIG).eval(), card=CARD)


@pytest.fixture(scope="module")
def whole(checkpoint, tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "network.safetensors"
    save_checkpoint(path, checkpoint)
    return path.read_bytes()


def check_network_file(path: Path, content: bytes, checkpoint: Checkpoint) -> None:
    path.unlink(missing_ok=True)
    path.write_bytes(content)
    try:
        found = load_checkpoint(path)
    except GamCheckpointError as error:
        check_told(error, path)
        return
    assert found.network.config == checkpoint.network.config
    assert found.calibration == checkpoint.calibration
    assert found.card == checkpoint.card
    state = checkpoint.network.state_dict()
    assert all(torch.equal(t, state[name]) for name, t in found.network.state_dict().items())


@FEW
@given(changes=damages())
def test_a_damaged_network_is_refused_or_read_as_it_was(tmp_path, whole, checkpoint, changes):
    check_network_file(tmp_path / "network.safetensors", damage(whole, changes), checkpoint)


@pytest.mark.slow
@MANY
@given(changes=damages())
def test_many_damaged_networks(tmp_path, whole, checkpoint, changes):
    check_network_file(tmp_path / "network.safetensors", damage(whole, changes), checkpoint)


@FEW
@given(header=st.binary(max_size=60) | JSON.map(lambda v: json.dumps(v).encode()), data=st.binary())
def test_arbitrary_bytes_are_neither_network_nor_garment(tmp_path, header, data):
    path = tmp_path / "a.safetensors"
    for content in (data, len(header).to_bytes(8, "little") + header + data):
        path.write_bytes(content)
        with pytest.raises(GamCheckpointError, match=r"a\.safetensors"):
            load_checkpoint(path)
        for read in (read_header, read_garment):
            with pytest.raises(DataError, match=r"a\.safetensors"):
                read(path)


@settings(FEW, max_examples=50)
@given(values=changed_values(json.loads(CONFIG.to_json())))
def test_a_configuration_of_any_values_is_refused_or_builds_a_network(values):
    try:
        config = NetworkConfig.from_json(json.dumps(values))
    except ValueError as error:
        check_told(error)
        return
    with torch.device("meta"):
        GarmentNetwork(config)
    assert NetworkConfig.from_json(config.to_json()) == config


@settings(FEW, max_examples=30)
@given(
    values=changed_values(json.loads(Calibration().to_json())),
    card=changed_values({**CARD, "earlier": [CARD], "versions": {"torch": "2"}}),
)
def test_calibration_and_card_of_any_values_are_refused_or_usable(
    tmp_path, checkpoint, values, card
):
    path = tmp_path / "network.safetensors"
    arrays = {name: t.numpy() for name, t in checkpoint.network.state_dict().items()}
    metadata = {
        "format": "dgl_gam.network",
        "version": "2",
        "network": CONFIG.to_json(),
        "calibration": json.dumps(values),
        "card": json.dumps(card),
    }
    save_file(arrays, path, metadata=seal(metadata, arrays))
    try:
        found = load_checkpoint(path)
    except GamCheckpointError as error:
        check_told(error)
        return
    probability = found.calibration.apply(np.zeros((1, 4)))
    assert 0 <= probability[0] <= 1
    assert "categories | Shirt, Gown" in format_card("a", found, [])


@pytest.fixture(scope="module")
def garment(shirt_fields, tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("garment") / "shirt.safetensors"
    write_garment(path, **shirt_fields(1, views_per_state=1))
    return path.read_bytes()


def check_garment_file(path: Path, content: bytes, fields: dict) -> None:
    path.unlink(missing_ok=True)
    path.write_bytes(content)
    try:
        found = read_garment(path)
    except DataError as error:
        check_told(error, path)
        return
    for name in ("canonical", "faces", "landmarks", "view_points", "view_vertices", "view_state"):
        np.testing.assert_array_equal(getattr(found, name), fields[name])
    np.testing.assert_array_equal(found.states, fields["states"].astype(np.float32))
    for name in ("category", "garment_id", "split", "seed"):
        assert getattr(found.header, name) == fields[name]
    assert found.header.state_names == tuple(fields["state_names"])


@FEW
@given(changes=damages())
def test_damaged_data_are_refused_or_read_as_they_were(tmp_path, garment, shirt_fields, changes):
    fields = shirt_fields(1, views_per_state=1)
    check_garment_file(tmp_path / "shirt.safetensors", damage(garment, changes), fields)


@pytest.mark.slow
@MANY
@given(changes=damages())
def test_many_damaged_data(tmp_path, garment, shirt_fields, changes):
    fields = shirt_fields(1, views_per_state=1)
    check_garment_file(tmp_path / "shirt.safetensors", damage(garment, changes), fields)


@settings(FEW, max_examples=30)
@given(data=st.data())
def test_metadata_of_any_values_are_refused_or_of_the_right_types(tmp_path, garment, data):
    path = tmp_path / "shirt.safetensors"
    path.unlink(missing_ok=True)
    path.write_bytes(garment)
    with safe_open(path, framework="np") as file:
        metadata = file.metadata()
        arrays = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    name = data.draw(st.sampled_from(sorted(metadata)))
    try:
        values = json.loads(metadata[name])
    except ValueError:
        values = None
    if isinstance(values, (dict, list)):
        metadata[name] = json.dumps(data.draw(changed_values({"it": values}))["it"])
    else:
        metadata[name] = data.draw(st.text(max_size=30))
    save_file(arrays, path, metadata=seal(metadata, arrays))
    try:
        header = read_header(path)
    except DataError as error:
        check_told(error)
        return
    assert all(isinstance(each, str) for each in (*header.state_names, *header.landmark_names))
    assert all(np.isfinite(direction).all() for direction in header.view_directions)
    assert "/" not in header.category
