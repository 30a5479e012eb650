"""Materials follow from their seed, look alike at any resolution and join without a seam."""

import dataclasses

import numpy as np
import pytest

from dgl_assets import garment_ids, load_garment
from dgl_assets.materials import (
    FLOOR_KINDS,
    PALE,
    SPECIES,
    WEAVES,
    FabricMaterial,
    FloorMaterial,
    WoodMaterial,
    draw_material_sheet,
    sample_fabric_material,
    sample_floor_material,
)
from dgl_assets.materials.fields import make_fractal, make_noise
from dgl_assets.materials.weaves import CROSSINGS, make_relief


@pytest.fixture(scope="module")
def samples():
    """One of each weave and of each kind of floor, with its maps."""
    found = [sample_fabric_material([k, 1], weaves=[w]) for k, w in enumerate(WEAVES)]
    found += [sample_floor_material([k, 1], kinds=[f]) for k, f in enumerate(FLOOR_KINDS)]
    found.append(WoodMaterial(colours=SPECIES["oak"], rings=13.4, seed=3))
    return [(material, material.render(256)) for material in found]


def test_equal_seeds_give_equal_materials_and_maps(samples):
    for sample in (sample_fabric_material, sample_floor_material):
        material = sample([3, 7])
        assert material == sample(np.random.default_rng([3, 7]))
        first, second = material.render(64), sample([3, 7]).render(64)
        for name in ("base_colour", "roughness", "normal"):
            np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


def test_seeds_reach_all_kinds():
    fabrics = [sample_fabric_material(seed) for seed in range(200)]
    assert {f.weave for f in fabrics} == set(WEAVES)
    assert len({f.pattern for f in fabrics}) == 7
    assert len({f.colours for f in fabrics}) > 190, "no two dye lots are alike"
    assert {sample_floor_material(seed).kind for seed in range(120)} == set(FLOOR_KINDS)


def test_choices_are_kept():
    for seed in range(60):
        fabric = sample_fabric_material(seed, weaves=["jersey", "rib"], avoid=PALE)
        assert fabric.weave in ("jersey", "rib")
        assert fabric.label.split("/")[0] not in PALE
        assert sample_floor_material(seed, kinds=["marble"]).kind == "marble"


def test_maps_are_pictures_of_plausible_surfaces(samples):
    for material, maps in samples:
        assert maps.base_colour.shape == maps.normal.shape == (256, 256, 3)
        assert maps.roughness.shape == (256, 256)
        assert {m.dtype for m in (maps.base_colour, maps.normal, maps.roughness)} == {
            np.dtype(np.uint8)
        }
        # Nothing is darker than coal or whiter than fresh snow.
        assert all(0.01 < c < 0.9 for c in maps.mean_colour), material.name
        assert 0.05 < maps.mean_roughness <= 1.0
        normals = maps.normal / 127.5 - 1.0
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=0.02)
        assert normals[..., 2].min() > 0.2, "a surface seen from outside"
        mean = normals.mean(axis=(0, 1))
        np.testing.assert_allclose(mean[:2], 0.0, atol=0.02), "flat as a whole"


def test_satin_shines_and_carpet_does_not():
    satin = sample_fabric_material(0, weaves=["satin"]).render(64)
    carpet = sample_floor_material(0, kinds=["carpet"]).render(64)
    assert satin.mean_roughness < 0.6 < 0.9 < carpet.mean_roughness


def test_tiles_join_without_a_seam(samples):
    """The step across the border is like the steps inside, in each of the maps."""
    for material, maps in samples:
        for name in ("base_colour", "roughness", "normal"):
            image = getattr(maps, name).astype(np.float64).reshape(256, 256, -1)
            for axis in (0, 1):
                steps = np.abs(image - np.roll(image, 1, axis=axis)).mean(axis=(1 - axis, 2))
                assert steps[0] <= 1.05 * steps[1:].max() + 0.5, (material.name, name)


@pytest.mark.parametrize(
    "names", [("jersey", "planks"), pytest.param(None, marks=pytest.mark.slow)], ids=["two", "all"]
)
def test_a_material_looks_alike_at_any_resolution(samples, names):
    for material, maps in samples:
        if names is not None and material.name.split()[-1] not in names:
            continue
        fine = material.render(512).base_colour.astype(np.float64)
        halved = fine.reshape(256, 2, 256, 2, 3).mean(axis=(1, 3))
        difference = np.abs(maps.base_colour - halved)
        assert difference.mean() < 0.6, "rounding"
        assert difference.max() < 25, "and values that are too bright to be held"
        finer = material.render(1024).base_colour.astype(np.float64)
        broad = [image.reshape(16, len(image) // 16, 16, -1, 3).mean(axis=(1, 3))
                 for image in (finer, fine)]  # fmt: skip
        np.testing.assert_allclose(*broad, atol=12.0)


def test_noise_repeats_and_has_unit_variance():
    rng = np.random.default_rng(0)
    for cells in ((40, 40), (64, 9)):
        noise = make_noise(rng, 256, cells)
        assert noise.std() == pytest.approx(1.0, abs=0.12)
    fractal = make_fractal(rng, 256, (6, 6), octaves=4)
    across = np.abs(fractal[:, 0] - fractal[:, -1]).mean()
    inside = np.abs(np.diff(fractal, axis=1)).mean(axis=0).max()
    assert across <= 1.05 * inside


@pytest.mark.parametrize(
    ("weave", "share"),
    [("plain", 1 / 2), ("oxford", 1 / 2), ("twill", 1 / 2), ("denim", 3 / 4), ("satin", 4 / 5)],
)
def test_the_warp_lies_on_top_as_the_weave_says(weave, share):
    assert (CROSSINGS[weave] > 0).mean() == pytest.approx(share)
    relief = make_relief(weave, 40, 800)
    assert relief.is_warp is not None
    assert relief.is_warp.mean() == pytest.approx(share, abs=0.09)


def test_herringbone_turns_and_twill_does_not():
    """Moved along a diagonal a twill is the same; a herringbone is for half of the table."""
    for name, is_turning in (("twill", False), ("herringbone", True)):
        table = np.tile(CROSSINGS[name], (16 // len(CROSSINGS[name]), 4))
        table = table[:, :16]
        moved = np.roll(np.roll(table, 1, axis=0), -1, axis=1)
        assert np.array_equal(table, moved) is not is_turning


def test_gingham_has_its_two_colours_and_their_mixture():
    fabric = FabricMaterial(
        weave="plain", pattern="gingham", colours=((200, 20, 20), (230, 230, 230)), threads=120,
        scale=6, width=0.5, unevenness=0.0,
    )  # fmt: skip
    picture = fabric.render(512).base_colour.astype(float)
    cells = picture[:504].reshape(12, 42, 512, 3)[:, 6:36].mean(axis=1)  # clear of the borders
    squares = np.stack([cells[:, round(512 * (k + 0.2) / 12) : round(512 * (k + 0.8) / 12)]
                        .mean(axis=1) for k in range(12)], axis=1)  # fmt: skip
    green = squares[..., 1]
    # Rows drift against the 42-pixel blocks by less than a tenth of a square.
    assert green[1, 1] < 70 < green[0, 1] < 170 < green[0, 0]
    assert green[1, 0] == pytest.approx(green[0, 1], abs=25)


def test_chequered_tiles_alternate():
    floor = FloorMaterial(
        kind="tiles", colours=((220, 220, 220), (40, 40, 40), (120, 120, 120)), tile_size=1.2,
        divisions=4, is_chequered=True, variation=0.0,
    )  # fmt: skip
    picture = floor.render(128).base_colour.mean(axis=2).reshape(4, 32, 4, 32)
    middle = picture[:, 8:24, :, 8:24].mean(axis=(1, 3))
    is_dark = np.indices((4, 4)).sum(axis=0) % 2 == 1
    assert (middle[is_dark] < 70).all()
    assert (middle[~is_dark] > 180).all()


def test_a_tile_covers_its_size_of_panel():
    maps = sample_fabric_material(0).render(64)
    rest = np.array([[0.0, 0.0], [maps.tile_size, 0.0], [0.0, 2.5 * maps.tile_size]])
    np.testing.assert_allclose(maps.compute_uvs(rest), [[0, 0], [1, 0], [0, 2.5]], atol=1e-6)
    garment = load_garment(garment_ids("Tops_LongSleeve", "train")[0])
    uvs = maps.compute_uvs(garment.rest_vertices)
    assert uvs.dtype == np.float32
    np.testing.assert_allclose(
        np.ptp(uvs, axis=0) * maps.tile_size, np.ptp(garment.rest_vertices, axis=0), rtol=1e-5
    )
    with pytest.raises(ValueError, match=r"shape \(V, 2\); got \(3, 3\)"):
        maps.compute_uvs(np.zeros((3, 3)))


def test_colour_is_looked_up_at_pixel_centres_and_repeats():
    maps = sample_floor_material(2).render(64)
    centres = (np.arange(64) + 0.5) / 64 * maps.tile_size
    x, y = np.meshgrid(centres, centres)
    np.testing.assert_allclose(maps.sample_colour(x, y), maps.base_colour, atol=1e-6)
    np.testing.assert_allclose(
        maps.sample_colour(x - 3 * maps.tile_size, y + maps.tile_size), maps.base_colour, atol=1e-6
    )


def test_wrong_materials_are_refused(find_unrefused):
    two = ((1, 2, 3), (4, 5, 6))
    fabric = FabricMaterial(weave="jersey", pattern="plain", colours=((90, 40, 60),), threads=80)
    floor = sample_floor_material(0, kinds=["planks"])
    table = [
        (fabric, {"weave": "felt"}, "weave must be one of"),
        (fabric, {"pattern": "paisley"}, "pattern must be one of"),
        (fabric, {"colours": two}, "colours must be 1 sRGB"),
        (fabric, {"colours": ((1, 2, 256),)}, "colours must be 1 sRGB"),
        (fabric, {"threads": 81, "weave": "twill"}, "of twill must be a multiple of 4; got 81"),
        (fabric, {"threads": 400}, r"threads must be in \[20, 160\]; got 400"),
        (fabric, {"roughness": 1.5}, r"roughness must be in \[0.2, 1.0\]; got 1.5"),
        (fabric, {"pattern": "gingham", "colours": two}, "pattern of a knit"),
        (fabric, {"pattern": "dots", "colours": two, "scale": 7}, "scale of dots"),
        (floor, {"kind": "lava"}, "kind must be one of"),
        (floor, {"colours": ((1, 2, 3),)}, "colours must be 3 sRGB"),
        (floor, {"tile_size": 0.1}, r"tile_size must be in \[0.4, 6.0\]"),
        (floor, {"kind": "parquet", "divisions": 3}, "must be even for this floor; got 3"),
    ]
    rows = [(lambda p=p, c=c: dataclasses.replace(p, **c), message) for p, c, message in table]
    dark = ["navy", "denim", "black", "charcoal"]
    rows += [
        (lambda: sample_fabric_material(0, weaves=["felt"]), r"some of .*got \['felt'\]"),
        (lambda: sample_fabric_material(0, avoid=["blau"]), r"avoid .*got \['blau'\]"),
        (lambda: sample_fabric_material(0, weaves=["denim"], avoid=dark), "a yarn for denim"),
        (lambda: sample_floor_material(0, kinds=[]), "kinds must be some of"),
        (lambda: floor.render(16), r"size must be a whole number in \[32, 2048\]; got 16"),
    ]
    assert find_unrefused(rows) == []


def test_the_sheet_shows_every_swatch():
    sheet = draw_material_sheet(1, fabrics=3, floors=2, columns=3, size=96)
    one, again = (draw_material_sheet(1, fabrics=1, floors=0, size=96) for _ in range(2))
    np.testing.assert_array_equal(one, again)
    # 44 pixels of margin, 96 of a swatch, 26 to the next; in the second row a place is left empty
    columns = [slice(44 + k * 122 + 8, 44 + k * 122 + 88) for k in range(3)]
    paper = sheet[0, 0].astype(int)
    share = np.array([
        [(np.abs(half[:, c].astype(int) - paper).max(axis=2) > 12).mean() for c in columns]
        for half in (sheet[98:194], sheet[-150:-74])
    ])  # fmt: skip
    assert (share[0] > 0.8).all()
    assert (share[1, :2] > 0.8).all()
    assert share[1, 2] < 0.01
    with pytest.raises(ValueError, match="at least one swatch"):
        draw_material_sheet(0, fabrics=0, floors=0)
