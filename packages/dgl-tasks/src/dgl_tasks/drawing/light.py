"""The light of a studio as tables: the dome as surfaces of all kinds see it, and the values of pictures."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

GAMMA = 2.2
"""Pictures have this power of linear values."""
_ROUGHNESSES = 6
_SINES = 65
_DIRECTIONS = (32, 64)  # of the microfacets that a rough mirror is made of: by tilt and around


@dataclass(frozen=True, kw_only=True, eq=False)
class Studio:
    """One lamp, and a dome that is the same all around."""

    direction: tuple[float, float, float]
    """Where the lamp's light goes, of any length, world frame."""
    colour: tuple[float, float, float]
    """Light of the lamp, linear; a white surface that faces it shines with this over pi."""
    dome: Callable[[np.ndarray], np.ndarray]
    """Light by the sine of the height above the horizon, of any shape; linear, one axis more."""
    shade: float
    """Brightness of what lies in shadow, linear, a factor."""

    def compute_dome_table(self) -> np.ndarray:
        """Blur the dome as rough mirrors do, shape (roughnesses in [0, 1], sines in [-1, 1], 3).

        The last is what a matt surface sees. Source: Karis 2013, Real Shading in Unreal Engine 4, the
        prefiltered environment of the split sum, whose eye looks along the normal.
        """
        sines = np.linspace(-1.0, 1.0, _SINES)
        rows = [self.dome(sines)]
        tilts, turns = _DIRECTIONS
        u = (np.arange(tilts) + 0.5) / tilts
        around = (np.arange(turns) + 0.5) * 2 * np.pi / turns
        for roughness in np.linspace(0.0, 1.0, _ROUGHNESSES)[1:]:
            alpha = roughness**2
            cosine = np.sqrt((1 - u) / (1 + (alpha**2 - 1) * u))  # of the facets' tilt, by GGX
            on_normal = 2 * cosine**2 - 1  # of the mirrored way
            aside = np.sqrt(1 - on_normal**2)
            weight = np.maximum(on_normal, 0.0)
            height = on_normal[:, None] * sines[:, None, None] + np.sqrt(1 - sines**2)[
                :, None, None
            ] * (aside[:, None] * np.cos(around))
            seen = self.dome(height).mean(axis=2)  # (sines, tilts, 3)
            rows.append((seen * weight[:, None]).sum(axis=1) / weight.sum())
        return np.stack(rows).astype(np.float32)


def encode(linear: np.ndarray) -> np.ndarray:
    """Turn linear values in [0, 1] into sRGB, uint8, of the same shape."""
    return _SRGB[(np.sqrt(linear) * (len(_SRGB) - 1) + 0.5).astype(np.int32)]


def _decode_srgb(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


def _encode_srgb(linear: np.ndarray) -> np.ndarray:
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


_ROOTS = np.linspace(0.0, 1.0, 4096)
_SRGB = (255 * _encode_srgb(_ROOTS**2) + 0.5).astype(np.uint8)
DECODE = _decode_srgb(np.arange(256) / 255.0).astype(np.float32)
"""Linear value of each value of a texture, shape (256,)."""
ENCODE = (255 * _ROOTS ** (2 / GAMMA) + 0.5).astype(np.uint8)
"""Value in pictures by the root of the linear one, from 0 to 1, shape (4096,)."""
