"""Messages as bytes: msgpack with arrays as openpi packs them. Nothing is unpickled."""

from typing import Any

import msgpack
import numpy as np

__all__ = ["pack", "unpack"]


def pack(message: object) -> bytes:
    """Pack maps, lists, numbers, texts and numeric arrays.

    Raises:
        TypeError: If something else is among them.
    """
    packed = msgpack.packb(message, default=_pack_array)
    assert packed is not None
    return packed


def unpack(data: bytes) -> Any:
    """Unpack what `pack` or openpi's server has packed.

    Raises:
        ValueError: If the bytes are no such message.
    """
    try:
        return msgpack.unpackb(data, object_hook=_unpack_array)
    except (ValueError, TypeError, KeyError, AttributeError, msgpack.UnpackException) as err:
        raise ValueError(f"the bytes must be a message of msgpack; {err}") from err


def _pack_array(value: object) -> dict[bytes, object]:
    if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
        return {
            b"__ndarray__": True,
            b"data": value.tobytes(),
            b"dtype": value.dtype.str,
            b"shape": value.shape,
        }
    if isinstance(value, np.generic) and value.dtype.kind in "biuf":
        return {b"__npgeneric__": True, b"data": value.item(), b"dtype": value.dtype.str}
    raise TypeError(f"a message must hold numbers, texts and numeric arrays; got {type(value)}")


def _unpack_array(value: dict) -> object:
    if b"__ndarray__" in value:
        dtype = _read_dtype(value)
        array = np.frombuffer(value[b"data"], dtype=dtype)
        return array.reshape(tuple(value[b"shape"]))
    if b"__npgeneric__" in value:
        return _read_dtype(value).type(value[b"data"])
    return value


def _read_dtype(value: dict) -> np.dtype:
    dtype = np.dtype(value[b"dtype"])
    if dtype.kind not in "biuf":
        raise ValueError(f"arrays must be of numbers; got {dtype}")
    return dtype
