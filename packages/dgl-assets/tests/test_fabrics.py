"""Fabrics are determined by their seed, differ between seeds and join without a seam."""

import numpy as np
import pytest

from dgl_assets import garment_ids, load_garment
from dgl_assets.fabrics import RESOLUTION, make_fabric


@pytest.fixture(scope="module")
def fabrics():
    return [make_fabric([seed, 7]) for seed in range(24)]


def test_equal_seeds_give_equal_fabrics(fabrics):
    again = make_fabric(np.random.default_rng([3, 7]))
    assert again.name == fabrics[3].name
    assert again.colour == fabrics[3].colour
    assert again.roughness == fabrics[3].roughness
    np.testing.assert_array_equal(again.texture, fabrics[3].texture)


def test_other_seeds_give_other_fabrics(fabrics):
    assert len({f.texture.tobytes() for f in fabrics}) == len(fabrics)
    assert len({f.name.split()[0] for f in fabrics}) >= 8, "many colours"
    assert len({f.name.split()[1] for f in fabrics}) == 5, "every pattern"


def test_textures_are_pictures_of_plausible_cloth(fabrics):
    for fabric in fabrics:
        assert fabric.texture.shape == (RESOLUTION, RESOLUTION, 3)
        assert fabric.texture.dtype == np.uint8
        assert 0.8 <= fabric.roughness <= 0.95
        # No real cloth is darker than black velvet or whiter than bleached cotton.
        assert all(0.01 < c < 0.9 for c in fabric.colour), fabric.name


def test_tiles_join_without_a_seam(fabrics):
    for fabric in fabrics:
        image = fabric.texture.astype(np.float64)
        for axis in (0, 1):
            # A step across the seam is like those inside: yarn to yarn, or stripe to stripe.
            steps = np.abs(image - np.roll(image, 1, axis=axis)).mean(axis=(1 - axis, 2))
            assert steps[0] <= 1.05 * steps[1:].max(), fabric.name


def test_a_tile_covers_its_size_of_panel(fabrics):
    fabric = fabrics[0]
    rest = np.array([[0.0, 0.0], [fabric.tile_size, 0.0], [0.0, 2.5 * fabric.tile_size]])
    np.testing.assert_allclose(fabric.compute_uvs(rest), [[0, 0], [1, 0], [0, 2.5]], atol=1e-6)
    garment = load_garment(garment_ids("Tops_LongSleeve", "train")[0])
    uvs = fabric.compute_uvs(garment.rest_vertices)
    assert uvs.dtype == np.float32
    np.testing.assert_allclose(
        np.ptp(uvs, axis=0) * fabric.tile_size, np.ptp(garment.rest_vertices, axis=0), rtol=1e-5
    )
    with pytest.raises(ValueError, match=r"shape \(V, 2\); got \(3, 3\)"):
        fabric.compute_uvs(np.zeros((3, 3)))
