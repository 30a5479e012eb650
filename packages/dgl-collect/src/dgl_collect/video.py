"""Films and pictures, written so that a file that exists is whole."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import imageio.v3 as iio
import numpy as np

from dgl_collect.files import written_beside

FRAME_RATE = 12
"""Recorded frames a second: one at every fifth control step of 1/60 s."""


class VideoWriter:
    """Write an H.264 film (yuv420p, which every browser plays), one video frame per recorded frame.

    Used as a context manager. Leaving the block normally finishes the file; leaving it by an exception,
    or without a frame, leaves nothing.

    Args:
        path: Where the film belongs, ending in `.mp4`.
        frame_rate: Frames a second [Hz].
    """

    def __init__(self, path: Path | str, *, frame_rate: int = FRAME_RATE) -> None:
        self.path = Path(path)
        if self.path.suffix != ".mp4":
            raise ValueError(f"path must end in .mp4; got {self.path}")
        self.frame_count = 0
        self._frame_rate = frame_rate
        self._shape: tuple[int, ...] | None = None
        self._stack = ExitStack()
        self._file = None

    def __enter__(self) -> VideoWriter:
        partial = self._stack.enter_context(written_beside(self.path))
        self._file = self._stack.enter_context(iio.imopen(partial, "w", plugin="pyav"))
        self._file.init_video_stream("libx264", fps=self._frame_rate, pixel_format="yuv420p")
        return self

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
        if self._shape is None:
            self._shape = image.shape
        if image.shape != self._shape:
            raise ValueError(f"image must have shape {self._shape}; got {image.shape}")
        self._file.write_frame(image)
        self.frame_count += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file = None
        if error is None and self.frame_count == 0:
            error = ValueError(f"{self.path} must hold at least one frame; got 0")
            self._stack.__exit__(type(error), error, None)
            raise error
        self._stack.__exit__(kind, error, trace)


def save_png(path: Path | str, image: np.ndarray) -> Path:
    """Save a picture.

    Args:
        path: Where the picture belongs, ending in `.png`.
        image: RGB, shape (H, W, 3), uint8.

    Returns:
        The path.
    """
    path = Path(path)
    _check_image(image)
    with written_beside(path) as partial:
        iio.imwrite(partial, image, extension=".png")
    return path


def encode_picture(image: np.ndarray, suffix: str) -> bytes:
    """Give a picture as the content of a file.

    Args:
        image: RGB or, with transparency, RGBA, shape (H, W, 3) or (H, W, 4), uint8.
        suffix: `.png`, or `.webp` for photographs that may lose what no eye sees.
    """
    if suffix == ".webp":
        return iio.imwrite("<bytes>", image, extension=suffix, quality=82)
    return iio.imwrite("<bytes>", image, extension=suffix)


def _check_image(image: np.ndarray) -> None:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(
            f"image must have shape (H, W, 3) and dtype uint8; got {image.shape} {image.dtype}"
        )
