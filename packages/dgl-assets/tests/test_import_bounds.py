"""Hostile files are refused within seconds and megabytes."""

import base64
import contextlib
import importlib.util
import io
import json
import os
import struct
import time
import tracemalloc
import warnings
import zlib
from pathlib import Path

import pytest
import trimesh
from PIL import Image

from dgl_assets.importing import (
    AssetImportError,
    GarmentImportOptions,
    UnreadableFileError,
    import_garment,
    list_models,
    load_asset,
)
from dgl_assets.importing.archive import unpack
from dgl_assets.importing.bounds import MAX_LINES, MAX_PIXELS
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.textures import load_texture
from dgl_assets.robots.importing.meshes import load_geometry
from dgl_assets.robots.importing.raw import RawShape

_SPEC = importlib.util.spec_from_file_location("malformed", Path(__file__).parent / "malformed.py")
malformed = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(malformed)

SECONDS = 20  # on a busy machine; most take less than one
BLANKS = b"\n" * (MAX_LINES + 100)


@contextlib.contextmanager
def quick(megabytes=None):
    """A block that takes little time, and where it is said little memory."""
    if megabytes is not None:
        tracemalloc.start()
    start = time.monotonic()
    try:
        yield
        assert time.monotonic() - start < SECONDS
        if megabytes is not None:
            assert tracemalloc.get_traced_memory()[1] < megabytes * 2**20
    finally:
        tracemalloc.stop()


def tree_and_body():
    """A GLB's document and its bytes."""
    tree = malformed.to_gltf(*malformed.arrays())
    body = base64.b64decode(tree["buffers"][0].pop("uri").partition(",")[2])
    return tree, body


def to_glb(tree, body):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body += b"\0" * (-len(body) % 4)
    size = 12 + 8 + len(text) + 8 + len(body)
    head = b"glTF" + struct.pack("<II", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(body), b"BIN\0") + body


def grey_png(side):
    """A PNG of one grey, small on disk whatever its size."""

    def chunk(kind, data):
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    rows = zlib.compress(b"\0" * ((side + 1) * side), 9)
    head = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def refuse(path, data, words, **options):
    path.write_bytes(data)
    with quick(), pytest.raises(UnreadableFileError, match=words):
        read_mesh(path, **options)


@pytest.mark.parametrize("end", [b"\n", b"\r", b"vt 0 0\n"])
def test_text_of_too_many_lines_is_not_parsed(end, tmp_path):
    body = malformed.whole(tmp_path, "obj")
    refuse(tmp_path / "a.obj", body + end * (MAX_LINES + 100), "lines; at most")
    if end == b"\n":
        for name in ("ascii.ply", "ascii.stl"):
            path = tmp_path / f"a{name[-4:]}"
            refuse(path, malformed.whole(tmp_path, name) + BLANKS, "lines; at most")


def test_an_endless_line_is_not_split(tmp_path):
    body = malformed.whole(tmp_path, "obj")
    refuse(tmp_path / "a.obj", body + b"f" + b" 1" * 2_000_100, "faces; at most")
    refuse(tmp_path / "b.obj", body + b"f 1 2 3 \\\n" * 400_000, "line")


def test_blank_lines_of_a_text_stl_take_time_in_proportion(tmp_path):
    body = malformed.whole(tmp_path, "ascii.stl")
    path = tmp_path / "a.stl"
    path.write_bytes(body.replace(b"endsolid", b"\n" * 400_000 + b"endsolid"))
    with quick():
        assert len(read_mesh(path).faces) == len(malformed.arrays()[1])
    path.write_bytes(body + (b"vertex " + b" " * 500_000 + b"x\n") * 4)
    with quick():
        read_mesh(path)
    path.write_bytes(body.replace(b"\r\n", b"\n").replace(b"\n", b"\r"))  # of an old computer
    assert len(read_mesh(path).faces) == len(malformed.arrays()[1])


def test_a_material_file_is_read_once_however_often_it_is_named(tmp_path):
    vertices, faces = malformed.arrays()
    lines = ["mtllib m.mtl"] * 500 + ["vt 0 0", "usemtl a"]
    lines += [f"v {x} {y} {z}" for x, y, z in vertices]
    lines += [f"f {a}/1 {b}/1 {c}/1" for a, b, c in faces + 1]
    (tmp_path / "a.obj").write_text("\n".join(lines))
    (tmp_path / "m.mtl").write_bytes(b"newmtl a\nKd 1 1 1\n" * 100_000)
    with quick():
        assert read_mesh(tmp_path / "a.obj").texture is None


def test_nodes_that_show_one_mesh_very_often_are_counted_first(tmp_path):
    tree, body = tree_and_body()
    tree["nodes"] = [{"mesh": 0}] * 50_000
    tree["scenes"] = [{"nodes": list(range(50_000))}]
    refuse(tmp_path / "a.glb", to_glb(tree, body), "as often as it is shown")


def test_chains_of_nodes_are_bounded_in_depth(tmp_path):
    tree, body = tree_and_body()
    chain = [{"children": [k + 1]} for k in range(300_000)]
    tree["nodes"] = [*chain, {"mesh": 0}]
    refuse(tmp_path / "a.glb", to_glb(tree, body), "recursion")
    tree["nodes"] = [*chain[:150], {"mesh": 0, "translation": [0, 0, 1]}]
    (tmp_path / "a.glb").write_bytes(to_glb(tree, body))
    assert len(read_mesh(tmp_path / "a.glb").faces) == len(malformed.arrays()[1])


def test_a_picture_that_is_named_very_often_is_no_burden(tmp_path):
    tree, body = tree_and_body()
    picture = grey_png(4096)
    tree["bufferViews"].append({"buffer": 0, "byteOffset": len(body), "byteLength": len(picture)})
    tree["buffers"][0]["byteLength"] = len(body) + len(picture)
    tree["images"] = [{"bufferView": 2, "mimeType": "image/png"}] * 2000
    (tmp_path / "a.glb").write_bytes(to_glb(tree, body + picture))
    with quick():
        read_mesh(tmp_path / "a.glb")


def test_one_outside_file_is_read_once_however_many_buffers_name_it(tmp_path):
    tree, body = tree_and_body()
    (tmp_path / "a.bin").write_bytes(body + bytes(20 * 2**20))
    tree["buffers"] = [{"byteLength": len(body), "uri": "a.bin"}] * 5000
    (tmp_path / "a.gltf").write_text(json.dumps(tree))
    with quick():
        read_mesh(tmp_path / "a.gltf")


def test_a_zip_of_very_many_members_is_not_unpacked(tmp_path):
    entry = b"PK\1\2" + struct.pack("<HHHHHHIIIHHHHHII", 20, 20, *[0] * 7, 1, *[0] * 6) + b"a"
    count = 500_000
    end = b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, 65535, 65535, count * len(entry), 0, 0)
    (tmp_path / "a.zip").write_bytes(b"PK\3\4" + entry * count + end)
    (tmp_path / "out").mkdir()
    with quick(), pytest.raises(UnreadableFileError, match="500,000 members; at most"):
        unpack(tmp_path / "a.zip", tmp_path / "out")


# Pictures


@pytest.fixture
def ghost(tmp_path, monkeypatch):
    """A false Ghostscript in the way of the true one, and the file that it writes."""
    trace = tmp_path / "started"
    for name in ("gs", "gswin32c", "gswin64c"):
        program = tmp_path / "bin" / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(f"#!/bin/sh\ntouch {trace}\n")
        program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setattr("PIL.EpsImagePlugin.gs_binary", None, raising=False)
    return trace


SCRIPT = (
    b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n"
    b"%%EndProlog\nshowpage\n%%EOF\n"
)


def test_postscript_starts_no_interpreter(ghost, tmp_path, reads_here):
    with contextlib.suppress(OSError):  # so that the trap is known to work
        Image.open(io.BytesIO(SCRIPT)).load()
    assert ghost.exists()
    ghost.unlink()
    with pytest.raises(UnreadableFileError, match="cannot be read as one of PNG, JPEG"):
        load_texture(SCRIPT, "t.eps")
    vertices, faces = malformed.arrays()
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["vt 0 0", "usemtl a"]
    lines += [f"f {a}/1 {b}/1 {c}/1" for a, b, c in faces + 1]
    for number, name in enumerate(("t.eps", "t.png", "t.mtl", "t.bin")):
        (tmp_path / name).write_bytes(SCRIPT)
        (tmp_path / "m.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
        path = tmp_path / f"a{number}.obj"
        path.write_text("mtllib m.mtl\n" + "\n".join(lines))
        with pytest.raises(AssetImportError):
            read_mesh(path)
        shape = RawShape(
            kind="mesh", shape_to_link=trimesh.transformations.identity_matrix(), path=path
        )
        load_geometry(shape)  # without the picture
    tree, body = tree_and_body()
    tree["buffers"] = [
        {"byteLength": len(body), "uri": "a.bin"}, {"byteLength": len(SCRIPT), "uri": "t.png"},
    ]  # fmt: skip
    tree["bufferViews"].append({"buffer": 1, "byteLength": len(SCRIPT)})
    tree["images"] = [{"bufferView": 2}]
    (tmp_path / "a.bin").write_bytes(body)
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(tree))
    for read in (
        read_mesh,
        lambda path: load_geometry(RawShape(kind="mesh", shape_to_link=None, path=path)),
    ):
        with pytest.raises(UnreadableFileError, match="cannot be read as one of PNG"):
            read(path)
    assert not ghost.exists()


def test_the_size_of_a_picture_is_known_before_it_is_decoded():
    side = int(MAX_PIXELS**0.5) + 1
    with warnings.catch_warnings(), quick(megabytes=300):
        warnings.simplefilter("error")
        data = grey_png(side)
        with pytest.raises(UnreadableFileError, match="pixels; at most"):
            load_texture(data, "large.png")


# Folders and names


def test_an_asset_whose_files_are_links_to_themselves_is_refused(tmp_path):
    folder = tmp_path / "Scarf" / "loop"
    folder.mkdir(parents=True)
    for name in ("meta.json", "mesh.obj", "keypoints.json"):
        (folder / name).symlink_to(folder / name)
    with pytest.raises(Exception, match=r"expected meta\.json"):
        load_asset(folder)
    with pytest.raises(AssetImportError):
        import_garment(folder, out=tmp_path / "out")


def test_an_asset_with_impossible_numbers_is_refused(tmp_path):
    scarf = "v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n"
    (tmp_path / "scarf.obj").write_text(scarf)
    folder = import_garment(
        tmp_path / "scarf.obj", out=tmp_path / "out", options=GarmentImportOptions(spacing=0.02)
    ).folder
    meta = json.loads((folder / "meta.json").read_text())
    for value in ("1e999", "9" * 400, '"thick"', "-1", "true"):
        text = json.dumps({**meta, "wall_thickness": 0}).replace(
            '"wall_thickness": 0', f'"wall_thickness": {value}'
        )
        (folder / "meta.json").write_text(text)
        with pytest.raises(UnreadableFileError, match=r"meta\.json"):
            load_asset(folder)
    (folder / "meta.json").write_text(json.dumps(meta))
    mesh = (folder / "mesh.obj").read_text()
    (folder / "mesh.obj").write_text(mesh.replace("v ", "v 1e300 ", 1))
    with pytest.raises(UnreadableFileError, match="must be below 1e"):
        load_asset(folder)


def test_a_name_that_is_not_utf8_is_imported_and_can_be_written(tmp_path):
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/red\xff.obj"))
    try:
        path.write_text("v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n")
    except OSError:
        pytest.skip("this file system has no such names")
    report = import_garment(path, out=tmp_path / "out", options=GarmentImportOptions(spacing=0.02))
    assert report.source == "red?.obj"
    assert load_asset(report.folder).meta["source"] == "red?.obj"
    path.write_text("v 0 0 0\n")
    with pytest.raises(UnreadableFileError) as caught:
        import_garment(path, out=tmp_path / "out")
    str(caught.value).encode("utf-8")


def test_links_in_a_circle_below_a_folder_are_not_followed(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "again").symlink_to(tmp_path)
    (tmp_path / "a" / "s.obj").write_text("v 0 0 0\n")
    assert list_models(tmp_path) == (tmp_path / "a" / "s.obj",)
