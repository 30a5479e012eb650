"""Pictures of the Shadow Hand's links: dark phalanges, metal knuckles, soft pads, in link frames.

All solids are those of the right hand; the left hand's are their reflections in x. The palm side is
-y.
"""

from math import pi, radians

from dgl_assets.robots._frames import AXIS_Y, AXIS_Z, rotation_about, transform
from dgl_assets.robots._solids import (
    Section,
    Solid,
    along_x,
    along_y,
    ball,
    cylinder,
    loft,
    rounded_box,
)
from dgl_assets.robots.hand import (
    FINGERTIP_OFFSET,
    MIDDLE_LENGTH,
    PROXIMAL_LENGTH,
    THUMB_TIP_OFFSET,
)


def _hinge(radius: float, half: float) -> list[Solid]:
    """Make a finger joint about x: a metal barrel with darker pin heads."""
    return [
        along_x(cylinder("steel", radius, -half, half, segments=10)),
        along_x(cylinder("dark", 0.45 * radius, -half - 0.0008, half + 0.0008, segments=6)),
    ]


def _phalanx(length: float, radius: float, *, start: float = 0.005) -> list[Solid]:
    """Make the shell of a phalanx between two hinges with a soft pad on its palm side."""
    end = length - 0.005
    r = radius
    shell = loft(
        "shell",
        [
            Section(z=start, hx=0.80 * r, hy=0.72 * r, power=2.6),
            Section(z=start + 0.003, hx=0.95 * r, hy=0.92 * r, power=2.8),
            Section(z=(start + end) / 2, hx=0.86 * r, hy=0.88 * r, power=2.8),
            Section(z=end - 0.003, hx=0.93 * r, hy=0.90 * r, power=2.8),
            Section(z=end, hx=0.80 * r, hy=0.72 * r, power=2.6),
        ],
        10,
    )
    half = (end - start) / 2 - 0.003
    size, centre = (0.62 * r, 0.30 * r, half), (0, -0.72 * r, (start + end) / 2)
    pad = rounded_box("pad", size, centre, radius=0.0012, power=3, segments=8)
    return [shell, pad]


def _fingertip(tip: float, radius: float) -> list[Solid]:
    """Make a distal phalanx: pad in front, darker nail shell behind, rounded at `tip`."""
    r = radius
    pad = loft(
        "pad",
        [
            Section(z=0.0035, hx=0.72 * r, hy=0.55 * r, cy=-0.22 * r),
            Section(z=0.0070, hx=0.92 * r, hy=0.76 * r, cy=-0.22 * r, power=2.3),
            Section(z=0.55 * tip, hx=0.96 * r, hy=0.80 * r, cy=-0.20 * r, power=2.3),
            Section(z=0.78 * tip, hx=0.86 * r, hy=0.74 * r, cy=-0.15 * r, power=2.2),
            Section(z=0.91 * tip, hx=0.62 * r, hy=0.56 * r, cy=-0.08 * r),
            Section(z=0.975 * tip, hx=0.34 * r, hy=0.32 * r),
            Section(z=tip, hx=0.06 * r, hy=0.06 * r),
        ],
        10,
    )
    nail = loft(
        "shell",
        [
            Section(z=0.0030, hx=0.80 * r, hy=0.52 * r, cy=0.32 * r, power=2.6),
            Section(z=0.0065, hx=0.97 * r, hy=0.62 * r, cy=0.36 * r, power=2.6),
            Section(z=0.52 * tip, hx=0.93 * r, hy=0.58 * r, cy=0.34 * r, power=2.6),
            Section(z=0.80 * tip, hx=0.68 * r, hy=0.42 * r, cy=0.30 * r, power=2.4),
            Section(z=0.90 * tip, hx=0.30 * r, hy=0.20 * r, cy=0.30 * r),
        ],
        10,
    )
    return [*_hinge(0.86 * r, 0.80 * r), pad, nail]


def _forearm() -> list[Solid]:
    ring = cylinder("steel", 0.046, 0.0, 0.009, bevel=0.0015, segments=16)
    collar = cylinder("dark", 0.041, 0.008, 0.014, segments=16)
    body = loft(
        "shell",
        [
            Section(z=0.013, hx=0.044, hy=0.040, cy=0.004, power=4),
            Section(z=0.019, hx=0.050, hy=0.046, cy=0.004, power=4),
            Section(z=0.110, hx=0.050, hy=0.046, cy=0.004, power=4),
            Section(z=0.118, hx=0.0485, hy=0.0445, cy=0.003, power=4),
            Section(z=0.176, hx=0.034, hy=0.029, cy=-0.008, power=3.4),
            Section(z=0.186, hx=0.031, hy=0.026, cy=-0.009, power=3.2),
        ],
        16,
    )
    bands = [
        loft(
            "trim",
            [Section(z=z, hx=0.0508, hy=0.0468, cy=0.004, power=4) for z in (z0, z0 + 0.004)],
            16,
        )
        for z0 in (0.030, 0.100)
    ]
    # Cooling slots and a lighter cover on the back, the side that the cameras see.
    cover = rounded_box("trim", (0.030, 0.002, 0.026), (0, 0.0500, 0.067), radius=0.0015, power=5)
    slots = [
        rounded_box("seal", (0.022, 0.0012, 0.0016), (0, 0.0518, z), radius=0.0008)
        for z in (0.051, 0.059, 0.067, 0.075, 0.083)
    ]
    side_plates = [
        rounded_box("trim", (0.0015, 0.024, 0.030), (s * 0.0503, 0.004, 0.065), radius=0.001)
        for s in (-1, 1)
    ]
    # The fork that carries the wrist.
    neck = loft(
        "steel",
        [
            Section(z=0.183, hx=0.027, hy=0.020, cy=-0.009, power=3),
            Section(z=0.197, hx=0.024, hy=0.014, cy=-0.010, power=3),
        ],
        16,
    )
    fork = [
        rounded_box("steel", (0.012, 0.0035, 0.014), (0, -0.010 + s * 0.0155, 0.206), radius=0.001)
        for s in (-1, 1)
    ]
    return [ring, collar, body, *bands, cover, *slots, *side_plates, neck, *fork]


def _wrist() -> list[Solid]:
    barrel = along_y(cylinder("steel", 0.0120, -0.012, 0.012, bevel=0.001, segments=12))
    pin = along_y(cylinder("dark", 0.005, -0.0205, 0.0205, segments=8))
    yoke = loft(
        "trim",
        [
            Section(z=0.003, hx=0.014, hy=0.010, power=3),
            Section(z=0.018, hx=0.026, hy=0.011, power=3.5),
            Section(z=0.024, hx=0.028, hy=0.011, power=3.5),
        ],
        16,
    )
    ears = [
        rounded_box("steel", (0.0045, 0.010, 0.012), (x, 0, 0.031), radius=0.001)
        for x in (-0.025, 0.029)
    ]
    return [barrel, pin, yoke, *ears]


def _palm() -> list[Solid]:
    axle = along_x(cylinder("steel", 0.0085, -0.0215, 0.0255, bevel=0.001, segments=12))
    core = loft(
        "shell",
        [
            Section(z=-0.004, hx=0.018, hy=0.009, cx=0.003, power=3),
            Section(z=0.006, hx=0.030, hy=0.0125, cx=0.003, power=4),
            Section(z=0.022, hx=0.035, hy=0.0130, cx=0.005, power=4),
            Section(z=0.034, hx=0.031, hy=0.0125, cx=0.011, power=4),
            Section(z=0.078, hx=0.033, hy=0.0115, cx=0.011, power=4),
            Section(z=0.086, hx=0.031, hy=0.0095, cx=0.011, power=4),
        ],
        16,
    )
    back = rounded_box(
        "plate", (0.028, 0.0018, 0.030), (0.011, 0.0130, 0.048), radius=0.0012, power=6
    )
    inset = rounded_box(
        "shell", (0.018, 0.0012, 0.014), (0.011, 0.0145, 0.052), radius=0.0008, power=6
    )
    screws = [
        along_y(cylinder("dark", 0.0020, 0.0, 0.0022, segments=6)).shifted(x, 0.0140, z)
        for x in (-0.012, 0.034)
        for z in (0.024, 0.072)
    ]
    pads = [
        rounded_box("pad", (0.027, 0.0025, 0.012), (0.011, -0.0125, 0.068), radius=0.0018, power=5),
        rounded_box("pad", (0.017, 0.0030, 0.016), (0.000, -0.0135, 0.036), radius=0.0018, power=5),
        rounded_box(
            "pad", (0.012, 0.0030, 0.012), (-0.018, -0.0130, 0.012), radius=0.0018, power=5
        ),
    ]
    # Bearings of the J4 axes, which run along y.
    bearings = [
        _bearing().shifted(x, 0, z) for x, z in ((0.033, 0.090), (0.011, 0.094), (-0.011, 0.090))
    ]
    thumb_root = loft(
        "plate",
        [
            Section(z=-0.010, hx=0.009, hy=0.010, cx=0.029, cy=-0.007, power=3),
            Section(z=0.004, hx=0.013, hy=0.013, cx=0.031, cy=-0.008, power=3),
            Section(z=0.020, hx=0.012, hy=0.012, cx=0.031, cy=-0.008, power=3),
            Section(z=0.028, hx=0.009, hy=0.009, cx=0.031, cy=-0.008, power=3),
        ],
        16,
    )
    little_root = rounded_box(
        "plate", (0.008, 0.010, 0.011), (-0.033, 0, 0.014), radius=0.002, power=4
    )
    return [axle, core, back, inset, *screws, *pads, *bearings, thumb_root, little_root]


def _bearing() -> Solid:
    return along_y(cylinder("plate", 0.0085, -0.0110, 0.0110, bevel=0.001, segments=10))


def _metacarpal() -> list[Solid]:
    # The J5 axis lies 55 degrees from x towards z.
    tilt = rotation_about(AXIS_Y, -radians(55))
    axle = along_x(cylinder("steel", 0.0075, -0.009, 0.009, bevel=0.001, segments=10)).moved(
        transform((0, 0, 0), tilt)
    )
    body = loft(
        "shell",
        [
            Section(z=0.006, hx=0.007, hy=0.0095, cx=0.001, power=3),
            Section(z=0.014, hx=0.0098, hy=0.0115, cx=0.001, power=3.5),
            Section(z=0.050, hx=0.0098, hy=0.0110, power=3.5),
            Section(z=0.058, hx=0.0085, hy=0.0090, power=3.5),
        ],
        16,
    )
    back = rounded_box(
        "plate", (0.0075, 0.0015, 0.017), (0.0, 0.0110, 0.033), radius=0.001, power=5
    )
    pad = rounded_box("pad", (0.0082, 0.0025, 0.018), (0.0, -0.0110, 0.034), radius=0.0018, power=4)
    return [axle, body, back, pad, _bearing().shifted(z=0.0608)]


def _knuckle() -> list[Solid]:
    block = rounded_box("steel", (0.0062, 0.0078, 0.0055), (0, 0, -0.001), radius=0.0012, power=4)
    return [block, *_hinge(0.0082, 0.0088)]


def build_hand_solids() -> dict[str, list[Solid]]:
    """Build the solids of the right hand's links by name without the side prefix.

    The four fingers share `finger_knuckle`, `finger_proximal`, `finger_middle`, `finger_distal`.
    """
    across = transform((0, 0, 0), rotation_about(AXIS_Z, pi / 2))
    return {
        "hand_forearm": _forearm(),
        "wrist": _wrist(),
        "palm": _palm(),
        "lf_metacarpal": _metacarpal(),
        "finger_knuckle": _knuckle(),
        "finger_proximal": [
            *_phalanx(PROXIMAL_LENGTH, 0.0090, start=0.006),
            *[s.shifted(z=PROXIMAL_LENGTH) for s in _ears(0.0076)],
        ],
        "finger_middle": [
            *_hinge(0.0074, 0.0060),
            *_phalanx(MIDDLE_LENGTH, 0.0084, start=0.0055),
            *[s.shifted(z=MIDDLE_LENGTH) for s in _ears(0.0070)],
        ],
        "finger_distal": _fingertip(FINGERTIP_OFFSET, 0.0080),
        "th_base": [
            ball("steel", 0.0125),
            cylinder("dark", 0.0090, -0.0140, 0.0040, bevel=0.001, segments=10),
        ],
        "th_proximal": [
            *_hinge(0.0100, 0.0115),
            *_phalanx(0.038, 0.0112, start=0.008),
        ],
        "th_hub": [ball("steel", 0.0100), *_hinge(0.0085, 0.0105)],
        "th_middle": [
            along_y(cylinder("dark", 0.0040, -0.0108, 0.0108, segments=6)),
            *_phalanx(0.032, 0.0100, start=0.0065),
            *[s.moved(across).shifted(z=0.032) for s in _ears(0.0080)],
        ],
        "th_distal": _fingertip(THUMB_TIP_OFFSET, 0.0095),
    }


def _ears(radius: float) -> list[Solid]:
    """Make the two cheeks that hold the next hinge."""
    return [
        along_x(cylinder("trim", radius, *span, segments=8))
        for span in ((-0.0082, -0.0062), (0.0062, 0.0082))
    ]
