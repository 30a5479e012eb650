"""Pictures of garments."""

import numpy as np
import pytest
from PIL import Image

from dgl_assets import draw_contact_sheet, draw_garment, save_picture
from dgl_assets.garments.meshing import compute_vertex_normals
from dgl_assets.garments.view import project
from dgl_assets.materials import sample_fabric_material

FABRIC = sample_fabric_material(0, weaves=["jersey"]).render(128)


def _is_background(picture: np.ndarray) -> np.ndarray:
    return (
        np.abs(picture.astype(int) - picture[0, 0].astype(int)).max(axis=2) < 20
    )  # resampling rings a little


def test_a_picture_shows_the_garment_where_it_lies(pairs):
    garment = pairs["Trousers"][0]
    picture = draw_garment(garment, fabric=FABRIC, size=160)
    assert picture.shape == (160, 160, 3)
    assert picture.dtype == np.uint8
    rows, columns = np.nonzero(~_is_background(picture))
    drawn = np.array([np.ptp(columns) + 1, np.ptp(rows) + 1])
    assert drawn.max() == pytest.approx(160 * 0.88, abs=3)
    aspect = garment.extent[0] / garment.extent[1]
    assert drawn[0] / drawn[1] == pytest.approx(aspect, rel=0.06)
    # Legs point down: the picture is wide at the waist's row and has a gap between the legs below.
    low = ~_is_background(picture)[rows.max() - 12]
    assert np.count_nonzero(np.diff(low.astype(int)) == 1) == 2


def test_landmarks_are_marked_only_when_asked(pairs):
    garment = pairs["Scarf"][0]
    plain, marked = (
        draw_garment(garment, fabric=FABRIC, size=96, has_landmarks=mark) for mark in (False, True)
    )
    assert not np.array_equal(plain, marked)


@pytest.mark.parametrize("category", ["Baseball_Cap", "Bowl_Hat", "Glove"])
def test_shells_are_seen_obliquely(pairs, category):
    """From above only the top of a hat would be seen: its picture shows width, height and shade."""
    garment = pairs[category][0]
    picture = draw_garment(garment, fabric=FABRIC, size=160)
    is_drawn = ~_is_background(picture)
    rows, columns = np.nonzero(is_drawn)
    assert max(np.ptp(columns), np.ptp(rows)) + 1 == pytest.approx(160 * 0.88, abs=3)
    grey = picture[is_drawn].mean(axis=1)
    assert np.quantile(grey, 0.95) > 1.2 * np.quantile(grey, 0.1)
    view = project(garment)
    edges = garment.faces[:, [0, 1]]
    lengths = [
        np.linalg.norm(p[edges[:, 1]] - p[edges[:, 0]], axis=1) for p in (view, garment.vertices)
    ]
    assert np.allclose(*lengths, atol=1e-6)
    normals = compute_vertex_normals(view, garment.faces)
    top = {"Glove": "back_centre"}.get(category, "crown_top")
    assert normals[garment.landmarks[top], 2] > 0.3  # towards the viewer


def test_names_are_written_beside_landmarks(pairs):
    garment = pairs["Glove"][0]
    marked, named = (
        draw_garment(garment, fabric=FABRIC, size=300, has_landmarks=True, has_names=names)
        for names in (False, True)
    )
    assert np.count_nonzero((marked != named).any(axis=2)) > 500


def test_a_sheet_has_a_cell_for_each_garment_and_is_reproducible(pairs):
    garments = [*pairs["Scarf"][:2], pairs["Glove"][0]]
    sheet = draw_contact_sheet(garments, columns=2, size=64, seed=5)
    assert sheet.shape == (128, 128, 3)
    cells = [sheet[r : r + 64, c : c + 64] for r in (0, 64) for c in (0, 64)]
    assert [not _is_background(cell).all() for cell in cells] == [True, True, True, False]
    assert np.array_equal(sheet, draw_contact_sheet(garments, columns=2, size=64, seed=5))
    assert not np.array_equal(sheet, draw_contact_sheet(garments, columns=2, size=64, seed=6))


def test_sheets_of_nothing_are_refused(pairs):
    for garments, columns, size in (([], 2, 64), (pairs["Scarf"], 0, 64)):
        with pytest.raises(ValueError, match="expected at least one garment"):
            draw_contact_sheet(garments, columns=columns, size=size)


def test_a_saved_picture_is_whole(tmp_path, monkeypatch):
    picture = np.zeros((4, 5, 3), dtype=np.uint8)
    picture[1, 2] = (10, 20, 30)
    path = save_picture(picture, tmp_path / "sheets" / "a.png")
    assert np.array_equal(np.array(Image.open(path)), picture)
    monkeypatch.setattr(Image.Image, "save", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        save_picture(picture, tmp_path / "sheets" / "b.png")
    assert [p.name for p in (tmp_path / "sheets").iterdir()] == ["a.png"]
