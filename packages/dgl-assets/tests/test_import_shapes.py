"""Garments of other programs: the import finds unit, axes and openings, and meshes them evenly."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from dgl_assets.importing import GarmentImportOptions, ImportReport, import_garment, load_asset
from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.openings import check_hollow, name_openings
from dgl_assets.importing.topology import compute_edge_table, compute_normals, find_loops

_SPEC = importlib.util.spec_from_file_location("foreign", Path(__file__).parent / "foreign.py")
foreign = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(foreign)

has_usd = importlib.util.find_spec("pxr") is not None


COARSE = 0.025  # the coarsest there is


def check(report: ImportReport, shape, *, category: str, openings: int, tolerance: float = 0.003):
    """Check an import of a known shape."""
    garment = load_asset(report.folder)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    assert report.category == garment.category == category
    assert report.openings == openings == len(find_loops(garment.faces))
    assert garment.extent == pytest.approx(high - low, rel=0.012, abs=0.003)
    assert garment.area == pytest.approx(shape.area, rel=0.012)
    assert report.even_edges >= 0.99
    assert report.even_angles >= 0.99
    edges = compute_edge_table(garment.faces)
    assert edges.counts.max() == 2
    assert len(np.unique(garment.faces)) == len(garment.vertices)
    # Places are where they are on the original, and left is left.
    expected = shape.vertices - (low + high) / 2
    for name, vertex in garment.landmarks.items():
        off = np.linalg.norm(garment.vertices[vertex] - expected[shape.landmarks[name]])
        assert off < tolerance, (name, off)
    # The surfaces agree, and so do their outsides.
    normals = compute_normals(expected, shape.faces)[0]
    middles = expected[shape.faces].mean(axis=1)
    found = garment.vertices[garment.faces].mean(axis=1)
    distance, _ = KDTree(np.column_stack([middles, 0.03 * normals])).query(
        np.column_stack([found, 0.03 * compute_normals(garment.vertices, garment.faces)[0]])
    )
    assert np.quantile(distance, 0.99) < 0.035  # within a triangle of the original
    return garment


def test_lying_top_as_obj_with_picture(tmp_path):
    shape = foreign.make_lying_top(1)
    vertices = foreign.to_file(shape, unit=1.0, axes=np.eye(3))
    foreign.to_mesh(shape, vertices, texture=True).export(tmp_path / "top.obj")
    report = import_garment(
        tmp_path / "top.obj",
        out=tmp_path / "out",
        options=GarmentImportOptions(spacing=COARSE, licence="CC0"),
    )
    garment = check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.licence == garment.meta["licence"] == "CC0"
    assert any("assumed because" in text for text in report.assumptions)
    assert garment.texture.read_bytes() == (tmp_path / "material_0.png").read_bytes()
    # The colour at each corner is that of the same place of the original.
    u = garment.vertices[garment.faces][..., :2] / 1.3 + 0.5
    assert np.abs(garment.uvs - u).max() < 0.01


def test_worn_top_as_glb_with_picture(tmp_path):
    shape = foreign.make_worn_top(2)
    vertices = foreign.to_file(shape, unit=1.0, axes=foreign.Y_UP)
    (tmp_path / "in").mkdir()
    foreign.to_mesh(shape, vertices, texture=True).export(tmp_path / "in" / "mesh.glb")
    foreign.save_keypoints(tmp_path / "in" / "keypoints.json", shape)
    report = import_garment(
        tmp_path / "in", out=tmp_path / "out", options=GarmentImportOptions(spacing=0.02)
    )
    garment = check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.unit == 1.0
    assert report.up == "y"
    assert len(report.landmarks) == len(shape.landmarks)
    assert any("lay it flat" in text for text in report.assumptions)
    with Image.open(garment.texture) as picture:
        assert np.array_equal(np.asarray(picture)[..., :3], np.asarray(foreign.paint()))


def test_worn_top_in_millimetres_as_ply(tmp_path):
    shape = foreign.make_worn_top(3)
    vertices = foreign.to_file(shape, unit=0.001, axes=foreign.Y_UP)
    foreign.to_mesh(shape, vertices).export(tmp_path / "top.ply")
    points = foreign.save_keypoints(tmp_path / "points.json", shape, vertices)
    report = import_garment(
        tmp_path / "top.ply",
        out=tmp_path / "out",
        options=GarmentImportOptions(spacing=COARSE, keypoints=points),
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.unit == 0.001
    assert report.up == "y"


def test_worn_top_in_centimetres_as_triangle_soup(tmp_path):
    shape = foreign.make_worn_top(4)
    vertices = foreign.to_file(shape, unit=0.01, axes=foreign.Z_UP)
    foreign.to_mesh(shape, vertices).export(tmp_path / "top.stl")
    report = import_garment(
        tmp_path / "top.stl", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.unit == 0.01
    assert report.up == "z"
    assert any("welded" in text for text in report.assumptions)


def test_worn_top_in_inches_with_x_up(tmp_path):
    shape = foreign.make_worn_top(5)
    vertices = foreign.to_file(shape, unit=0.0254, axes=foreign.X_UP)
    foreign.to_mesh(shape, vertices).export(tmp_path / "top.obj")
    points = foreign.save_keypoints(tmp_path / "points.json", shape)
    report = import_garment(
        tmp_path / "top.obj",
        out=tmp_path / "out",
        options=GarmentImportOptions(spacing=COARSE, keypoints=points),
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.unit == 0.0254
    assert report.up == "x"


def test_lying_top_as_text_stl(tmp_path):
    shape = foreign.make_lying_top(6)
    vertices = foreign.to_file(shape, unit=0.001, axes=foreign.LIES_Y_UP)
    foreign.to_mesh(shape, vertices).export(tmp_path / "top.stl", file_type="stl_ascii")
    report = import_garment(
        tmp_path / "top.stl", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.up == "y"


def test_top_of_two_nodes_inside_out_in_millimetres(tmp_path):
    """GLB is in metres by its standard; this one says so too, and is not."""
    shape = foreign.make_worn_top(7)
    vertices = foreign.to_file(shape, unit=0.001, axes=foreign.Y_UP)
    inward = shape.faces[:, ::-1]
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [50, 0, 0])
    is_left = vertices[inward].mean(axis=1)[:, 0] < 0
    for faces, pose in ((inward[is_left], np.eye(4)), (inward[~is_left], turn)):
        part = trimesh.Trimesh(vertices, faces, process=False)
        part.remove_unreferenced_vertices()
        part.apply_transform(np.linalg.inv(pose))
        scene.add_geometry(part, transform=pose)
    scene.export(tmp_path / "parts.glb")
    report = import_garment(
        tmp_path / "parts.glb", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.unit == 0.001
    assert any("by the file's own unit, is not" in text for text in report.assumptions)
    assert any("turned over" in text for text in report.assumptions)


def test_text_gltf_with_files_beside(tmp_path):
    shape = foreign.make_lying_top(8)
    vertices = foreign.to_file(shape, unit=1.0, axes=foreign.LIES_Y_UP)
    for name, data in (
        foreign.to_mesh(shape, vertices, texture=True).export(file_type="gltf").items()
    ):
        (tmp_path / name).write_bytes(data)
    report = import_garment(
        tmp_path / "model.gltf",
        out=tmp_path / "out",
        options=GarmentImportOptions(spacing=COARSE, name="my top"),
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    assert report.name == "my_top"
    assert report.has_texture


@pytest.mark.skipif(not has_usd, reason="usd-core is not installed")
@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_usd_in_centimetres_as_in_clothesnet(tmp_path, suffix):
    shape = foreign.make_worn_top(9)
    folder = tmp_path / "Tops" / "NoCollar_Lsleeve_FrontClose" / "TNLC_Top099"
    folder.mkdir(parents=True)
    path = folder / f"TNLC_Top099_obj{suffix}"
    vertices = foreign.to_file(shape, unit=0.01, axes=foreign.Y_UP)
    foreign.save_usd(path, shape, vertices, unit=0.01, up="Y")
    report = import_garment(path, out=tmp_path / "out", options=GarmentImportOptions(spacing=0.016))
    smaller = foreign.Shape(vertices=0.85 * shape.vertices, faces=shape.faces)
    check(report, smaller, category="Tops_LongSleeve", openings=4)
    assert report.scale == pytest.approx(0.0085)
    assert report.subtype == "no collar, long sleeves, closed front"
    assert report.source == "ClothesNet"
    assert "research only" in report.licence


def test_top_at_an_angle(tmp_path):
    shape = foreign.make_worn_top(10)
    turn = Rotation.from_euler("xyz", [35, 20, 50], degrees=True).as_matrix()
    foreign.to_mesh(shape, foreign.to_file(shape, unit=1.0, axes=turn)).export(tmp_path / "t.ply")
    report = import_garment(
        tmp_path / "t.ply", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    assert report.area == pytest.approx(shape.area, rel=0.01)
    assert report.extent == pytest.approx(np.ptp(shape.vertices, axis=0), rel=0.06)


def test_archive_with_buttons_faults_key_points_and_licence(tmp_path):
    shape = foreign.make_worn_top(11)
    vertices, faces = foreign.to_file(shape, unit=0.01, axes=foreign.Z_UP), shape.faces
    buttons = [trimesh.creation.icosphere(1, radius=0.5) for _ in range(3)]
    for number, button in enumerate(buttons):
        button.apply_translation([0, -20, 8 * number])
    whole = trimesh.util.concatenate([trimesh.Trimesh(vertices, faces, process=False), *buttons])
    faces = np.asarray(whole.faces)
    turned = faces[:5, ::-1]
    doubled, thin = faces[100:103], faces[50:51, [0, 1, 0]]
    faces = np.concatenate([turned, faces[5:], doubled, thin])
    text = "\n".join(
        [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in whole.vertices]
        + [f"f {a} {b} {c}" for a, b, c in faces + 1]
    )
    files = {
        "shirt/mesh.obj": text.encode(),
        "shirt/keypoints.json": json.dumps({"keypoints": shape.landmarks}).encode(),
        "shirt/meta.json": b'{"category": "Tops_LongSleeve", "license": "CC-BY-4.0", '
        b'"source": "a friend"}',
    }
    archive = foreign.save_zip(tmp_path / "shirt.zip", files)
    report = import_garment(
        archive, out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    check(report, shape, category="Tops_LongSleeve", openings=4)
    said = "; ".join(report.assumptions)
    assert "3 loose pieces" in said
    assert "5 faces were turned over" in said
    assert "3 faces that were there twice" in said
    assert "1 faces with two corners in one" in said
    assert (report.licence, report.source) == ("CC-BY-4.0", "a friend")


@pytest.mark.parametrize(
    ("make", "category", "openings"),
    [
        (foreign.make_trousers, "Trousers", 3),
        pytest.param(foreign.make_dress, "Dress_LongSleeve", 4, marks=pytest.mark.slow),
        (foreign.make_vest, "Tops_NoSleeve", 4),
    ],
)
def test_quads_by_hand_of_other_categories(tmp_path, make, category, openings):
    vertices, quads = make()
    path = foreign.save_quads(tmp_path / "thing.obj", vertices * 100, quads)
    report = import_garment(path, out=tmp_path / "out", options=GarmentImportOptions(spacing=0.02))
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    shape = foreign.Shape(vertices=vertices, faces=triangles)
    check(report, shape, category=category, openings=openings)
    assert report.unit == 0.01
    assert any("polygons of more than three corners" in text for text in report.assumptions)


def test_coat_opens_in_front(tmp_path):
    shape = foreign.make_coat(12)
    turned = shape.vertices * [-1, 1, -1]  # its back is towards +z in the file
    foreign.to_mesh(shape, turned * 1000).export(tmp_path / "coat.ply")
    report = import_garment(
        tmp_path / "coat.ply", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    check(report, shape, category="Tops_FrontOpen", openings=3)
    assert "front where it opens" in report.assumptions


def test_scarf_of_two_triangles(tmp_path):
    (tmp_path / "scarf.obj").write_text(
        "v 0 0 0\nv 0 140 0\nv 30 140 0\nv 30 0 0\nf 1 2 3 4\n", encoding="utf-8"
    )
    report = import_garment(
        tmp_path / "scarf.obj", out=tmp_path / "out", options=GarmentImportOptions(spacing=COARSE)
    )
    assert report.category == "Scarf"
    assert report.extent == pytest.approx((1.4, 0.3, 0.0), abs=1e-6)
    garment = load_asset(report.folder)
    assert (compute_normals(garment.vertices, garment.faces)[0][:, 2] > 0.99).all()


@pytest.mark.parametrize(("slope", "is_hat"), [(0.0, False), (0.45, False), (0.47, True)])
def test_a_sheet_is_no_hat(slope, is_hat):
    """The side of a cone is sqrt(1 + slope^2) as large as its base: 1.1 at a slope of 0.458."""
    angles = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(400)])
    vertices = np.vstack([[0, 0, slope], rim])
    steps = np.arange(400)
    faces = np.column_stack([np.zeros(400, int), 1 + steps, 1 + (steps + 1) % 400])
    openings = name_openings(vertices, find_loops(faces), "Bowl_Hat")
    if is_hat:
        check_hollow(vertices, faces, openings, "Bowl_Hat")
    else:
        with pytest.raises(UnclearGarmentError, match="a Bowl_Hat is hollow; this is a flat sheet"):
            check_hollow(vertices, faces, openings, "Bowl_Hat")
    check_hollow(vertices, faces, openings, "Scarf")


def test_a_sheet_of_two_triangles_is_no_hat_of_a_file(tmp_path):
    file = tmp_path / "two.obj"
    file.write_text("v 0 0 0\nv 0.2 0 0\nv 0.2 0.2 0\nv 0 0.2 0.05\nf 1 2 3\nf 1 3 4\n")
    with pytest.raises(UnclearGarmentError, match=r"two\.obj: a Bowl_Hat is hollow"):
        import_garment(
            file, out=tmp_path / "out", options=GarmentImportOptions(category="Bowl_Hat")
        )
    assert not (tmp_path / "out").exists()


def test_hat_stands_on_its_rim(tmp_path):
    vertices, faces = foreign.make_bowl(9.0)
    hat = trimesh.Trimesh(vertices @ foreign.Z_UP, faces, process=False)  # y up
    hat.export(tmp_path / "bowl.ply")
    report = import_garment(
        tmp_path / "bowl.ply",
        out=tmp_path / "out",
        lay_flat=lambda vertices, faces, rest: vertices * [1, 1, 0.1],
        options=GarmentImportOptions(category="Bowl_Hat", units="cm", spacing=0.012),
    )
    garment = load_asset(report.folder)
    assert not report.is_laid_flat
    assert "not laid flat: a Bowl_Hat keeps its shape" in report.assumptions
    assert report.up == "y"
    rim = find_loops(garment.faces)[0]
    assert garment.vertices[rim, 2] == pytest.approx(garment.vertices[:, 2].min(), abs=1e-3)
    assert report.extent == pytest.approx((0.18, 0.18, 0.0836), abs=0.004)
    assert garment.wall_thickness == 0.003
