"""Files that cannot be imported, made in code: each case writes one and gives its path."""

import functools
import io
import json
import os
import random
import stat
import struct
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh

from dgl_assets import TopParameters, make_garment

Case = Callable[[Path], Path]

MESH_SUFFIXES = (".obj", ".ply", ".stl", ".glb", ".gltf", ".usda", ".usdc", ".zip")
CUTS = (0.0005, 0.004, 0.02, 0.06, 0.15, 0.27, 0.4, 0.52, 0.63, 0.75, 0.86, 0.95)


@functools.cache
def arrays() -> tuple[np.ndarray, np.ndarray]:
    """A coarse top."""
    top = make_garment(TopParameters(), spacing=0.025)
    return top.vertices.astype(np.float64), top.faces


def to_glb(vertices, faces) -> bytes:
    return bytes(trimesh.Trimesh(vertices, faces, process=False).export(file_type="glb"))


def to_gltf(vertices, faces) -> dict:
    """A text glTF whose buffer is within it."""
    import base64

    body = vertices.astype("<f4").tobytes() + faces.astype("<u4").tobytes()
    size = 12 * len(vertices)
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [
            {
                "byteLength": len(body),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(body).decode(),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": size},
            {"buffer": 0, "byteOffset": size, "byteLength": len(body) - size},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(vertices), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
        ],
    }


def to_obj(vertices, faces, head: str = "") -> str:
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in np.asarray(faces) + 1]
    return head + "\n".join(lines) + "\n"


def to_usd(folder: Path, suffix: str, vertices, faces) -> Path:
    from pxr import Usd, UsdGeom, Vt

    path = folder / f"whole{suffix}"
    stage = Usd.Stage.CreateNew(str(path))
    mesh = UsdGeom.Mesh.Define(stage, "/World/garment")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(np.asarray(faces).ravel().tolist())
    stage.Save()
    return path


def whole(folder: Path, kind: str) -> bytes:
    """A file that can be imported, as bytes."""
    vertices, faces = arrays()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    match kind:
        case "obj":
            return to_obj(vertices, faces).encode()
        case "ply":
            return bytes(mesh.export(file_type="ply"))
        case "ascii.ply":
            return bytes(mesh.export(file_type="ply", encoding="ascii"))
        case "stl":
            return bytes(mesh.export(file_type="stl"))
        case "ascii.stl":
            return str(mesh.export(file_type="stl_ascii")).encode()
        case "glb":
            return to_glb(vertices, faces)
        case "gltf":
            return json.dumps(to_gltf(vertices, faces)).encode()
        case "usda" | "usdc":
            return to_usd(folder, f".{kind}", vertices, faces).read_bytes()
        case "zip":
            return zipped({"top.obj": to_obj(vertices, faces).encode()})
    raise ValueError(kind)


KINDS = ("obj", "ply", "ascii.ply", "stl", "ascii.stl", "glb", "gltf", "usda", "usdc", "zip")


def zipped(members: dict[str, bytes], *, stored: bool = False) -> bytes:
    stream = io.BytesIO()
    method = zipfile.ZIP_STORED if stored else zipfile.ZIP_DEFLATED
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return stream.getvalue()


def written(name: str, data: bytes | str) -> Case:
    def make(folder: Path) -> Path:
        path = folder / name
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        return path

    return make


def changed(change: Callable[[np.ndarray, np.ndarray], tuple], name: str) -> Case:
    """The top with changed arrays, written by hand so that nothing repairs it."""

    def make(folder: Path) -> Path:
        vertices, faces = change(*(array.copy() for array in arrays()))
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces)
        kind = name.rpartition(".")[2]
        if kind == "obj":
            return written(name, to_obj(vertices, faces))(folder)
        if kind == "gltf":
            return written(name, json.dumps(to_gltf(vertices, faces)))(folder)
        if kind == "stl":
            record = np.zeros(
                len(faces), dtype=[("n", "<f4", 3), ("v", "<f4", (3, 3)), ("a", "<u2")]
            )
            record["v"] = vertices[faces]
            data = b"\0" * 80 + struct.pack("<I", len(faces)) + record.tobytes()
            return written(name, data)(folder)
        head = (
            f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\nproperty float "
            "x\n"
            f"property float y\nproperty float z\nelement face {len(faces)}\n"
            "property list uchar int vertex_indices\nend_header\n"
        )
        record = np.zeros(len(faces), dtype=[("n", "u1"), ("i", "<i4", 3)])
        record["n"], record["i"] = 3, faces
        return written(name, head.encode() + vertices.astype("<f4").tobytes() + record.tobytes())(
            folder
        )

    return make


def truncated() -> Iterator[tuple[str, Case]]:
    def cut(kind: str, share: float) -> Case:
        def make(folder: Path) -> Path:
            data = whole(folder, kind)
            return written(f"cut.{kind}", data[: int(share * len(data))])(folder)

        return make

    for kind in KINDS:
        for share in CUTS[2::3] if kind.startswith("usd") else CUTS:  # a process each
            yield f"{kind} cut at {share:.2%}", cut(kind, share)
    for kind in ("ply", "stl", "glb", "gltf", "usdc", "zip"):  # every byte counts

        def last(folder: Path, kind: str = kind) -> Path:
            return written(f"cut.{kind}", whole(folder, kind)[:-1])(folder)

        yield f"{kind} without its last byte", last


def not_finite() -> Iterator[tuple[str, Case]]:
    for kind in ("obj", "ply", "stl", "gltf"):
        for value in (np.nan, np.inf, -np.inf, 1e30):

            def change(vertices, faces, value=value):
                vertices[faces[40, 1], 1] = value
                return vertices, faces

            yield f"{value} in {kind}", changed(change, f"number.{kind}")


def wrong_indices() -> Iterator[tuple[str, Case]]:
    for kind in ("obj", "ply", "gltf"):
        for value in (-1, 10**6, 2**31 - 2):

            def change(vertices, faces, value=value):
                faces[7, 2] = value
                return vertices, faces

            yield f"index {value} in {kind}", changed(change, f"index.{kind}")


def huge_claims() -> Iterator[tuple[str, Case]]:
    head = "ply\nformat {form} 1.0\nelement vertex {v}\n"
    head += "property float x\nproperty float y\nproperty float z\n"
    head += "element face {f}\nproperty list uchar int vertex_indices\nend_header\n"
    for form in ("ascii", "binary_little_endian"):
        for v, f in ((10**12, 10), (10, 10**12), (900_000, 10), (-5, 10), (10, -5), (0, 0)):
            text = head.format(form=form, v=v, f=f)
            yield (
                f"{form} ply claims {v} and {f}",
                written("claim.ply", text.encode() + b"\0" * 200),
            )
    for count in (2**32 - 1, 10**6):
        yield (
            f"stl claims {count}",
            written("c.stl", b"\0" * 80 + struct.pack("<I", count) + b"\1" * 500),
        )
    vertices, faces = arrays()
    for key, field, value in (
        ("accessors", "count", 10**9),
        ("accessors", "count", -3),
        ("accessors", "byteOffset", 10**7),
        ("bufferViews", "byteLength", 10**9),
        ("bufferViews", "byteOffset", -8),
        ("buffers", "byteLength", 10**12),
        ("accessors", "componentType", 9999),
        ("accessors", "bufferView", 77),
        ("accessors", "type", "VEC9"),
        ("bufferViews", "buffer", 3),
    ):
        tree = to_gltf(vertices, faces)
        tree[key][0][field] = value
        yield f"gltf {key} {field} {value}", written("claim.gltf", json.dumps(tree))
    lie = bytearray(zipped({"top.obj": b"v 0 0 0\n" * 1000}))
    place = lie.rfind(b"PK\x01\x02")
    lie[place + 24 : place + 28] = struct.pack("<I", 2**32 - 2)
    yield "zip claims 4 GiB", written("claim.zip", bytes(lie))
    many = zipped({f"{i}.txt": b"x" for i in range(2500)}, stored=True)
    yield "zip of 2,500 members", written("many.zip", many)


def wrong_types() -> Iterator[tuple[str, Case]]:
    generator = random.Random(3)
    for suffix in MESH_SUFFIXES:
        yield f"empty {suffix}", written(f"empty{suffix}", b"")
        junk = generator.randbytes(3000)
        yield f"junk {suffix}", written(f"junk{suffix}", junk)
        yield f"zeros {suffix}", written(f"zeros{suffix}", b"\0" * 4000)
        yield f"prose {suffix}", written(f"prose{suffix}", "This is not a mesh.\n" * 50)
        png = b"\x89PNG\r\n\x1a\n" + generator.randbytes(500)
        yield f"picture as {suffix}", written(f"picture{suffix}", png)
    for kind, suffix in (
        ("obj", ".ply"),
        ("ply", ".obj"),
        ("stl", ".glb"),
        ("glb", ".obj"),
        ("gltf", ".glb"),
        ("zip", ".stl"),
        ("usda", ".obj"),
        ("ascii.stl", ".obj"),
        ("usdc", ".ply"),
    ):

        def make(folder: Path, kind: str = kind, suffix: str = suffix) -> Path:
            return written(f"renamed{suffix}", whole(folder, kind))(folder)

        yield f"{kind} named {suffix}", make
    yield "fbx", written("top.fbx", b"Kaydara FBX Binary  \0\x1a\0" + b"\0" * 400)
    yield "no suffix", written("top", generator.randbytes(800))


def broken_surfaces() -> Iterator[tuple[str, Case]]:
    def repeated(vertices, faces):
        return vertices, np.repeat(faces[:, :1], 3, axis=1)

    def line(vertices, faces):
        vertices[:, 1:] = 0
        return vertices, faces

    def point(vertices, faces):
        return vertices * 0, faces

    def slivers(vertices, faces):
        a, b, c = faces[:100].T  # a vertex on an edge, which its other face does not know
        middle = len(vertices) + np.arange(100)
        cut = [np.column_stack(f) for f in ((a, middle, c), (middle, b, c), (a, b, middle))]
        points = np.vstack([vertices, (vertices[a] + vertices[b]) / 2])
        return points, np.vstack([*cut, faces[100:]])

    def fins(vertices, faces):
        """A fan around an edge, as large as the cloth: which of them is the cloth?"""
        shifted = [vertices + np.array([0, 0, height]) for height in (0.2, 0.4)]
        count = len(vertices)
        layers = [np.where(faces == 5, 5, faces + k * count) for k in (1, 2)]
        layers = [np.where(faces == 6, 6, layer) for layer in layers]
        return np.vstack([vertices, *shifted]), np.vstack([faces, *layers])

    def twin(vertices, faces):
        return np.vstack([vertices, vertices + np.array([0, 0, 0.4])]), np.vstack(
            [faces, faces + len(vertices)]
        )

    def flap(vertices, faces):
        far = vertices[:, 0] > 0.05
        return vertices, faces[far[faces].all(axis=1) | (~far[faces]).all(axis=1)]

    def one(vertices, faces):
        return vertices, faces[:1]

    def torn(vertices, faces):
        keep = np.random.default_rng(0).random(len(faces)) > 0.4
        return vertices, faces[keep]

    def sewn_up(vertices, faces):
        box = trimesh.creation.box((0.5, 0.7, 0.1)).subdivide().subdivide()
        return np.asarray(box.vertices), np.asarray(box.faces)

    def ball(vertices, faces):
        sphere = trimesh.creation.icosphere(3, radius=0.4)
        return np.asarray(sphere.vertices), np.asarray(sphere.faces)

    def doughnut(vertices, faces):
        ring = trimesh.creation.torus(0.4, 0.1)
        return np.asarray(ring.vertices), np.asarray(ring.faces)

    def twisted(vertices, faces):
        turns = np.linspace(0, 2 * np.pi, 41)[:-1]
        points = []
        for turn in turns:
            for side in (-0.15, 0.15):
                radius = 0.5 + side * np.cos(turn / 2)
                points.append(
                    [radius * np.cos(turn), radius * np.sin(turn), side * np.sin(turn / 2)]
                )
        quads = []
        for k in range(39):
            a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3
            quads += [(a, c, b), (b, c, d)]
        quads += [(78, 1, 79), (79, 1, 0)]
        return np.array(points), np.array(quads)

    def strange_size(vertices, faces):
        return vertices * 4.7, faces

    def tiny(vertices, faces):
        return vertices * 1e-9, faces

    def no_faces(vertices, faces):
        return vertices, faces[:0]

    def no_vertices(vertices, faces):
        return vertices[:0], faces[:0]

    def unused(vertices, faces):
        return np.vstack([vertices, np.tile(vertices, (2, 1))]), faces

    changes = (
        repeated, line, point, slivers, fins, twin, flap, one, torn, sewn_up, ball, doughnut,
            twisted,
        strange_size, tiny, no_faces, no_vertices,
    )  # fmt: skip
    for change in changes:
        for kind in ("obj", "ply"):
            yield f"{change.__name__} in {kind}", changed(change, f"{change.__name__}.{kind}")
    yield "unused in obj", changed(unused, "unused.obj")
    for text in (
        "f 1 2",
        "f 1 2 x",
        "f 0 1 2",
        "v 1 2",
        "v a b c",
        "f 1//",
        "f 1/9 2/9 3/9",
        "f 1 2 99",
    ):
        body = f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{text}\n"
        yield f"obj line {text!r}", written("line.obj", body)


def hostile_archives() -> Iterator[tuple[str, Case]]:
    body = to_obj(*arrays()).encode()
    for name in (
        "../evil.obj",
        "a/../../evil.obj",
        "/etc/evil.obj",
        "..\\evil.obj",
        "C:\\evil.obj",
        "C:evil.obj",
        "a/b/../../../evil.obj",
    ):
        yield f"zip path {name!r}", written("slip.zip", zipped({name: body}))
    link = zipfile.ZipInfo("top.obj")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr(link, "/etc/passwd")
    yield "zip with a link", written("link.zip", stream.getvalue())
    locked = bytearray(zipped({"top.obj": body}))
    locked[6] |= 1
    locked[locked.rfind(b"PK\x01\x02") + 8] |= 1
    yield "encrypted zip", written("locked.zip", bytes(locked))
    yield "empty zip", written("empty.zip", zipped({}))
    yield "zip without a mesh", written("text.zip", zipped({"readme.txt": b"hello"}))
    inner = zipped({"inner.zip": zipped({"top.obj": body})})
    yield "zip in a zip in a zip", written("nested.zip", zipped({"middle.zip": inner}))
    empty = zipped({"inner.zip": zipped({"readme.txt": b"hello"})})
    yield "zip in a zip without a mesh", written("nested.zip", empty)
    yield "zip with two meshes", written("two.zip", zipped({"a.obj": body, "b.obj": body}))
    yield "zip with a name twice", twice
    yield "zip with a long name", written("long.zip", zipped({"n" * 300 + ".obj": body}))
    yield "zip with a long path", written("far.zip", zipped({"folder/" * 300 + "a.obj": body}))
    yield "zip with a file as folder", written("both.zip", zipped({"a": body, "a/b.obj": body}))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("top.obj", body)
    packed = bytearray(stream.getvalue())
    packed[60:90] = b"\xff" * 30
    yield "zip with damaged LZMA", written("lzma.zip", bytes(packed))
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_BZIP2) as archive:
        archive.writestr("top.obj", body)
    packed = bytearray(stream.getvalue())
    packed[60:90] = b"\xff" * 30
    yield "zip with damaged bzip2", written("bzip2.zip", bytes(packed))
    flagged = bytearray(zipped({"\u00e9.obj": body}))
    place = flagged.rfind(b"\xc3\xa9")
    flagged[place : place + 2] = b"\xff\xfe"
    yield "zip with a name that is not UTF-8", written("name.zip", bytes(flagged))
    damaged = bytearray(zipped({"top.obj": body}))
    damaged[200:260] = b"\0" * 60
    yield "zip with a damaged member", written("damaged.zip", bytes(damaged))


def twice(folder: Path) -> Path:
    import warnings

    with warnings.catch_warnings(), zipfile.ZipFile(folder / "twice.zip", "w") as archive:
        warnings.simplefilter("ignore")
        archive.writestr("top.obj", b"v 0 0 0\n")
        archive.writestr("top.obj", b"v 0 0 0\n")
    return folder / "twice.zip"


def hostile_references() -> Iterator[tuple[str, Case]]:
    def material(reference: str, library: str = "m.mtl", picture: bytes | None = None) -> Case:
        def make(folder: Path) -> Path:
            vertices, faces = arrays()
            (folder.parent / "secret.png").write_bytes(b"secret")
            (folder / "m.mtl").write_text(f"newmtl cloth\nmap_Kd {reference}\n")
            if picture is not None:
                (folder / reference).write_bytes(picture)
            lines = [f"v {x} {y} {z}" for x, y, z in vertices] + ["vt 0 0"]
            lines += ["usemtl cloth"] + [f"f {a}/1 {b}/1 {c}/1" for a, b, c in faces + 1]
            return written("top.obj", f"mtllib {library}\n" + "\n".join(lines))(folder)

        return make

    for reference in (
        "../secret.png", "/etc/passwd", "C:\\textures\\cloth.png", "file:///etc/passwd",
            "missing.png",
        "http://example.org/cloth.png", "a/../../secret.png", "%2e%2e/secret.png",
    ):  # fmt: skip
        yield f"mtl picture {reference!r}", material(reference)
    for library in ("../m.mtl", "/etc/passwd", "missing.mtl", "."):
        yield f"mtllib {library!r}", material("x.png", library)
    yield "picture is prose", material("cloth.png", picture=b"not a picture" * 20)
    stream = io.BytesIO()
    from PIL import Image

    Image.new("RGB", (64, 64), (200, 90, 10)).save(stream, format="PNG")
    yield "picture is cut off", material("cloth.png", picture=stream.getvalue()[:60])
    for name in ("cloth.eps", "cloth.png", "cloth.mtl"):
        script = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n"
        yield f"picture {name} is PostScript", material(name, picture=script)
    yield "picture is empty", material("cloth.png", picture=b"")
    bomb = bytearray(stream.getvalue())
    bomb[16:24] = struct.pack(">II", 60000, 60000)
    yield "picture claims 3.6 gigapixels", material("cloth.png", picture=bytes(bomb))

    def link(folder: Path) -> Path:
        path = material("link.png")(folder)
        (folder / "link.png").symlink_to(folder.parent / "secret.png")
        return path

    yield "picture is a link out of the folder", link
    vertices, faces = arrays()
    for uri in (
        "../../secret.bin", "/etc/passwd", "http://example.org/a.bin", "missing.bin", "file:///etc/passwd",
        "data:application/octet-stream;base64,####", "data:,abc", "..%2Fsecret.bin", "",
    ):  # fmt: skip
        tree = to_gltf(vertices, faces)
        tree["buffers"][0]["uri"] = uri
        yield f"gltf buffer {uri[:40]!r}", written("ref.gltf", json.dumps(tree))
    for uri in ("../secret.png", "/etc/passwd", "nowhere.png"):
        tree = to_gltf(vertices, faces)
        tree["images"] = [{"uri": uri}]
        yield f"gltf image {uri!r}", written("image.gltf", json.dumps(tree))
    for kind, other in (("subLayers", "../secret.usda"), ("references", "/etc/secret.usda")):
        text = "#usda 1.0\n"
        text += f"(\n subLayers = [@{other}@]\n)\n" if kind == "subLayers" else ""
        text += 'def Mesh "a"'
        text += f" (\n references = @{other}@\n)" if kind == "references" else ""
        yield f"usd {kind}", written("ref.usda", text + " {\n}\n")


def broken_gltf() -> Iterator[tuple[str, Case]]:
    vertices, faces = arrays()

    def edited(edit: Callable[[dict], object]) -> Case:
        tree = to_gltf(vertices, faces)
        edit(tree)
        return written("edited.gltf", json.dumps(tree))

    def primitive(tree):
        return tree["meshes"][0]["primitives"][0]

    edits = {
        "circle": lambda t: t.update(nodes=[{"mesh": 0, "children": [1]}, {"children": [0]}]),
        "own child": lambda t: t["nodes"][0].update(children=[0]),
        "missing child": lambda t: t["nodes"][0].update(children=[9]),
        "deep nodes": lambda t: t.update(
            nodes=[{"children": [k + 1]} for k in range(3000)] + [{"mesh": 0}]
        ),
        "no asset": lambda t: t.pop("asset"),
        "no meshes": lambda t: t.update(meshes=[], nodes=[{}]),
        "points": lambda t: primitive(t).update(mode=0),
        "draco": lambda t: t.update(extensionsRequired=["KHR_draco_mesh_compression"]),
        "sparse": lambda t: t["accessors"][0].update(sparse={"count": 1}),
        "no positions": lambda t: primitive(t)["attributes"].clear(),
        "flat positions": lambda t: t["accessors"][0].update(type="VEC2"),
        "accessor of none": lambda t: primitive(t).update(indices=50),
        "no node": lambda t: t.update(nodes=[{}]),
        "meshes is text": lambda t: t.update(meshes="none"),
        "nodes is null": lambda t: t.update(nodes=None),
        "scene of none": lambda t: t.update(scene=4),
        "negative index": lambda t: primitive(t).update(indices=-1),
        "count beyond numbers": lambda t: t["accessors"][0].update(count=10**30),
        "matrix of three": lambda t: t["nodes"][0].update(matrix=[1, 2, 3]),
        "no rotation": lambda t: t["nodes"][0].update(rotation=[0, 0, 0, 0]),
        "scale of 1e300": lambda t: t["nodes"][0].update(scale=[1e300] * 3),
        "many nodes": lambda t: t.update(
            nodes=[{"mesh": 0}] * 9000, scenes=[{"nodes": list(range(9000))}]
        ),
        "count is text": lambda t: t["accessors"][0].update(count="many"),
    }
    for name, edit in edits.items():
        yield f"gltf: {name}", edited(edit)
    yield "gltf: deep brackets", written("deep.gltf", "[" * 100_000)
    yield "gltf: deep object", written("deep.gltf", '{"asset":' * 100_000)
    text = json.dumps(to_gltf(vertices, faces))
    for number in ("1e999", "9" * 400, "NaN", "-Infinity"):
        broken = text.replace('"count": ', f'"count": {number}, "was": ', 1)
        yield f"gltf: count {number[:9]}", written("count.gltf", broken)
    yield "gltf: a list", written("list.gltf", '{"a": [1, 2]}')
    body = to_glb(vertices, faces)
    yield "glb version 1", written("old.glb", body[:4] + struct.pack("<I", 1) + body[8:])
    yield "glb longer than it says", written("long.glb", body + b"\0" * 40)
    yield (
        "glb chunk too long",
        written("chunk.glb", body[:12] + struct.pack("<I", 2**31) + body[16:]),
    )
    yield "glb without JSON", written("bin.glb", body[:16] + b"XXXX" + body[20:])


def folders() -> Iterator[tuple[str, Case]]:
    body = to_obj(*arrays())

    def folder_with(files: dict[str, str]) -> Case:
        def make(folder: Path) -> Path:
            inner = folder / "garment"
            inner.mkdir()
            for name, text in files.items():
                (inner / name).write_text(text)
            return inner

        return make

    yield "missing path", lambda folder: folder / "nowhere.obj"
    yield "empty folder", folder_with({})
    yield "folder without mesh", folder_with({"notes.txt": "hello"})
    yield "folder of two meshes", folder_with({"a.obj": body, "b.obj": body})
    for name, text in {
        "prose": "hello",
        "list": "[1, 2]",
        "vertex too high": '{"left_cuff": 999999}',
        "negative vertex": '{"left_cuff": -1}',
        "fraction": '{"left_cuff": 1.5}',
        "true": '{"left_cuff": true}',
        "two numbers": '{"left_cuff": [0, 1]}',
        "NaN": '{"left_cuff": [NaN, 0, 0]}',
        "null": '{"left_cuff": null}',
        "off the surface": '{"left_cuff": [0, 0, 3]}',
        "cut off": '{"left_cuff": 12',
        "too many": json.dumps({f"p{i}": i for i in range(1001)}),
        "deep": "[" * 100_000,
        "400 digits": '{"left_cuff": ' + "9" * 400 + "}",
        "position of 400 digits": '{"left_cuff": [0, 0, ' + "9" * 400 + "]}",
        "beyond numbers": '{"left_cuff": [0, 0, 1e999]}',
        "far away": '{"left_cuff": [0, 0, 1e300]}',
        "half a character": '{"left_\\ud800": 1}',
        "long name": json.dumps({"x" * 600: 1}),
        "nested": '{"left_cuff": ' + "[" * 900 + "]" * 900 + "}",
    }.items():
        yield f"key points: {name}", folder_with({"mesh.obj": body, "keypoints.json": text})
    for name, text in {
        "prose": "hello",
        "list": "[]",
        "category": '{"category": "Socks"}',
        "number": '{"licence": 4}',
        "long text": json.dumps({"source": "x" * 5000}),
        "units": '{"units": "feet"}',
        "axis": '{"up": "w"}',
        "nested": '{"licence": ' + "[" * 900 + "]" * 900 + "}",
        "half a character": '{"licence": "\\udfff"}',
    }.items():
        yield f"meta: {name}", folder_with({"mesh.obj": body, "meta.json": text})

    def named_like_a_mesh(folder: Path) -> Path:
        (folder / "top.obj").mkdir()
        return folder / "top.obj"

    def dangling(folder: Path) -> Path:
        (folder / "top.obj").symlink_to(folder / "nowhere.obj")
        return folder / "top.obj"

    def circular(folder: Path) -> Path:
        (folder / "a.obj").symlink_to(folder / "b.obj")
        (folder / "b.obj").symlink_to(folder / "a.obj")
        return folder / "a.obj"

    def leads_out(folder: Path) -> Path:
        (folder / "inner").mkdir()
        written("secret.obj", body)(folder)
        (folder / "inner" / "mesh.obj").symlink_to(folder / "secret.obj")
        return folder / "inner"

    def linked_to_itself(folder: Path) -> Path:
        (folder / "inner").mkdir()
        written("mesh.obj", body)(folder / "inner")
        (folder / "inner" / "meta.json").symlink_to(folder / "inner" / "meta.json")
        return folder / "inner"

    def long_name(folder: Path) -> Path:
        return folder / ("n" * 300 + ".obj")

    def pipe(folder: Path) -> Path:
        os.mkfifo(folder / "top.obj")
        return folder / "top.obj"

    for case in (
        named_like_a_mesh,
        dangling,
        circular,
        leads_out,
        linked_to_itself,
        long_name,
        pipe,
    ):
        yield case.__name__.replace("_", " "), case


def cases() -> dict[str, Case]:
    """Every case by its name."""
    groups = (
        truncated, not_finite, wrong_indices, huge_claims, wrong_types, broken_surfaces,
            hostile_archives,
        hostile_references, broken_gltf, folders,
    )  # fmt: skip
    found: dict[str, Case] = {}
    for group in groups:
        for name, case in group():
            assert name not in found, name
            found[name] = case
    return found
