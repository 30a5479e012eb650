"""The stages of an import one by one, and that an asset appears whole or not at all."""

import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from dgl_assets import AssetNotFoundError, Sleeve, TopParameters, make_garment
from dgl_assets.importing import (
    AssetImportError,
    BrokenMeshError,
    GarmentImportOptions,
    UnclearGarmentError,
    UnreadableFileError,
    import_garment,
    importer,
    list_models,
    load_asset,
)
from dgl_assets.importing.check import clean_mesh
from dgl_assets.importing.clothesnet import read_clothesnet_name
from dgl_assets.importing.curves import find_curves
from dgl_assets.importing.holes import close_small_holes
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.read import read_mesh
from dgl_assets.importing.remesh import remesh_surface
from dgl_assets.importing.report import measure_evenness
from dgl_assets.importing.scale import find_unit
from dgl_assets.importing.surface import SurfaceIndex
from dgl_assets.importing.topology import compute_edge_table, find_loops

_SPEC = importlib.util.spec_from_file_location("foreign", Path(__file__).parent / "foreign.py")
foreign = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(foreign)

SCARF = "v 0 0 0\nv 100 0 0\nv 100 20 0\nv 0 20 0\nf 1 2 3 4\n"


@pytest.fixture
def scarf(tmp_path):
    path = tmp_path / "in" / "scarf.obj"
    path.parent.mkdir()
    path.write_text(SCARF)
    return path


def bring(path, tmp_path, lay_flat=None, **options):
    options = GarmentImportOptions(spacing=0.025, **options)
    return import_garment(path, out=tmp_path / "out", options=options, lay_flat=lay_flat)


def sheet(columns: int, rows: int, cell: float) -> tuple[np.ndarray, np.ndarray]:
    row, column = np.divmod(np.arange((rows + 1) * (columns + 1)), columns + 1)
    vertices = np.column_stack([column * cell, row * cell, 0.0 * row])
    a = np.flatnonzero((row < rows) & (column < columns))
    b, c, d = a + 1, a + columns + 1, a + columns + 2
    return vertices, np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])


# Surface and remeshing


def test_nearest_place_is_that_of_brute_force():
    rng = np.random.default_rng(0)
    vertices, faces = sheet(6, 4, 0.05)
    vertices[:, 2] = 0.03 * np.sin(20 * vertices[:, 0])
    surface = SurfaceIndex(vertices, faces, spacing=0.006)
    points = rng.uniform([0, 0, -0.05], [0.3, 0.2, 0.05], (60, 3))
    found = surface.evaluate(*surface.locate(points))
    i, j = np.meshgrid(np.linspace(0, 1, 60), np.linspace(0, 1, 60))
    inside = i + j <= 1
    weights = np.column_stack([1 - i[inside] - j[inside], i[inside], j[inside]])
    dense = (weights @ vertices[faces]).reshape(-1, 3)
    best = np.linalg.norm(dense[None] - points[:, None], axis=2).min(axis=1)
    assert np.linalg.norm(found - points, axis=1) == pytest.approx(best, abs=5e-4)


def test_normals_keep_layers_apart_that_touch():
    vertices, faces = sheet(10, 10, 0.02)
    both = np.concatenate([faces, faces[:, ::-1] + len(vertices)])
    surface = SurfaceIndex(np.concatenate([vertices, vertices]), both, spacing=0.006)
    points = vertices[12:100:7] + np.array([0.003, 0.002, 0])
    for sign, low, high in ((1, 0, len(faces)), (-1, len(faces), 2 * len(faces))):
        found, _ = surface.locate(points, np.tile([0.0, 0, sign], (len(points), 1)))
        assert np.all((found >= low) & (found < high))


@pytest.mark.parametrize("spacing", [0.01, 0.02])
def test_remeshing_a_sheet_keeps_outline_corners_and_pins(spacing):
    vertices, faces = sheet(3, 2, 0.1)
    pins = np.array([[0.13, 0.08, 0], [0.2, 0.0, 0], [0.3, 0.2, 0]])
    up = np.tile([0.0, 0, 1], (3, 1))
    mesh = remesh_surface(vertices, faces, spacing=spacing, pins=pins, pin_normals=up)
    assert mesh.vertices[mesh.pins] == pytest.approx(pins, abs=1e-9)
    for corner in ([0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0], [0, 0.2, 0]):
        assert np.linalg.norm(mesh.vertices - corner, axis=1).min() < 1e-9
    (loop,) = find_loops(mesh.faces)
    rim = mesh.vertices[loop]
    on_side = np.isclose(rim[:, 0] * (rim[:, 0] - 0.3), 0) | np.isclose(
        rim[:, 1] * (rim[:, 1] - 0.2), 0
    )
    assert on_side.all()
    even_edges, even_angles = measure_evenness(mesh.vertices, mesh.faces, spacing=spacing)
    assert even_edges >= 0.99
    assert even_angles == 1.0
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    assert normals[:, 2].sum() / 2 == pytest.approx(0.06, rel=1e-9)


def test_a_finer_mesh_is_coarsened_and_is_the_same_each_time():
    vertices, faces = sheet(45, 30, 0.006)
    first, second = (remesh_surface(vertices, faces, spacing=0.02) for _ in range(2))
    assert len(first.vertices) < len(vertices) / 8
    assert np.array_equal(first.vertices, second.vertices)
    assert min(measure_evenness(first.vertices, first.faces, spacing=0.02)) > 0.99


def test_curves_are_rims_and_folds_with_corners():
    vertices, faces = sheet(10, 10, 0.02)
    vertices[vertices[:, 0] > 0.101, 2] = vertices[vertices[:, 0] > 0.101, 0] - 0.1
    vertices[vertices[:, 0] > 0.101, 0] = 0.1  # folded up by a right angle
    curves = find_curves(vertices, faces, spacing=0.02)
    fixed = vertices[curves.fixed]
    assert len(fixed) == 6  # four corners, and where the fold meets the rim
    assert len(np.unique(curves.labels)) == 7


def test_an_opening_narrower_than_the_spacing_stays_open():
    vertices, faces = sheet(50, 20, 0.008)
    faces = faces[~np.isin(np.tile(np.arange(1000), 2), [525])]
    mesh = remesh_surface(vertices, faces, spacing=0.02)
    assert len(find_loops(faces)) == len(find_loops(mesh.faces)) == 2


# Checks and repairs


def test_soup_is_welded_into_the_mesh_that_it_came_from():
    vertices, faces = sheet(8, 5, 0.1)
    noise = np.random.default_rng(0).uniform(-1e-6, 1e-6, (3 * len(faces), 3))
    soup = RawMesh(
        vertices=vertices[faces.ravel()] + noise, faces=np.arange(3 * len(faces)).reshape(-1, 3)
    )
    clean = clean_mesh(soup, "soup")
    assert len(clean.vertices) == len(vertices)
    assert (compute_edge_table(clean.faces).counts == 1).sum() == 2 * (8 + 5)
    assert clean.vertices[clean.vertex_ids] == pytest.approx(soup.vertices, abs=5e-6)


def test_layers_that_touch_are_not_welded():
    vertices, faces = sheet(20, 8, 0.1)
    row, column = np.divmod(np.arange(len(vertices)), 21)
    is_seam = (column == 0) | (column == 20)
    other = np.where(is_seam, np.arange(len(vertices)), len(vertices) + np.arange(len(vertices)))
    both = np.concatenate([faces, other[faces][:, ::-1]])
    lower = vertices.copy()
    lower[:, 2] = np.where((row == 0) | (row == 8), -0.02, -1e-9)  # its openings are open
    bag = RawMesh(vertices=np.concatenate([vertices, lower]), faces=both)
    clean = clean_mesh(bag, "bag")
    assert len(find_loops(clean.faces)) == 2
    inner = (~is_seam).sum()
    assert len(clean.vertices) == is_seam.sum() + 2 * inner


def test_faces_that_hang_together_at_a_point_are_separated():
    vertices, faces = sheet(6, 6, 0.1)
    keep = np.ones(len(faces), dtype=bool)
    cell = np.tile(np.arange(36), 2)
    keep[np.isin(cell, [14, 21])] = False  # two holes that touch at a corner
    clean = clean_mesh(RawMesh(vertices=vertices, faces=faces[keep]), "sheet")
    assert len(find_loops(clean.faces)) in (2, 3)
    assert "only touch were separated" in " ".join(clean.notes)


def test_corners_where_both_layers_are_one_face_are_dropped():
    vertices, faces = sheet(8, 5, 0.1)
    row, column = np.divmod(np.arange(len(vertices)), 9)
    is_seam = (column == 0) | (column == 8) | (row == 5)
    other = np.where(is_seam, np.arange(len(vertices)), len(vertices) + np.arange(len(vertices)))
    lower = vertices - np.array([0, 0, 0.01])
    both = np.concatenate([faces, other[faces][:, ::-1]])
    bag = RawMesh(vertices=np.concatenate([vertices, lower]), faces=both)
    clean = clean_mesh(bag, "bag")
    assert len(clean.faces) == 2 * len(faces) - 2
    assert "1 corners where both layers" in " ".join(clean.notes)
    assert compute_edge_table(clean.faces).counts.max() == 2


def test_few_faces_without_area_are_remeshed_away(tmp_path):
    vertices, faces = sheet(60, 12, 2.0)
    a, b, c = faces[200]
    middle = len(vertices)
    faces = np.concatenate(
        [np.delete(faces, 200, axis=0), [[a, middle, c], [middle, b, c], [a, b, middle]]]
    )
    vertices = np.concatenate([vertices, [(vertices[a] + vertices[b]) / 2]])
    lines = [f"v {x} {y} {z}" for x, y, z in vertices] + [f"f {i} {j} {k}" for i, j, k in faces + 1]
    (tmp_path / "scarf.obj").write_text("\n".join(lines))
    report = bring(tmp_path / "scarf.obj", tmp_path)
    assert report.even_angles == 1.0


def test_small_holes_are_closed_and_keep_the_texture():
    vertices, faces = sheet(10, 10, 0.01)
    uvs = vertices[faces][..., :2]
    hole = np.isin(np.tile(np.arange(100), 2), [44])
    points, closed, coordinates, count = close_small_holes(
        vertices, faces[~hole], uvs[~hole], largest=0.05
    )
    assert count == 1
    assert len(find_loops(closed)) == 1
    assert coordinates == pytest.approx(points[closed][..., :2], abs=1e-12)


def test_narrow_cuffs_are_no_holes(tmp_path):
    top = make_garment(TopParameters(sleeve=Sleeve(cuff_width=0.06)), spacing=0.02)
    lines = [f"v {x} {y} {z}" for x, y, z in top.vertices] + [
        f"f {i} {j} {k}" for i, j, k in top.faces + 1
    ]
    (tmp_path / "top.obj").write_text("\n".join(lines))
    report = bring(tmp_path / "top.obj", tmp_path)
    assert report.openings == len(find_loops(load_asset(report.folder).faces)) == 4


# Units, names, options


@pytest.mark.parametrize("unit", ["m", "cm", "mm", "in"])
def test_units_are_told_apart_by_size(unit):
    metres = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}[unit]
    for size in (0.38, 0.6, 0.88):
        found, how = find_unit(size / metres, "Tops_NoSleeve", units=None, declared=None)
        assert found == metres
        assert "could be" not in how


@pytest.mark.parametrize(
    ("longest", "trunk", "metres", "other"),
    [(65, 41, 0.01, "1.65 m in in"), (48, 22, 0.0254, "0.48 m in cm"), (110, 55, 0.01, "")],
)
def test_where_sleeves_may_be_short_the_trunk_tells_the_unit(longest, trunk, metres, other):
    found, how = find_unit(longest, "Tops_LongSleeve", units=None, declared=None, trunk=trunk)
    assert found == metres
    assert ("could be" in how) == bool(other)
    assert other in how


def test_a_stated_unit_counts_if_it_is_plausible():
    assert find_unit(110, "Tops_LongSleeve", units=None, declared=0.01)[0] == 0.01
    found, how = find_unit(110, "Tops_LongSleeve", units=None, declared=1.0)
    assert found == 0.01
    assert "by the file's own unit, is not" in how
    assert find_unit(110, "Tops_LongSleeve", units="mm", declared=1.0)[0] == 0.001


@pytest.mark.parametrize(
    ("name", "category", "subtype"),
    [
        ("TNLC_Top001_obj.usd", "Tops_LongSleeve", "no collar, long sleeves, closed front"),
        ("TCNC_Top002.obj", "Tops_NoSleeve", "collar, no sleeves, closed front"),
        ("THLO_model.obj", "Tops_FrontOpen", "hood, long sleeves, open front"),
        ("TNSC_x.obj", None, "no collar, short sleeves, closed front"),
        ("DSSS_Dress1.obj", "Dress_LongSleeve", "short dress, short sleeves"),
        ("PL_Pants052.usd", "Trousers", "long trousers"),
        ("HA_Hat044.usd", None, "hat"),
        ("GL_Gloves068.usd", "Glove", "glove"),
    ],
)
def test_clothesnet_codes(name, category, subtype):
    found = read_clothesnet_name(Path("root") / "Any" / "model" / name)
    assert (found.category, found.subtype) == (category, subtype)


def test_other_names_are_no_codes():
    assert read_clothesnet_name(Path("shirts") / "TOP_1.obj") is None


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("category", "Socks"),
        ("units", "feet"),
        ("up", "w"),
        ("spacing", 0.1),
        ("scale", 0.0),
        ("name", "///"),
    ],
)
def test_wrong_options_are_value_errors(scarf, tmp_path, option, value):
    with pytest.raises(ValueError, match=option):
        import_garment(scarf, out=tmp_path / "out", options=GarmentImportOptions(**{option: value}))
    assert not (tmp_path / "out").exists()


def test_a_garment_with_other_openings_than_its_category_is_refused(scarf, tmp_path):
    with pytest.raises(UnclearGarmentError, match=r"a Trousers has 3 openings .* this has 1"):
        bring(scarf, tmp_path, category="Trousers", units="cm")


def test_usd_without_its_library_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    (tmp_path / "a.usda").write_text("#usda 1.0\n")
    with pytest.raises(UnreadableFileError, match=r"uv sync --all-packages --extra usd"):
        read_mesh(tmp_path / "a.usda")


def test_a_file_beyond_the_limit_is_not_opened(tmp_path):
    with (tmp_path / "big.obj").open("wb") as file:
        file.truncate(300 * 2**20)  # sparse
    with pytest.raises(UnreadableFileError, match="at most 268,435,456 are read"):
        read_mesh(tmp_path / "big.obj")


def test_an_obj_cut_after_its_last_vertex_line_is_still_whole(tmp_path):
    """Without the final newline nothing is missing: many programs write no newline there."""
    (tmp_path / "a.obj").write_text(SCARF.rstrip("\n"))
    assert len(read_mesh(tmp_path / "a.obj").faces) == 2


def test_models_below_a_folder_are_listed(tmp_path):
    for name in ("a/one.obj", "b/mesh.ply", "c/deep/three.STL", "__MACOSX/a.obj"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(SCARF)
    (tmp_path / "b" / "meta.json").write_text("{}")
    found = [str(path.relative_to(tmp_path)) for path in list_models(tmp_path)]
    assert found == ["a/one.obj", "b", "c/deep/three.STL"]


# Whole or not at all


def test_the_asset_folder_is_what_it_says(scarf, tmp_path):
    report = bring(scarf, tmp_path, licence="CC0", source="me", name="red scarf")
    assert report.folder == tmp_path / "out" / "Scarf" / "red_scarf"
    assert sorted(path.name for path in report.folder.iterdir()) == [
        "keypoints.json",
        "mesh.obj",
        "meta.json",
    ]
    meta = json.loads((report.folder / "meta.json").read_text())
    assert (meta["category"], meta["licence"], meta["source"]) == ("Scarf", "CC0", "me")
    assert meta["source_id"] == "scarf"
    assert meta["vertex_count"] == report.vertex_count
    assert meta["scale"] == 0.01
    assert (report.folder / "mesh.obj").stat().st_mode & 0o044 == 0o044


def test_names_keep_the_letters_of_any_alphabet():
    kept = ("衬衫", "chemise-é", "платье_2", "قميص", "साड़ी", "เสื้อ", "a__b", "Tops-1")
    assert [importer.make_asset_name(name) for name in kept] == list(kept)
    changed = {"red scarf": "red_scarf", "a/../b": "a_b", "red\udcff": "red", "e\u0301": "é"}
    assert {name: importer.make_asset_name(name) for name in changed} == changed
    for name in ("", "!?", "..", "\u0301"):
        with pytest.raises(ValueError, match="letters or digits"):
            importer.make_asset_name(name)


def test_long_names_stay_different_and_short_enough_for_a_folder():
    names = {importer.make_asset_name("衬" * 200 + end) for end in "ab"}
    assert len(names) == 2
    assert max(len(name.encode()) for name in names) <= 120


def test_names_that_are_not_latin_become_folders(tmp_path):
    for name in ("衬衫", "chemise-é"):
        (tmp_path / f"{name}.obj").write_text(SCARF)
        report = bring(tmp_path / f"{name}.obj", tmp_path)
        assert report.folder.name == name
        assert load_asset(report.folder).name == name


def test_an_asset_can_be_imported_again(scarf, tmp_path):
    first = bring(scarf, tmp_path, licence="CC0")
    again = import_garment(
        first.folder, out=tmp_path / "again", options=GarmentImportOptions(spacing=0.02)
    )
    assert again.licence == "CC0"
    assert again.extent == pytest.approx(first.extent, abs=1e-6)


def test_an_asset_is_not_overwritten_unasked(scarf, tmp_path):
    report = bring(scarf, tmp_path)
    before = (report.folder / "mesh.obj").read_bytes()
    with pytest.raises(
        AssetImportError, match="exists; choose another `name`, or replace it: `overwrite`"
    ):
        bring(scarf, tmp_path)
    assert (report.folder / "mesh.obj").read_bytes() == before
    bring(scarf, tmp_path, overwrite=True, licence="CC0")
    assert load_asset(report.folder).meta["licence"] == "CC0"
    assert [path.name for path in report.folder.parent.iterdir()] == ["scarf"]


def test_what_is_no_asset_is_never_overwritten(scarf, tmp_path):
    precious = tmp_path / "out" / "Scarf" / "scarf"
    precious.mkdir(parents=True)
    (precious / "thesis.txt").write_text("mine")
    with pytest.raises(AssetImportError, match="is no asset"):
        bring(scarf, tmp_path, overwrite=True)
    assert (precious / "thesis.txt").read_text() == "mine"


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError("disk full"), RuntimeError])
def test_an_interrupted_write_leaves_nothing(scarf, tmp_path, monkeypatch, error):
    def stop(folder, **files):
        (folder / "mesh.obj").write_text("half")
        raise error

    monkeypatch.setattr(importer, "write_asset", stop)
    expected = AssetImportError if isinstance(error, OSError) else error
    with pytest.raises(expected):
        bring(scarf, tmp_path)
    assert not (tmp_path / "out").exists()


def test_an_interrupted_overwrite_keeps_the_old_asset(scarf, tmp_path, monkeypatch):
    report = bring(scarf, tmp_path, licence="CC0")

    def stop(folder, **files):
        raise KeyboardInterrupt

    monkeypatch.setattr(importer, "write_asset", stop)
    with pytest.raises(KeyboardInterrupt):
        bring(scarf, tmp_path, overwrite=True)
    assert load_asset(report.folder).meta["licence"] == "CC0"
    assert [path.name for path in report.folder.parent.iterdir()] == ["scarf"]


def test_out_that_is_a_file_is_refused(scarf, tmp_path):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(AssetImportError, match="cannot be written"):
        bring(scarf, tmp_path)
    assert (tmp_path / "out").read_text() == "a file"


def test_laying_flat_keeps_the_shape_it_came_in_as_rest(scarf, tmp_path):
    def roll(vertices, faces, rest):
        angle = vertices[:, 0] / 0.3
        return np.column_stack([0.3 * np.sin(angle), vertices[:, 1], 0.3 * np.cos(angle)])

    report = bring(scarf, tmp_path, lay_flat=roll)
    garment = load_asset(report.folder)
    assert report.is_laid_flat
    assert (report.folder / "rest.obj").is_file()
    assert np.ptp(garment.rest_vertices[:, 2]) < 1e-6 < np.ptp(garment.vertices[:, 2])
    assert (report.area, garment.area) == pytest.approx((0.2, 0.2), rel=1e-4)


@pytest.mark.parametrize(
    ("answer", "error", "message"),
    [
        (lambda v, f, r: v[:-1], ValueError, "lay_flat must return"),
        (lambda v, f, r: v * np.nan, ValueError, "lay_flat must return"),
        (lambda v, f, r: v * 1.3, BrokenMeshError, "mean strain of 30.0%"),
    ],
)
def test_a_bad_simulation_is_noticed(scarf, tmp_path, answer, error, message):
    with pytest.raises(error, match=message):
        bring(scarf, tmp_path, lay_flat=answer)
    assert not (tmp_path / "out").exists()


def test_loading_refuses_what_is_broken(scarf, tmp_path):
    with pytest.raises(AssetNotFoundError, match=r"expected meta\.json"):
        load_asset(tmp_path)
    folder = bring(scarf, tmp_path).folder
    for name, text in (
        ("keypoints.json", '{"end": 99999}'),
        ("keypoints.json", '{"end": "far"}'),
        ("keypoints.json", "{"),
        ("meta.json", "[]"),
        ("mesh.obj", "v 0 0 0\n"),
    ):
        before = (folder / name).read_text()
        (folder / name).write_text(text)
        with pytest.raises(AssetImportError):
            load_asset(folder)
        (folder / name).write_text(before)
    (folder / "keypoints.json").write_text('{"left_end": 3}')  # edited by the user
    garment = load_asset(folder)
    assert garment.get_landmark_positions(("left_end",)).shape == (1, 3)
    with pytest.raises(KeyError, match="right_end"):
        garment.get_landmark_positions(("right_end",))
