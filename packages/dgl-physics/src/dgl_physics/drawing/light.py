"""Light of a studio as tables: blurred domes, reflection, and the values of pictures."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

GAMMA = 2.2
"""Pictures have this power of linear values."""
_SINES, _COSINES = 65, 64
_TILTS, _TURNS = 32, 16  # of the facets of a rough mirror


@dataclass(frozen=True, kw_only=True, eq=False)
class Studio:
    """One lamp, and a dome that is the same all around."""

    direction: tuple[float, float, float]
    """Direction of the lamp's light, of any length, world frame."""
    colour: tuple[float, float, float]
    """Light of the lamp, linear; a white surface that faces it shines with this over pi."""
    dome: Callable[[np.ndarray], np.ndarray]
    """Function from sines of elevations to linear colours, which adds an axis."""
    shade: float
    """Brightness in shadow, a linear factor."""


def _shine_evenly(sine: np.ndarray) -> np.ndarray:
    return (0.5 + 0.25 * sine)[..., None] * np.ones(3)


DAYLIGHT = Studio(direction=(0.5, 0.6, -1.0), colour=(1.6, 1.6, 1.6), dome=_shine_evenly, shade=0.5)
"""A lamp at the upper left, in front, under a pale sky."""


@lru_cache(maxsize=64)  # for the next scene
def blur_dome(studio: Studio, roughness: float) -> np.ndarray:
    """Blur the dome for a roughness, by the sine of the reflection's elevation, shape (65, 3).

    A roughness of 1 also serves for diffuse light. Source: Karis 2013, Real Shading in Unreal
    Engine 4: the prefiltered environment of the split sum, whose eye looks along the normal.
    """
    sines = np.linspace(-1.0, 1.0, _SINES)
    if roughness == 0.0:
        return studio.dome(sines)
    alpha = roughness**2
    u = (np.arange(_TILTS) + 0.5) / _TILTS
    turn = (np.arange(_TURNS) + 0.5) * np.pi / _TURNS  # both halves are alike
    cosine2 = (1 - u) / (1 + (alpha**2 - 1) * u)  # of the facets' tilts, by GGX
    along = 2 * cosine2 - 1  # of the mirrored ways
    weight = np.maximum(along, 0.0)
    level = np.sqrt(1 - sines**2)[:, None, None] * np.sqrt(1 - along**2)[:, None] * np.cos(turn)
    seen = studio.dome(sines[:, None, None] * along[:, None] + level).mean(axis=2)
    return (seen * weight[:, None]).sum(axis=1) / weight.sum()


def compute_mirror(roughness: float) -> np.ndarray:
    """Compute the reflection of the dome, by the cosine to the eye in [0, 1], shape (64, 2).

    The first column is a factor on its reflection of perpendicular light, the second a term.
    Source: Karis 2014, Physically Based Shading on Mobile, a fit of the split sum's second part.
    """
    cosine = np.linspace(0.0, 1.0, _COSINES)
    x, y, z, w = np.array([-1, -0.0275, -0.572, 0.022]) * roughness + [1, 0.0425, 1.04, -0.04]
    a = np.minimum(x * x, 2.0 ** (-9.28 * cosine)) * x + y
    return np.stack([-1.04 * a + z, 1.04 * a + w], axis=1)


def _decode_srgb(value: np.ndarray) -> np.ndarray:
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)


DECODE = _decode_srgb(np.arange(256) / 255.0)
"""Linear value of each value of a texture, shape (256,)."""
ENCODE = (255 * np.linspace(0.0, 1.0, 4096) ** (2 / GAMMA) + 0.5).astype(np.uint8)
"""Value in pictures by the root of the linear one, from 0 to 1, shape (4096,)."""
