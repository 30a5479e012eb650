"""Pictures of the UR10e's links: turned housings, tubes and blue joint caps, in link frames."""

import numpy as np

from dgl_assets.robots._frames import transform
from dgl_assets.robots._solids import (
    Solid,
    along_x,
    along_y,
    cylinder,
    rounded_box,
    turn,
)
from dgl_assets.robots.arm import ELBOW_OFFSET, SHOULDER_OFFSET, UR10E

_R4, _R3, _R2 = 0.0755, 0.0605, 0.0465  # radii of the three joint sizes [m]
_UPPER, _FORE = -UR10E[1].a, -UR10E[2].a
_WRIST_1, _WRIST_2, _FLANGE = UR10E[3].d, UR10E[4].d, UR10E[5].d


def _housing(radius: float, low: float, high: float) -> list[Solid]:
    """Make a cast joint housing along z: a body with a narrow groove and a black seal at `low`."""
    b = 0.10 * radius
    profile = [(0, low + 0.003), (radius, low + 0.003), (radius, high - b), (radius - b, high)]
    body = turn("aluminium", [*profile, (0, high)])
    seal = cylinder("seal", radius - 0.004, low - 0.001, low + 0.004)
    return [body, seal]


def _cap(radius: float, z: float, sign: int) -> list[Solid]:
    """Make the blue cap of a joint on a face at `z`, facing `sign` along z, with its dark rim."""
    r = 0.93 * radius

    def build(material: str, *profile: tuple[float, float]) -> Solid:
        """Turn (radius, height above the face), rising along z so that faces point outward."""
        return turn(material, [(radius, z + sign * up) for radius, up in profile[::sign]])

    rim = build("seal", (0, -0.004), (r, -0.004), (r, 0.001), (0, 0.001))
    cap = build(
        "cap", (0, -0.002), (r - 0.003, -0.002), (r - 0.003, 0.004), (r - 0.009, 0.008), (0, 0.010)
    )
    return [rim, cap]


def _capped(radius: float, low: float, high: float, *, cap_at: int) -> list[Solid]:
    """Make a housing whose blue cap is at its `high` (+1) or `low` (-1) end."""
    if cap_at > 0:
        return [*_housing(radius, low, high), *_cap(radius, high, 1)]
    flip = transform((0, 0, 0), np.diag([1.0, -1.0, -1.0]))
    return [*(s.moved(flip) for s in _housing(radius, -high, -low)), *_cap(radius, low, -1)]


def _shift(solids: list[Solid], xyz: tuple[float, float, float]) -> list[Solid]:
    return [s.shifted(*xyz) for s in solids]


def _tube(radius: float, start: float, end: float, collar: float) -> list[Solid]:
    """Make a tube along +x between two joints, with a collar at each end."""
    profile = [(0, start), (collar, start), (collar, start + 0.045), (radius, start + 0.075)]
    profile += [(radius, end - 0.060), (0.97 * collar, end - 0.035), (0.97 * collar, end)]
    body = turn("tube", [*profile, (0, end)])
    bands = [
        cylinder("seal", collar + 0.0006, start + 0.038, start + 0.042),
        cylinder("seal", 0.97 * collar + 0.0006, end - 0.033, end - 0.029),
    ]
    return [along_x(s) for s in (body, *bands)]


def build_arm_solids() -> dict[str, list[Solid]]:
    """Build the solids of every arm link by name without the side prefix."""
    return {
        "base_link": _base(),
        "shoulder_link": [
            *_housing(_R4, 0.099, 0.185),
            *_shift(
                [along_y(s) for s in _capped(_R4, -0.090, 0.072, cap_at=1)], (0, 0, UR10E[0].d)
            ),
        ],
        "upper_arm_link": _upper_arm(),
        "forearm_link": _forearm(),
        "wrist_1_link": [
            *_housing(_R2, 0.0865, _WRIST_1),
            *_shift([along_y(s) for s in _capped(_R2, -0.058, 0.050, cap_at=1)], (0, 0, _WRIST_1)),
        ],
        "wrist_2_link": [
            *_housing(_R2, 0.0585, _WRIST_2),
            *_shift(
                [along_y(s) for s in _capped(_R2, -0.050, 0.0585, cap_at=-1)], (0, 0, _WRIST_2)
            ),
        ],
        "wrist_3_link": [
            *_housing(_R2 - 0.001, 0.0595, 0.1035),
            cylinder("dark", _R2 - 0.003, 0.1025, 0.1085, bevel=0.001),
            cylinder("steel", _R2 - 0.001, 0.1080, _FLANGE, bevel=0.001),
            *_shift([along_y(cylinder("dark", 0.007, 0.040, 0.051, bevel=0.001))], (0, 0, 0.084)),
        ],
    }


def _base() -> list[Solid]:
    flange = cylinder("aluminium", 0.095, 0.0, 0.018, bevel=0.003, segments=20)
    body = turn(
        "aluminium",
        [(0, 0.016), (0.083, 0.016), (0.078, 0.030), (_R4, 0.045), (_R4, 0.099), (0, 0.099)],
    )
    connector = rounded_box("dark", (0.022, 0.030, 0.020), (-0.076, 0, 0.050), radius=0.004)
    bolts = [
        cylinder("steel", 0.006, 0.016, 0.022, segments=6).shifted(x, y)
        for x in (-0.062, 0.062)
        for y in (-0.062, 0.062)
    ]
    return [flange, body, connector, *bolts]


def _upper_arm() -> list[Solid]:
    z = SHOULDER_OFFSET
    elbow = _capped(_R3, z - 0.062, z + 0.060, cap_at=1)
    return [
        *_capped(_R4, 0.0905, z + 0.078, cap_at=1),
        *_shift(_tube(0.0560, -_UPPER + 0.045, -0.055, 0.0600), (0, 0, z)),
        *_shift(elbow, (-_UPPER, 0, 0)),
    ]


def _forearm() -> list[Solid]:
    z = ELBOW_OFFSET
    wrist = _capped(_R2, z - 0.050, z + 0.0472, cap_at=-1)
    return [
        *_capped(_R3, z - 0.060, SHOULDER_OFFSET - 0.0625, cap_at=-1),
        *_shift(_tube(0.0430, -_FORE + 0.034, -0.045, 0.0470), (0, 0, z)),
        *_shift(wrist, (-_FORE, 0, 0)),
    ]


def build_pedestal_solids(height: float) -> list[Solid]:
    """Build a column that carries a base `height` [m] above the ground; empty below 5 cm."""
    if height < 0.05:
        return []
    column = (0.075, 0.075, (height - 0.030) / 2)
    return [
        rounded_box("pedestal", (0.17, 0.17, 0.0075), (0, 0, 0.0085 - height), radius=0.003),
        rounded_box("pedestal", column, (0, 0, -(height + 0.002) / 2), radius=0.003),
        rounded_box("dark", (0.11, 0.11, 0.0075), (0, 0, -0.0075), radius=0.003),
    ]
