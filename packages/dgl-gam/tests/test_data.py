import json

import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from dgl_files.tensors import seal
from dgl_gam import DataError
from dgl_gam.data import GarmentFolder, read_garment, read_header, write_garment


@pytest.fixture
def garment_path(tmp_path, shirt_fields):
    path = tmp_path / "deep" / "shirt.safetensors"
    write_garment(path, **shirt_fields(1))
    return path


def rewrite(path, *, arrays=(), metadata=(), without=()):
    """Write a file anew with something changed in it, as another program might."""
    from safetensors import safe_open

    with safe_open(path, framework="np") as file:
        old = dict(file.metadata())
    new = {**load_file(path), **dict(arrays)}
    new = {name: array for name, array in new.items() if name not in without}
    old = {name: text for name, text in {**old, **dict(metadata)}.items() if name not in without}
    save_file(new, path, metadata=seal(old, new))


def test_what_is_written_is_read(garment_path, shirt_fields):
    fields = shirt_fields(1)
    data = read_garment(garment_path)
    for name in ("canonical", "faces", "landmarks", "view_points", "view_vertices", "view_state"):
        np.testing.assert_array_equal(getattr(data, name), fields[name])
    np.testing.assert_array_equal(data.states, fields["states"].astype(np.float32))
    header = data.header
    assert (header.category, header.garment_id, header.split) == ("Shirt", "Shirt/000001", "train")
    assert header.state_kinds == ("flat", "dropped", "dropped")
    assert header.landmark_names == tuple(fields["landmark_names"])
    assert len(header.view_directions) == len(fields["view_points"])
    assert data.has_canonical
    np.testing.assert_array_equal(data.get_views("dropped"), [2, 3, 4, 5])
    extent = np.ptp(fields["states"][0].astype(float), axis=0)
    assert data.diagonal == pytest.approx(np.hypot(extent[0], extent[1]), rel=1e-5)
    assert [p.name for p in garment_path.parent.iterdir()] == ["shirt.safetensors"]


def test_a_garment_without_canonical_coordinates_says_so(garment_path, shirt_fields):
    fields = shirt_fields(1)
    fields["canonical"] = np.full_like(fields["canonical"], np.nan)
    write_garment(garment_path, **fields)
    assert not read_garment(garment_path).has_canonical


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"view_vertices": lambda a: a + 10**6}, r"view_vertices must be in \[0, \d+\)"),
        ({"faces": lambda a: -a}, r"faces must be in \[0"),
        ({"view_state": lambda a: a + 7}, r"view_state must be in \[0, 3\)"),
        ({"view_points": lambda a: a * np.nan}, "view_points must be finite"),
        ({"states": lambda a: a[:, 1:]}, r"states must have shape \(S, V, 3\)"),
        ({"view_points": lambda a: a[:, :100]}, "with 2048 = 2048"),
        ({"landmark_names": lambda a: a[:-1]}, "landmark_names must be a list of 5"),
        ({"landmark_names": lambda a: [a[0]] * len(a)}, "must differ"),
        ({"state_names": lambda a: a[::-1]}, "first state must be 'flat'"),
        ({"split": lambda a: "validation"}, "split must be train or test"),
        ({"category": lambda a: ""}, "category must not be empty"),
    ],
)
def test_what_contradicts_itself_is_not_written(tmp_path, shirt_fields, change, message):
    fields = shirt_fields(1)
    for name, function in change.items():
        fields[name] = function(fields[name])
    with pytest.raises(DataError, match=message):
        write_garment(tmp_path / "shirt.safetensors", **fields)
    assert list(tmp_path.iterdir()) == []


def test_damaged_and_foreign_files_are_refused_by_name(garment_path, tmp_path):
    whole = garment_path.read_bytes()
    for content in (whole[: len(whole) // 2], whole[:4], b"", b"{}" * 500):
        garment_path.write_bytes(content)
        with pytest.raises(DataError, match=r"shirt\.safetensors"):
            read_garment(garment_path)
    garment_path.write_bytes(whole)
    rewrite(garment_path, without=("faces",))
    with pytest.raises(DataError, match="lacks the array faces"):
        read_header(garment_path)
    garment_path.write_bytes(whole)
    rewrite(garment_path, metadata={"format_version": "99"})
    with pytest.raises(DataError, match="format version must be '2'; got '99'"):
        read_header(garment_path)
    garment_path.write_bytes(whole)
    rewrite(garment_path, without=("seed",))
    with pytest.raises(DataError, match="metadata lack seed"):
        read_header(garment_path)
    garment_path.write_bytes(whole)
    rewrite(garment_path, metadata={"view_directions": json.dumps([[0, 0, 1]])})
    with pytest.raises(DataError, match="view_directions must be a list of 6"):
        read_header(garment_path)
    with pytest.raises(DataError, match=r"none\.safetensors"):
        read_header(tmp_path / "none.safetensors")


def test_a_folder_chooses_by_category_and_split(shirts):
    folder = GarmentFolder(shirts)
    assert len(folder) == 12
    assert folder.categories == ("Shirt",)
    assert len(GarmentFolder(shirts, split="test")) == 3
    assert folder.get_indices("Shirt") == tuple(range(12))
    with pytest.raises(DataError, match=r"no garments of Hat; it has \['Shirt'\]"):
        GarmentFolder(shirts, categories=["Hat"])
    with pytest.raises(DataError, match="no folder"):
        GarmentFolder(shirts / "none")


def test_two_garments_of_one_id_are_refused(tmp_path, shirt_fields):
    for name in ("a", "b"):
        write_garment(tmp_path / f"{name}.safetensors", **shirt_fields(1))
    with pytest.raises(DataError, match="two garments Shirt Shirt/000001"):
        GarmentFolder(tmp_path)


def test_memory_is_bounded_and_the_last_used_is_kept(shirts):
    folder = GarmentFolder(shirts, cache_bytes=600_000)
    size = folder.load(0).nbytes
    assert 150_000 < size < 300_000
    for index in range(12):
        folder.load(index)
        assert folder.held_bytes <= 600_000
    assert folder.load(11) is folder.load(11)
    kept = folder.load(11)
    folder.load(5)
    assert folder.load(11) is kept


def test_flipped_bits_are_found(garment_path):
    whole = garment_path.read_bytes()
    header = 8 + int.from_bytes(whole[:8], "little")
    for share in (0.01, 0.5, 0.99):
        content = bytearray(whole)
        content[header + int(share * (len(content) - header))] ^= 1
        garment_path.write_bytes(content)
        with pytest.raises(DataError, match=r"shirt\.safetensors is damaged: its checksum"):
            read_garment(garment_path)
    garment_path.write_bytes(whole.replace(b"Shirt/000001", b"Shirt/000002"))
    for read in (read_header, read_garment):
        with pytest.raises(DataError, match="metadata are damaged: their checksum"):
            read(garment_path)


def test_files_of_the_first_version_are_read(garment_path, shirt_fields):
    rewrite(garment_path, metadata={"format_version": "1"}, without=("checksum",))
    np.testing.assert_array_equal(read_garment(garment_path).faces, shirt_fields(1)["faces"])


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"seed": "9" * 5000}, "seed must be an integer; got"),
        ({"category": "../Shirt"}, r"a category must be letters.*got '\.\./Shirt'"),
        ({"garment_id": ""}, "garment_id must not be empty"),
        ({"state_names": '["flat", 1, 2]'}, r"state_names\[1\] should be a valid string; got 1"),
        ({"state_names": "[" * 100_000}, "state_names: recursion limit exceeded"),
        (
            {"view_directions": "[[0, 0], [1]]"},
            r"view_directions\[0\]: list should have at least 3 items",
        ),
        (
            {"view_directions": "[[0, 0, 1e999]]"},
            "view_directions: a number must be finite",
        ),
        (
            {"view_directions": f"[[0, 0, {'1' * 400}]]"},
            r"view_directions\[0\]\[2\] should be a valid number; got a whole number of 1326 bits",
        ),
        (
            {"generator_versions": '{"a": 1}'},
            r"generator_versions\.a should be a valid string; got 1",
        ),
    ],
)
def test_metadata_of_other_types_are_refused(garment_path, metadata, message):
    rewrite(garment_path, metadata=metadata)
    with pytest.raises(DataError, match=message) as caught:
        read_header(garment_path)
    assert str(caught.value).startswith(str(garment_path))


def test_more_than_fits_into_memory_is_refused_before_it_is_read(garment_path, monkeypatch):
    monkeypatch.setattr("dgl_gam.data.garment_file.MAX_BYTES", 1000)
    for read in (read_header, read_garment):
        with pytest.raises(DataError, match="arrays must have at most 1000 bytes; got"):
            read(garment_path)


def test_what_is_no_file_is_refused(tmp_path):
    import os

    pipe, link = tmp_path / "pipe.safetensors", tmp_path / "link.safetensors"
    os.mkfifo(pipe)
    link.symlink_to(link)
    for path, message in ((pipe, "it is no file"), (link, "cannot be read"), (tmp_path, "no file")):
        with pytest.raises(DataError, match=message):
            read_header(path)
