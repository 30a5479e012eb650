"""The device to compute on, checked before anything is computed."""

import torch

__all__ = ["find_device"]


def find_device(device: str | torch.device) -> torch.device:
    """Return a device that is there, with its number: "cuda" becomes "cuda:0".

    Raises:
        ValueError: If torch does not know it or cannot use it here.
    """
    try:
        return torch.empty(0, device=device).device
    # A build without CUDA asserts; one with it raises, in several lines.
    except (RuntimeError, AssertionError, NotImplementedError) as err:
        reason = " ".join(str(err).split())
        raise ValueError(
            f"device must be one that torch can use here, such as cpu; got {str(device)!r}: "
            f"{reason}"
        ) from err
