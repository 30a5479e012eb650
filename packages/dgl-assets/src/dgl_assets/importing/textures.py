"""Pictures on cloth: read, checked, and kept as PNG or JPEG."""

from __future__ import annotations

import io
import warnings
from typing import TYPE_CHECKING

from dgl_assets.importing.errors import UnreadableFileError
from dgl_assets.importing.raw import Texture

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_PIXELS = 8192 * 8192
"""Largest picture that is read."""
_SUFFIXES = {"PNG": ".png", "JPEG": ".jpg"}


def load_texture(data: bytes, name: str) -> Texture:
    """Check a picture file by decoding it.

    Args:
        data: The whole file.
        name: Of the file, for messages.

    Returns:
        The same file if it is PNG or JPEG, else its picture as PNG.

    Raises:
        UnreadableFileError: If it is cut off, too large, or no picture.
    """
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(io.BytesIO(data)) as picture:
                if picture.width * picture.height > MAX_PIXELS:
                    raise UnreadableFileError(
                        f"{name} has {picture.width} x {picture.height} pixels; at most {MAX_PIXELS:,} are read"
                    )
                picture.load()
                if picture.format in _SUFFIXES:
                    return Texture(data=data, suffix=_SUFFIXES[picture.format])
                return encode_texture(picture)
    except UnreadableFileError:
        raise
    except Exception as err:  # decoders of other people's files raise anything
        raise UnreadableFileError(
            f"the picture {name} cannot be read ({str(err)[:120]}); repair it, or import without textures"
        ) from err


def encode_texture(picture: Image) -> Texture:
    """Write a picture as PNG."""
    if picture.mode not in ("RGB", "RGBA", "L"):
        picture = picture.convert("RGBA")
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return Texture(data=stream.getvalue(), suffix=".png")
