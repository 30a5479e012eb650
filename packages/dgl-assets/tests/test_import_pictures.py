"""Pictures of imported garments, decoded."""

import numpy as np
import pytest
from PIL import Image

from dgl_assets.importing import UnreadableFileError
from dgl_assets.importing.textures import read_picture


def test_transparent_is_white_and_rows_go_downwards(tmp_path):
    pixels = np.zeros((2, 3, 4), np.uint8)
    pixels[0] = [200, 10, 10, 255]
    Image.fromarray(pixels).save(tmp_path / "t.png")
    read = read_picture(tmp_path / "t.png")
    assert read.dtype == np.uint8
    np.testing.assert_array_equal(read[0], [[200, 10, 10]] * 3)
    np.testing.assert_array_equal(read[1], [[255, 255, 255]] * 3)


@pytest.mark.parametrize("mode", ["L", "P", "1", "RGB", "CMYK", "I;16"])
def test_any_kind_of_pixels_is_read_and_large_ones_are_scaled(mode, tmp_path):
    picture = Image.new("L", (300, 100), 255)
    picture = Image.new("I;16", (300, 100), 65535) if mode == "I;16" else picture.convert(mode)
    suffix = "jpg" if mode == "CMYK" else "png"
    picture.save(tmp_path / f"t.{suffix}")
    read = read_picture(tmp_path / f"t.{suffix}", side=60)
    assert read.shape == (20, 60, 3)
    assert read.min() >= 250


def test_what_is_no_picture_is_refused(tmp_path):
    path = tmp_path / "t.png"
    Image.fromarray(np.zeros((64, 64, 3), np.uint8)).save(path)
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(UnreadableFileError, match=r"t\.png cannot be read as one of PNG"):
        read_picture(path)
    with pytest.raises(UnreadableFileError, match=r"none\.png cannot be read"):
        read_picture(tmp_path / "none.png")
