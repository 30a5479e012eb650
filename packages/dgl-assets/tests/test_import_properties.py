"""Any bytes are read right or refused as documented, and nothing is written beside the target."""

import base64
import contextlib
import importlib.util
import io
import json
import struct
import tempfile
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dgl_assets import AssetError
from dgl_assets.importing import AssetImportError
from dgl_assets.importing.archive import unpack
from dgl_assets.importing.bounds import MAX_BUFFER_BYTES, MAX_FACES, MAX_VERTICES
from dgl_assets.importing.keypoints import read_keypoints
from dgl_assets.importing.paths import parse_json, resolve_reference
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.source import META_FILE, find_source
from dgl_assets.robots.importing.masses import settle_masses
from dgl_assets.robots.importing.read_urdf import MAX_MASS, MAX_NUMBER, read_urdf

_PATH = Path(__file__).parent / "dgl_robot_samples.py"
_SPEC = importlib.util.spec_from_file_location("dgl_robot_samples", _PATH)
samples = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(samples)

pytestmark = pytest.mark.usefixtures("reads_here")
COMMON = {
    "deadline": None,
    "derandomize": True,
    "database": None,
    "suppress_health_check": list(HealthCheck),
}
SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf")
POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5]], dtype=np.float64)
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])

floats = st.floats(-1e6, 1e6, width=32)


@st.composite
def meshes(draw):
    """A small mesh: vertices that 32 bits hold, all of them used."""
    count = draw(st.integers(3, 12))
    row = st.tuples(floats, floats, floats)
    vertices = np.array(draw(st.lists(row, min_size=count, max_size=count)), dtype=np.float64)
    corner = st.integers(0, count - 1)
    more = draw(st.lists(st.tuples(corner, corner, corner), max_size=8))
    faces = [(k, (k + 1) % count, (k + 2) % count) for k in range(count)]
    return vertices, np.array(faces + more, dtype=np.int64)


def write_obj(vertices, faces):
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    return (
        "\n".join(lines + [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]).encode() + b"\n"
    )


def write_ply(vertices, faces):
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float "
        "x\nproperty float y\n"
        f"property float z\nelement face {len(faces)}\nproperty list uchar int "
        "vertex_indices\nend_header\n"
    )
    record = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
    record["n"], record["i"] = 3, faces
    return head.encode() + vertices.astype("<f4").tobytes() + record.tobytes()


def write_stl(vertices, faces):
    record = np.zeros(len(faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")])
    record["v"] = vertices[faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + record.tobytes()


def write_gltf_tree(vertices, faces):
    body = vertices.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    size = 12 * len(vertices)
    return body, {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": len(body)}],
        "bufferViews": [
            {"buffer": 0, "byteLength": size},
            {"buffer": 0, "byteOffset": size, "byteLength": len(body) - size},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
    }


def write_gltf(vertices, faces):
    body, tree = write_gltf_tree(vertices, faces)
    uri = "data:application/octet-stream;base64," + base64.b64encode(body).decode()
    tree["buffers"][0]["uri"] = uri
    return json.dumps(tree).encode()


def write_glb(vertices, faces):
    body, tree = write_gltf_tree(vertices, faces)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(body)
    head = b"glTF" + struct.pack("<II", 2, size) + struct.pack("<I4s", len(text), b"JSON")
    return head + text + struct.pack("<I4s", len(body), b"BIN\0") + body


WRITERS = {
    ".obj": write_obj, ".ply": write_ply, ".stl": write_stl, ".glb": write_glb, ".gltf": write_gltf,
}  # fmt: skip
# The last of each strategy is what damage puts in place of other bytes.
SCRAPS = (
    b"", b"\0", b"\xff", b"-", b"nan", b"1e999", b"9" * 400, b"[" * 50, b'"', b"\n", b"/", b"..",
        b"\x80\x00",
)  # fmt: skip


@st.composite
def damaged(draw, original):
    """Bytes of a file with a few places changed, cut or doubled."""
    data = bytearray(original)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(len(data) - 1, 0)))
        length = draw(st.integers(0, 12))
        new = draw(st.sampled_from(SCRAPS) | st.binary(max_size=8))
        if draw(st.booleans()):
            new += bytes(data[start : start + length])
        data[start : start + length] = new
    return bytes(data)


@contextlib.contextmanager
def scratch():
    """A folder whose neighbours and temporary files must stay as they were."""
    with tempfile.TemporaryDirectory() as outer:
        inside, temporary = Path(outer) / "in", Path(outer) / "tmp"
        inside.mkdir()
        temporary.mkdir()
        (Path(outer) / "secret.txt").write_text("secret")
        before = tempfile.tempdir
        tempfile.tempdir = str(temporary)
        try:
            yield inside
        finally:
            tempfile.tempdir = before
        assert sorted(path.name for path in Path(outer).iterdir()) == ["in", "secret.txt", "tmp"]
        assert not list(temporary.iterdir())
        assert (Path(outer) / "secret.txt").read_text() == "secret"


def read_or_refuse(name, data):
    """Read bytes as a file; give the mesh, or None where it was refused as documented."""
    with scratch() as folder:
        path = folder / name
        path.write_bytes(data)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                mesh = read_mesh(path)
        except AssetImportError as err:
            message = str(err)
            assert "\n" not in message
            assert path.stem in message
            assert len(path.stem) < len(message) <= 600
            return None
        assert list(folder.iterdir()) == [path]
    assert mesh.vertices.dtype == np.float64
    assert 0 < len(mesh.vertices) <= MAX_VERTICES
    assert 0 < len(mesh.faces) <= MAX_FACES
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    assert mesh.uvs is None or mesh.uvs.shape == (*mesh.faces.shape, 2)
    assert mesh.object_ids is None or len(mesh.object_ids) == len(mesh.faces)
    return mesh


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=15, **COMMON)
@given(mesh=meshes())
def test_what_was_written_is_what_is_read(suffix, mesh):
    vertices, faces = mesh
    found = read_or_refuse(f"a{suffix}", WRITERS[suffix](vertices, faces))
    assert found is not None
    if suffix == ".stl":  # it has no shared vertices
        assert found.vertices[found.faces] == pytest.approx(vertices[faces])
        return
    assert found.vertices == pytest.approx(vertices)
    assert (found.faces == faces).all()


def check_damaged(suffix, data):
    whole = WRITERS[suffix](POINTS, TRIANGLES)
    read_or_refuse(f"a{suffix}", data.draw(damaged(whole)))


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=30, **COMMON)
@given(data=st.data())
def test_a_damaged_mesh_is_read_or_refused(suffix, data):
    check_damaged(suffix, data)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=800, **COMMON)
@given(data=st.data())
def test_a_damaged_mesh_is_read_or_refused_many_times(suffix, data):
    check_damaged(suffix, data)


@settings(max_examples=40, **COMMON)
@given(
    suffix=st.sampled_from((*SUFFIXES, ".zip", "")),
    head=st.sampled_from((b"", b"ply\n", b"glTF\2\0\0\0", b"solid a\nfacet", b"v 0 0 0\n",
        b'{"asset":{}', b"PK\3\4")),
    tail=st.binary(max_size=300),
)  # fmt: skip
def test_arbitrary_bytes_are_read_or_refused(suffix, head, tail):
    read_or_refuse(f"a{suffix}", head + tail)


json_leaves = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["0", "data:,", "../a", 10**30, -1, 0, 1, 2, 5126, "VEC3"])
)
json_lists = st.lists(json_leaves, max_size=4)
json_values = (
    json_leaves
    | json_lists
    | st.lists(json_lists, max_size=3)
    | st.dictionaries(st.text(max_size=6), json_leaves | json_lists, max_size=4)
)


def replace_in(tree, draw):
    """Replace one place of a JSON tree."""
    places = []

    def walk(node):
        items = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in items:
            places.append((node, key))
            if isinstance(value, dict | list):
                walk(value)

    walk(tree)
    node, key = draw(st.sampled_from(places))
    node[key] = draw(json_values)


def check_claims(data):
    body, tree = write_gltf_tree(POINTS, TRIANGLES)
    tree["buffers"][0]["uri"] = "data:a;base64," + base64.b64encode(body).decode()
    tree["images"] = [{"uri": "data:image/png;base64,AAAA"}] if data.draw(st.booleans()) else []
    tree["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    for _ in range(data.draw(st.integers(1, 3))):
        replace_in(tree, data.draw)
    read_or_refuse("a.gltf", json.dumps(tree).encode())


@settings(max_examples=60, **COMMON)
@given(data=st.data())
def test_a_gltf_with_other_claims_is_read_or_refused(data):
    check_claims(data)


@pytest.mark.slow
@settings(max_examples=2500, **COMMON)
@given(data=st.data())
def test_a_gltf_with_other_claims_is_read_or_refused_many_times(data):
    check_claims(data)


names = st.lists(
    st.sampled_from(["..", ".", "a", "b.obj", "", "C:", "~", "\u00e9", "x" * 260, "con", "a b"]),
    min_size=1,
    max_size=4,
)


@settings(max_examples=40, **COMMON)
@given(
    members=st.lists(st.tuples(names, st.sampled_from(["/", "\\"]), st.binary(max_size=40)),
        max_size=5),
    method=st.sampled_from([zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2,
        zipfile.ZIP_LZMA]),
    data=st.data(),
)  # fmt: skip
def test_an_archive_is_unpacked_into_its_folder_or_refused(members, method, data):
    stream = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(stream, "w", method) as archive:
        warnings.simplefilter("ignore")
        for parts, separator, content in members:
            archive.writestr(separator.join(parts) or "empty", content)
    packed = stream.getvalue()
    if data.draw(st.booleans()):
        packed = data.draw(damaged(packed))
    with scratch() as folder:
        (folder / "out").mkdir()
        (folder / "a.zip").write_bytes(packed)
        with contextlib.suppress(AssetImportError):
            unpack(folder / "a.zip", folder / "out")
        assert sorted(path.name for path in folder.iterdir()) == ["a.zip", "out"]
        found = [path for path in folder.rglob("*") if path.is_file()]
        assert not any(path.is_symlink() for path in found)
        assert sum(path.stat().st_size for path in found) < MAX_BUFFER_BYTES


@settings(max_examples=50, **COMMON)
@given(value=json_values, data=st.data())
def test_key_points_are_read_or_refused(value, data):
    tree = {"left": 1, "collar": [0, 0.5, 0], "other": value}
    text = json.dumps(tree).encode()
    if data.draw(st.booleans()):
        text = data.draw(damaged(text))
    with scratch() as folder:
        (folder / "keypoints.json").write_bytes(text)
        try:
            points = read_keypoints(folder / "keypoints.json", POINTS)
        except AssetImportError:
            return
    assert points.positions.shape == (len(points.names), 3)
    assert np.isfinite(points.positions).all()
    assert (points.vertex_ids < len(POINTS)).all()
    json.dumps(list(points.names), ensure_ascii=False).encode()  # can be written again


@settings(max_examples=50, **COMMON)
@given(
    value=json_values,
    key=st.sampled_from(["category", "licence", "units", "up", "x"]),
    data=st.data(),
)
def test_the_facts_of_a_folder_are_read_or_refused(value, key, data):
    text = json.dumps({"source": "me", key: value}).encode()
    if data.draw(st.booleans()):
        text = data.draw(damaged(text))
    with scratch() as folder:
        (folder / "mesh.obj").write_bytes(write_obj(POINTS, TRIANGLES))
        (folder / META_FILE).write_bytes(text)
        try:
            source = find_source(folder)
        except AssetImportError:
            return
    assert all(isinstance(text, str) and len(text) <= 500 for text in source.meta.values())


@settings(max_examples=100, **COMMON)
@given(
    data=st.binary(max_size=200)
    | st.text(max_size=100).map(str.encode)
    | json_values.map(lambda v: json.dumps(v).encode())
)
def test_json_is_parsed_into_what_can_be_written_or_refused(data):
    try:
        tree = parse_json(data, "a.json")
    except AssetImportError:
        return
    json.dumps(tree, allow_nan=False, ensure_ascii=False).encode()


@settings(max_examples=100, **COMMON)
@given(
    parts=names,
    scheme=st.sampled_from(["", "/", "//", "file://", "http://", "%2e%2e/", "..\\"]),
    is_rooted=st.booleans(),
)
def test_a_reference_never_leads_out(parts, scheme, is_rooted):
    with scratch() as folder:
        inner = folder / "deep"
        (inner / "a").mkdir(parents=True)
        (inner / "b.obj").write_text("x")
        root = folder if is_rooted else None
        try:
            found = resolve_reference(inner, scheme + "/".join(parts), named_by="a.mtl", root=root)
        except AssetImportError:
            return
        assert found.is_file()
        assert found.resolve().is_relative_to((root or inner).resolve())


numbers = st.sampled_from(
    [
        "0",
        "-1",
        "1e-300",
        "1e300",
        "nan",
        "inf",
        "1e999",
        "9" * 400,
        "x",
        "",
        "1 2 3",
        "0x1",
        "1e-8 1 1",
        "5",
    ]
)
HAND = samples.sixteen_joint_hand().encode()


def check_urdf(data, count):
    text = HAND.decode()
    for _ in range(data.draw(st.integers(1, count))):
        attribute = data.draw(
            st.sampled_from(["value", "ixx", "iyz", "xyz", "rpy", "lower", "upper", "effort",
                "velocity", "size", "link", "name", "type"])
        )  # fmt: skip
        pieces = text.split(f' {attribute}="')
        place = data.draw(st.integers(1, len(pieces) - 1))
        _, quote, rest = pieces[place].partition('"')
        pieces[place] = data.draw(numbers | st.text("abc/.<&{}", max_size=6)) + quote + rest
        text = f' {attribute}="'.join(pieces)
    body = text.encode()
    if data.draw(st.integers(0, 3)) == 0:
        body = data.draw(damaged(body))
    with scratch() as folder:
        (folder / "r.urdf").write_bytes(body)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                robot, _ = settle_masses(read_urdf(folder / "r.urdf"))
        except AssetError:
            return
    for link in robot.links:
        assert 0.0 <= link.mass <= MAX_MASS
        assert link.mass == 0.0 or np.linalg.eigvalsh(link.inertia)[0] > 0.0
        assert np.isfinite(link.inertial_to_link).all()
    for joint in robot.joints:
        assert 0.0 <= joint.effort <= MAX_NUMBER
        assert np.isfinite(joint.joint_to_parent).all()
        assert joint.axis is None or np.linalg.norm(joint.axis) == pytest.approx(1.0)


@settings(max_examples=50, **COMMON)
@given(data=st.data())
def test_a_changed_urdf_is_read_or_refused(data):
    check_urdf(data, 3)


@pytest.mark.slow
@settings(max_examples=800, **COMMON)
@given(data=st.data())
def test_a_changed_urdf_is_read_or_refused_many_times(data):
    check_urdf(data, 6)
