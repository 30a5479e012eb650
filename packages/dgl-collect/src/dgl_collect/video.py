"""Films and pictures, written whole or not at all."""

import io
from pathlib import Path

import av
import imageio.v3 as iio
import numpy as np
from av.container import OutputContainer

from dgl_files.whole import write_bytes

FRAME_RATE = 12
"""Recorded frames a second: one at every fifth control step of 1/60 s."""
# Takes half the time of x264's default, for files of the same size.
_ENCODER = {"preset": "veryfast", "crf": "23"}


class VideoWriter:
    """Write an H.264 film (yuv420p, which every browser plays), one video frame per recorded frame.

    Used as a context manager. The file is written when the block ends normally; after an exception,
    or without a frame, there is none.

    Args:
        path: The film, ending in `.mp4`.
        frame_rate: Frames a second [Hz].
    """

    def __init__(self, path: Path | str, *, frame_rate: int = FRAME_RATE) -> None:
        self.path = Path(path)
        if self.path.suffix != ".mp4":
            raise ValueError(f"path must end in .mp4; got {self.path}")
        self.frame_count = 0
        self._frame_rate = frame_rate
        self._content = io.BytesIO()  # FFmpeg says nothing where a disk is full
        self._file: OutputContainer | None = None
        self._stream: av.VideoStream | None = None

    def __enter__(self) -> "VideoWriter":
        self._file = av.open(self._content, "w", format="mp4")
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        assert self._file is not None
        with self._file as file:
            if kind is None and self._stream is None:
                raise ValueError(f"{self.path} must hold at least one frame; got 0")
            if kind is None and self._stream is not None:
                file.mux(self._stream.encode(None))  # the frames that the encoder still holds
        self._file = self._stream = None
        if kind is None:
            write_bytes(self.path, self._content.getvalue())

    def add(self, image: np.ndarray) -> None:
        """Append a frame.

        Args:
            image: RGB, shape (H, W, 3), uint8, H and W even and the same for every frame.

        Raises:
            ValueError: If shape or type differ.
            RuntimeError: If the writer is not open.
        """
        if self._file is None:
            raise RuntimeError("VideoWriter must be used in a with block; it is not open")
        _check_image(image)
        if image.shape[0] % 2 or image.shape[1] % 2:
            raise ValueError(f"image must have even height and width; got {image.shape}")
        if self._stream is None:
            self._stream = self._file.add_stream("libx264", self._frame_rate, options=_ENCODER)
            self._stream.height, self._stream.width = image.shape[:2]
            self._stream.pix_fmt = "yuv420p"
        shape = (self._stream.height, self._stream.width, 3)
        if image.shape != shape:
            raise ValueError(f"image must have shape {shape}; got {image.shape}")
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image))
        self._file.mux(self._stream.encode(frame))
        self.frame_count += 1


def save_png(path: Path | str, image: np.ndarray) -> Path:
    """Save a picture.

    Args:
        path: The picture, ending in `.png`.
        image: RGB, shape (H, W, 3), uint8.

    Returns:
        The path.
    """
    path = Path(path)
    _check_image(image)
    write_bytes(path, iio.imwrite("<bytes>", image, extension=".png"))
    return path


def encode_picture(image: np.ndarray, suffix: str) -> bytes:
    """Encode a picture as the content of a file.

    Args:
        image: RGB or, with transparency, RGBA, shape (H, W, 3) or (H, W, 4), uint8.
        suffix: `.png`, or `.webp` for photographs, with a small loss.
    """
    if suffix == ".webp":
        return iio.imwrite("<bytes>", image, extension=suffix, quality=82)
    return iio.imwrite("<bytes>", image, extension=suffix)


def _check_image(image: np.ndarray) -> None:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(
            f"image must have shape (H, W, 3) and dtype uint8; got {image.shape} {image.dtype}"
        )
