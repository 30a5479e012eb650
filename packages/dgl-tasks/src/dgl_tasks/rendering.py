"""Clear errors for SAPIEN's failures to render."""

from collections.abc import Iterator
from contextlib import contextmanager

from dgl_tasks.errors import RenderingUnavailableError

__all__ = ["explain_rendering"]


@contextmanager
def explain_rendering() -> Iterator[None]:
    """Turn SAPIEN's failures to render into a message with the missing part.

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
