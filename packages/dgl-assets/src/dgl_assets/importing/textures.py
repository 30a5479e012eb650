"""Pictures on cloth: read, checked, and kept as PNG or JPEG."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.importing.bounds import MAX_PIXELS
from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.paths import TEXTURE_HINT
from dgl_assets.importing.raw import ClothPicture

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "WEBP", "BMP", "TGA", "TIFF", "GIF")
"""Kinds of pictures that are read; for PostScript, Pillow would start an interpreter."""
_SUFFIXES = {"PNG": ".png", "JPEG": ".jpg"}


def load_texture(data: bytes, name: str) -> ClothPicture:
    """Check a picture file by decoding it.

    Args:
        data: The whole file.
        name: Of the file, for messages.

    Returns:
        The same file if it is PNG or JPEG, else its picture as PNG.

    Raises:
        UnreadableFileError: If it is cut off, too large, or no picture.
    """
    try:
        with open_picture(data, name) as picture:
            picture.load()
            if picture.format in _SUFFIXES:
                return ClothPicture(data=data, suffix=_SUFFIXES[picture.format])
            return encode_texture(picture)
    except UnreadableFileError:
        raise
    except Exception as err:  # decoders of other people's files raise anything
        raise _make_error(name, err) from err


def open_picture(data: bytes, name: str) -> Image:
    """Open a picture without decoding it: its kind and size are known.

    Args:
        data: The whole file.
        name: Of the file, for messages.

    Raises:
        UnreadableFileError: If it is none of `FORMATS`, or too large.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)
            picture = Image.open(io.BytesIO(data), formats=FORMATS)
    except Exception as err:  # decoders of other people's files raise anything
        raise _make_error(name, err) from err
    if picture.width * picture.height > MAX_PIXELS:
        raise UnreadableFileError(
            f"{name} has {picture.width} x {picture.height} pixels; at most {MAX_PIXELS:,} are read"
        )
    return picture


def _make_error(name: str, err: Exception) -> UnreadableFileError:
    kinds = ", ".join(FORMATS)
    return UnreadableFileError(
        f"the picture {name} cannot be read as one of {kinds} ({type(err).__name__}); repair "
        f"it{TEXTURE_HINT}"
    )


def read_picture(path: Path, *, side: int = 2048) -> np.ndarray:
    """Decode the picture of an imported garment.

    Args:
        path: PNG or JPEG.
        side: A longer side of it is scaled down to this [pixels].

    Returns:
        Shape (H, W, 3), uint8, sRGB, first row above; white where the picture is transparent.

    Raises:
        UnreadableFileError: If it cannot be read.
    """
    from PIL import Image

    try:
        with open_picture(path.read_bytes(), str(path)) as picture:
            if picture.mode.startswith("I"):  # 16 bits of grey, which Pillow would cut off at 255
                picture = Image.fromarray((np.asarray(picture) >> 8).astype(np.uint8))
            picture = picture.convert("RGBA")
            picture.thumbnail((side, side))
            white = Image.new("RGBA", picture.size, "white")
            return np.asarray(Image.alpha_composite(white, picture).convert("RGB"))
    except UnreadableFileError:
        raise
    except Exception as err:  # decoders of other people's files raise anything
        raise _make_error(str(path), err) from err


def encode_texture(picture: Image) -> ClothPicture:
    """Write a picture as PNG."""
    if picture.mode not in ("RGB", "RGBA", "L"):
        picture = picture.convert("RGBA")
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return ClothPicture(data=stream.getvalue(), suffix=".png")
