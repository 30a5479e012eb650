"""Garments of artists and download sites: archives, bodies, pockets, thick or torn meshes."""

import importlib.util
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from dgl_assets.importing import (
    AssetImportError,
    BrokenMeshError,
    GarmentImportOptions,
    UnclearGarmentError,
    UnreadableFileError,
    import_garment,
    load_asset,
)
from dgl_assets.importing.check import clean_mesh
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.topology import (
    compute_edge_table,
    compute_vertex_normals,
    drop_unused,
    find_loops,
)

_SPEC = importlib.util.spec_from_file_location("foreign", Path(__file__).parent / "foreign.py")
foreign = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(foreign)

SCARF = "v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n"


def bring(path, tmp_path, lay_flat=None, **options):
    options = GarmentImportOptions(spacing=0.025, **options)
    return import_garment(path, out=tmp_path / "out", options=options, lay_flat=lay_flat)


def to_lines(vertices, faces, first=1):
    lines = [f"v {x:.7f} {y:.7f} {z:.7f}" for x, y, z in vertices]
    return lines + [f"f {a} {b} {c}" for a, b, c in (np.asarray(faces) + first).tolist()]


def write(path, *parts):
    """Write an OBJ file of parts: (name, vertices, faces)."""
    lines, first = [], 1
    for name, vertices, faces in parts:
        lines += [f"o {name}"] if name else []
        lines += to_lines(vertices, faces, first)
        first += len(vertices)
    path.write_text("\n".join(lines) + "\n")
    return path


def pack(path, members):
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


@pytest.fixture(scope="module")
def worn():
    """A top that is blown up by a body."""
    return foreign.make_worn_top(3)


def body():
    ball = trimesh.creation.icosphere(3, radius=0.09)
    return np.asarray(ball.vertices), np.asarray(ball.faces)


def solidify(vertices, faces, thickness, *, rim=True):
    """Give a sheet a thickness, as modelling programs do."""
    inner = vertices - thickness * compute_vertex_normals(vertices, faces)
    parts = [faces, faces[:, [0, 2, 1]] + len(vertices)]
    if rim:
        edges = compute_edge_table(faces)
        is_open = (edges.counts == 1)[edges.face_edges]
        start, end = faces[is_open], np.roll(faces, -1, axis=1)[is_open]
        below = start + len(vertices), end + len(vertices)
        parts += [np.column_stack([end, start, below[0]]), np.column_stack([end, *below])]
    return np.concatenate([vertices, inner]), np.concatenate(parts)


# Archives


def test_a_mesh_is_found_in_any_folder_of_an_archive_with_its_picture_beside(tmp_path):
    stream = io.BytesIO()
    Image.new("RGB", (8, 8), (200, 90, 10)).save(stream, format="PNG")
    lines = SCARF.replace(
        "f 1 2 3 4", "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl c\nf 1/1 2/2 3/3 4/4"
    )
    members = {
        "textures/": b"",
        "textures/cloth.png": stream.getvalue(),
        "__MACOSX/source/model/._scarf.obj": b"junk",
        "source/model/scarf.obj": "mtllib scarf.mtl\n" + lines,
        "source/model/scarf.mtl": "newmtl c\nmap_Kd ..\\..\\textures\\cloth.png\n",
    }
    report = bring(pack(tmp_path / "red.zip", members), tmp_path)
    assert (report.name, report.category, report.has_texture) == ("red", "Scarf", True)
    members["source/model/scarf.mtl"] = "newmtl c\nmap_Kd ../../../../cloth.png\n"
    with pytest.raises(AssetImportError, match="out of its own folder"):
        bring(pack(tmp_path / "out.zip", members), tmp_path)


def test_the_archive_that_a_download_site_packed_again_is_unpacked(tmp_path):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("deep/scarf.obj", SCARF)
    members = {"source/scarf.zip": stream.getvalue(), "textures/readme.txt": "none"}
    assert bring(pack(tmp_path / "site.zip", members), tmp_path).name == "site"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out", "site.zip"]


def test_of_several_meshes_one_is_chosen(tmp_path):
    members = {"a/scarf.obj": SCARF, "b/shawl.obj": SCARF.replace("100", "130")}
    path = pack(tmp_path / "two.zip", members)
    with pytest.raises(UnreadableFileError, match=r"`mesh`: a/scarf.obj, b/shawl.obj"):
        bring(path, tmp_path)
    for wanted in ("b/shawl.obj", "shawl.obj", "shawl"):
        report = bring(path, tmp_path, mesh=wanted, overwrite=True)
        assert report.extent[0] == pytest.approx(1.3, abs=0.01)
        assert report.source_id == "shawl"
    with pytest.raises(UnreadableFileError, match="none of them called 'hat'"):
        bring(path, tmp_path, mesh="hat")


def test_a_folder_of_deep_folders_is_searched_and_key_points_may_lie_on_top(tmp_path):
    folder = tmp_path / "mine"
    (folder / "source").mkdir(parents=True)
    (folder / "source" / "s.obj").write_text(SCARF)
    (folder / "keypoints.json").write_text('{"left_end": 0}')
    report = bring(folder, tmp_path)
    assert (report.name, report.landmarks) == ("mine", ("left_end",))


def test_a_model_of_another_kind_is_named(tmp_path):
    path = pack(tmp_path / "fbx.zip", {"source/shirt.fbx": b"Kaydara"})
    with pytest.raises(UnreadableFileError, match=r"shirt\.fbx is not read, export it as GLB"):
        bring(path, tmp_path)


# Objects


def test_an_object_is_chosen_by_its_name(tmp_path, worn):
    path = write(tmp_path / "pair.obj", ("Avatar", *body()), ("Shirt", worn.vertices, worn.faces))
    with pytest.raises(BrokenMeshError, match=r"`object`: Shirt \(9.*%\), Avatar .* or part1 "):
        bring(path, tmp_path)
    with pytest.raises(UnclearGarmentError, match=r"has no `object` 'Coat'; it has Shirt"):
        bring(path, tmp_path, object="Coat")
    with pytest.raises(UnclearGarmentError, match="2 connected parts"):
        bring(path, tmp_path, object="part3")
    for name in ("Shirt", "Shirt/part1"):
        report = bring(path, tmp_path, object=name, overwrite=True)
        assert report.area == pytest.approx(worn.area, rel=0.02)
        assert any(name.partition("/")[0] in note for note in report.assumptions)


def test_key_points_keep_their_numbers_where_an_object_is_chosen(tmp_path, worn):
    vertices, faces = body()
    path = write(
        tmp_path / "pair.obj", ("Avatar", vertices, faces), ("S", worn.vertices, worn.faces)
    )
    points = {name: len(vertices) + worn.landmarks[name] for name in ("left_cuff", "right_cuff")}
    (tmp_path / "points.json").write_text(json.dumps(points))
    report = bring(path, tmp_path, object="S", keypoints=tmp_path / "points.json")
    found = load_asset(report.folder).get_landmark_positions(("left_cuff", "right_cuff"))
    apart = np.linalg.norm(
        worn.vertices[worn.landmarks["left_cuff"]] - worn.vertices[worn.landmarks["right_cuff"]]
    )
    assert np.linalg.norm(found[0] - found[1]) == pytest.approx(apart, rel=0.01)


def test_groups_and_nodes_have_names(tmp_path, worn):
    lines = ["g hat crown", *to_lines(*body()), "o Shirt", "g front"]
    lines += to_lines(worn.vertices, worn.faces, 1 + len(body()[0]))
    (tmp_path / "groups.obj").write_text("\n".join(lines))
    mesh = read_mesh(tmp_path / "groups.obj")
    assert ("hat crown", "hat", "crown") in mesh.objects
    assert ("Shirt", "front") in mesh.objects
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.Trimesh(*body(), process=False), node_name="Body", geom_name="b")
    shirt = trimesh.Trimesh(worn.vertices, worn.faces, process=False)
    scene.add_geometry(shirt, node_name="Shirt", geom_name="s")
    (tmp_path / "scene.glb").write_bytes(bytes(scene.export(file_type="glb")))
    report = bring(tmp_path / "scene.glb", tmp_path, object="Shirt")
    assert report.area == pytest.approx(worn.area, rel=0.02)


# Cloth on cloth


def sew_on_pocket(shape, *, is_sewn):
    """Cover a patch of the chest with a second layer that bulges, sewn on around it or loose."""
    middle = shape.vertices[shape.faces].mean(axis=1)
    front = middle[:, 2] > np.median(middle[:, 2])
    under = shape.faces[front & (np.hypot(middle[:, 0] - 0.08, middle[:, 1] + 0.02) < 0.07)]
    used, patch = drop_unused(shape.vertices, under)
    edges = compute_edge_table(patch)
    rim = np.unique(edges.pairs[edges.counts == 1])
    points = shape.vertices[used].copy()
    lift = np.full(len(points), 0.01)
    if is_sewn:
        lift[rim] = 0.0
    points[:, 2] += lift
    ids = np.where(np.isin(np.arange(len(used)), rim) & is_sewn, used, len(shape.vertices))
    new = ids == len(shape.vertices)
    ids[new] += np.arange(new.sum())
    return np.concatenate([shape.vertices, points[new]]), np.concatenate([shape.faces, ids[patch]])


@pytest.mark.parametrize("is_sewn", [True, False])
def test_a_pocket_is_dropped_with_a_note(is_sewn, worn):
    vertices, faces = sew_on_pocket(worn, is_sewn=is_sewn)
    counts = compute_edge_table(faces).counts
    assert counts.max() == (3 if is_sewn else 2)
    clean = clean_mesh(RawMesh(vertices=vertices, faces=faces), "pocket")
    assert len(clean.faces) == len(worn.faces)
    assert clean.vertices.max(axis=0)[2] == pytest.approx(worn.vertices.max(axis=0)[2], abs=2e-3)
    assert "pockets" in " ".join(clean.notes)
    # What stays is the cloth below and not the pocket: it is the straighter continuation.
    assert np.allclose(np.sort(clean.vertices[:, 2]), np.sort(worn.vertices[:, 2]))


def test_a_fin_on_an_edge_is_dropped(worn):
    apex = worn.vertices[worn.faces[0]].mean(axis=0) + np.array([0, 0, 0.1])
    faces = np.vstack([worn.faces, [*worn.faces[0, :2], len(worn.vertices)]])
    clean = clean_mesh(RawMesh(vertices=np.vstack([worn.vertices, apex]), faces=faces), "fin")
    assert len(clean.faces) == len(worn.faces)


def test_a_second_layer_as_large_as_the_cloth_is_refused_with_a_way_on(worn):
    other = worn.vertices + np.array([0, 0, 0.3])
    layer = worn.faces + len(worn.vertices)
    layer[layer == len(worn.vertices) + worn.faces[0, 0]] = worn.faces[0, 0]
    layer[layer == len(worn.vertices) + worn.faces[0, 1]] = worn.faces[0, 1]
    raw = RawMesh(vertices=np.vstack([worn.vertices, other]), faces=np.vstack([worn.faces, layer]))
    with pytest.raises(BrokenMeshError, match="choose with `object`"):
        clean_mesh(raw, "twice")


@pytest.mark.parametrize("rim", [True, False])
@pytest.mark.parametrize("thickness", [0.001, 0.005])
@pytest.mark.parametrize("is_inside_out", [True, False])
def test_a_thickness_becomes_its_outer_surface(rim, thickness, is_inside_out, worn):
    vertices, faces = solidify(worn.vertices, worn.faces, thickness, rim=rim)
    if is_inside_out:
        faces = faces[:, [0, 2, 1]]
    clean = clean_mesh(RawMesh(vertices=vertices, faces=faces), "thick")
    kept = np.flatnonzero(clean.vertex_ids >= 0)
    assert np.isin(kept, np.arange(len(worn.vertices))).mean() > 0.99  # those of the outer sheet
    assert len(find_loops(clean.faces)) == 4
    area = trimesh.triangles.area(clean.vertices[clean.faces]).sum()
    assert area == pytest.approx(worn.area, rel=0.01)
    assert any("outer surface" in note or "inner side" in note for note in clean.notes)


def test_two_panels_on_each_other_are_no_thickness():
    ids = np.arange(21 * 11).reshape(11, 21)
    x, y = np.meshgrid(np.arange(21) * 0.05, np.arange(11) * 0.05)
    vertices = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    quads = np.stack([ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]], -1).reshape(-1, 4)
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    both = np.concatenate([vertices, vertices + np.array([0, 0, 0.005])])
    raw = RawMesh(vertices=both, faces=np.concatenate([faces, faces + len(vertices)]))
    with pytest.raises(BrokenMeshError, match="2 loose pieces"):
        clean_mesh(raw, "panels")


def test_what_is_closed_and_thick_is_refused_with_a_way_on(tmp_path):
    write(tmp_path / "ball.obj", ("", *body()))
    with pytest.raises(UnclearGarmentError, match="export its outside alone"):
        bring(tmp_path / "ball.obj", tmp_path, units="m")


# Seams


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        pytest.param("m", 1.0, marks=pytest.mark.slow),
        ("cm", 0.01),
        pytest.param("in", 0.0254, marks=pytest.mark.slow),
    ],
)
def test_seams_that_lie_apart_are_sewn(unit, metres, tmp_path, worn):
    middle = worn.vertices[worn.faces].mean(axis=1)[:, 0]
    part = np.digitize(middle, [-0.25, 0.25])
    pieces = []
    for k in range(3):
        used, faces = drop_unused(worn.vertices, worn.faces[part == k])
        pieces.append(("", (worn.vertices[used] + [0.0004 * (k - 1), 0, 0]) / metres, faces))
    path = write(tmp_path / "loose.obj", *pieces)
    with pytest.raises(
        BrokenMeshError, match=r"joined by `weld`; the first two are \S+ units apart"
    ):
        bring(path, tmp_path)
    report = bring(path, tmp_path, weld=0.0006)
    assert report.unit == metres
    assert report.openings == 4
    assert report.area == pytest.approx(worn.area, rel=0.02)


def test_a_weld_wider_than_the_edges_is_refused(tmp_path, worn):
    path = write(tmp_path / "top.obj", ("", worn.vertices / 10, worn.faces))  # edges of 2 mm
    with pytest.raises(BrokenMeshError, match=r"`weld` of .* would join neighbours"):
        bring(path, tmp_path, units="m", weld=0.005)
    with pytest.raises(ValueError, match="weld"):
        bring(path, tmp_path, weld=0.5)
