"""What SAPIEN says where it cannot draw, in words that help."""

from collections.abc import Iterator
from contextlib import contextmanager

from dgl_tasks.errors import RenderingUnavailableError

__all__ = ["explain_rendering"]


@contextmanager
def explain_rendering() -> Iterator[None]:
    """Turn what SAPIEN says where it cannot draw into what is missing.

    Raises:
        RenderingUnavailableError: If the block raises such a `RuntimeError`.
    """
    try:
        yield
    except RuntimeError as err:
        text = str(err)
        if "window" in text.lower():
            raise RenderingUnavailableError(
                f'render_mode "human" needs a display for its window, and there is none ({text}); '
                '"rgb_array" gives pictures without one'
            ) from err
        if "failed to find device" in text:
            raise RenderingUnavailableError(
                f'render_backend must be "cpu", "gpu", "none" or a device of this machine; {text}'
            ) from err
        if "vk::" in text or "render" in text.lower():
            raise RenderingUnavailableError(
                f"no usable Vulkan device ({text}); `dgl doctor` says what to install"
            ) from err
        raise
