"""Measures of people: typical and random ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np

from dgl_assets.ranges import Measures, measure


@dataclass(frozen=True, kw_only=True)
class PersonMeasures(Measures):
    """Measures of a standing person at life size [m]."""

    stature: float = measure(0.8, 2.1)
    """Floor to the top of the head."""
    crotch_height: float = measure(0.3, 1.05)
    """Floor to the crotch."""
    shoulder_height: float = measure(0.6, 1.78)
    """Floor to the top of the shoulder (acromion)."""
    shoulder_breadth: float = measure(0.18, 0.48)
    """Between the tops of the shoulders (biacromial)."""
    chest_girth: float = measure(0.45, 1.45)
    waist_girth: float = measure(0.42, 1.45)
    """Around the waist at the navel."""
    hip_girth: float = measure(0.45, 1.5)
    """Around the buttocks."""
    neck_girth: float = measure(0.2, 0.52)
    head_girth: float = measure(0.44, 0.64)
    """Around the head over the brow: the size of a hat."""
    arm_length: float = measure(0.24, 0.76)
    """Top of the shoulder to the wrist."""
    upper_arm_girth: float = measure(0.13, 0.46)
    forearm_girth: float = measure(0.13, 0.38)
    """At its thickest."""
    hand_length: float = measure(0.09, 0.23)
    """Wrist to the tip of the middle finger."""
    hand_breadth: float = measure(0.04, 0.105)
    """Across the knuckles."""
    thigh_girth: float = measure(0.25, 0.85)
    """At its thickest."""
    calf_girth: float = measure(0.17, 0.52)
    """At its thickest."""
    foot_length: float = measure(0.12, 0.32)
    """Heel to the tip of the toes."""
    bust: float = measure(0.0, 1.0, 0.0)
    """Shape of the chest from a man's (0) to a woman's (1)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, low, high in (("crotch_height", 0.38, 0.54), ("shoulder_height", 0.72, 0.86)):
            if not low * self.stature < getattr(self, name) < high * self.stature:
                raise ValueError(
                    f"{name} must be {low} to {high} of the stature ({self.stature} m); got "
                    f"{getattr(self, name)}"
                )
        neck = self.stature - self.shoulder_height - 0.41 * self.head_girth
        if neck < 0.012 * self.stature:
            raise ValueError(
                f"shoulder_height must leave room for neck and head ({self.head_girth} m around); "
                f"got {self.shoulder_height} m of {self.stature} m"
            )


_MAN = PersonMeasures(
    stature=1.756, crotch_height=0.846, shoulder_height=1.440, shoulder_breadth=0.416,
    chest_girth=1.03, waist_girth=0.90, hip_girth=1.01, neck_girth=0.392, head_girth=0.574,
    arm_length=0.605, upper_arm_girth=0.325, forearm_girth=0.295, hand_length=0.193,
    hand_breadth=0.088, thigh_girth=0.61, calf_girth=0.385, foot_length=0.271,
)  # fmt: skip
_WOMAN = PersonMeasures(
    stature=1.629, crotch_height=0.775, shoulder_height=1.335, shoulder_breadth=0.365,
    chest_girth=0.94, waist_girth=0.82, hip_girth=1.02, neck_girth=0.330, head_girth=0.561,
    arm_length=0.555, upper_arm_girth=0.295, forearm_girth=0.25, hand_length=0.181,
    hand_breadth=0.079, thigh_girth=0.61, calf_girth=0.37, foot_length=0.246, bust=1.0,
)  # fmt: skip

PEOPLE: dict[str, PersonMeasures] = {
    "man": _MAN,
    "woman": _WOMAN,
    "slim_man": replace(
        _MAN, chest_girth=0.90, waist_girth=0.74, hip_girth=0.90, neck_girth=0.365,
        upper_arm_girth=0.27, forearm_girth=0.255, thigh_girth=0.52, calf_girth=0.345,
    ),
    "heavy_man": replace(
        _MAN, chest_girth=1.20, waist_girth=1.16, hip_girth=1.15, neck_girth=0.435,
        upper_arm_girth=0.38, forearm_girth=0.325, thigh_girth=0.70, calf_girth=0.43,
    ),
    "slim_woman": replace(
        _WOMAN, chest_girth=0.84, waist_girth=0.68, hip_girth=0.90, neck_girth=0.31,
        upper_arm_girth=0.25, forearm_girth=0.225, thigh_girth=0.52, calf_girth=0.335,
    ),
    "heavy_woman": replace(
        _WOMAN, chest_girth=1.12, waist_girth=1.03, hip_girth=1.18, neck_girth=0.365,
        upper_arm_girth=0.36, forearm_girth=0.28, thigh_girth=0.71, calf_girth=0.42,
    ),
    "child_13": PersonMeasures(
        stature=1.57, crotch_height=0.735, shoulder_height=1.265, shoulder_breadth=0.345,
        chest_girth=0.78, waist_girth=0.67, hip_girth=0.83, neck_girth=0.31, head_girth=0.55,
        arm_length=0.53, upper_arm_girth=0.24, forearm_girth=0.225, hand_length=0.172,
        hand_breadth=0.074, thigh_girth=0.47, calf_girth=0.325, foot_length=0.24,
    ),
    "child_8": PersonMeasures(
        stature=1.28, crotch_height=0.575, shoulder_height=1.005, shoulder_breadth=0.285,
        chest_girth=0.63, waist_girth=0.58, hip_girth=0.68, neck_girth=0.275, head_girth=0.525,
        arm_length=0.42, upper_arm_girth=0.195, forearm_girth=0.187, hand_length=0.142,
        hand_breadth=0.063, thigh_girth=0.39, calf_girth=0.26, foot_length=0.20,
    ),
    "child_5": PersonMeasures(
        stature=1.09, crotch_height=0.465, shoulder_height=0.838, shoulder_breadth=0.245,
        chest_girth=0.56, waist_girth=0.53, hip_girth=0.59, neck_girth=0.255, head_girth=0.51,
        arm_length=0.345, upper_arm_girth=0.175, forearm_girth=0.17, hand_length=0.122,
        hand_breadth=0.056, thigh_girth=0.335, calf_girth=0.225, foot_length=0.168,
    ),
}  # fmt: skip
"""Typical people by name.

Source:
    From memory: "man" and "woman" are near the means of ANSUR II (Gordon et al. 2014,
    NATICK/TR-15/007), a survey of soldiers, with a little less girth of trunk and limbs. Children
    by age after Snyder et al. 1977 (UM-HSRI-77-17) and the growth charts of WHO and CDC. "slim" and
    "heavy" change girths by about one and a half standard deviations.
"""


def sample_person(rng: np.random.Generator | int) -> PersonMeasures:
    """Draw the measures of a random adult from a generator, which is advanced, or a seed.

    Stature, girths, legs, shoulders and head vary independently about a woman's or a man's mean.
    """
    rng = np.random.default_rng(rng) if isinstance(rng, int | np.integer) else rng
    base = asdict(_WOMAN if rng.uniform() < 0.5 else _MAN)
    size = float(np.clip(rng.normal(1.0, 0.038), 0.9, 1.1))
    girth = float(size**0.5 * np.clip(rng.normal(0.97, 0.10), 0.8, 1.22))
    values = {}
    for name, value in base.items():
        if name == "bust":
            values[name] = float(np.clip(value * rng.uniform(0.5, 1.0), 0, 1))
        elif name == "head_girth":
            values[name] = value * float(size**0.3 * np.clip(rng.normal(1.0, 0.02), 0.95, 1.05))
        elif name == "neck_girth":
            values[name] = value * girth**0.6
        elif name.endswith("girth"):
            values[name] = value * girth
        else:
            values[name] = value * size
    values["waist_girth"] *= girth**0.5 * float(np.clip(rng.normal(1.0, 0.04), 0.92, 1.08))
    values["crotch_height"] *= float(np.clip(rng.normal(1.0, 0.018), 0.96, 1.04))
    values["shoulder_breadth"] *= float(np.clip(rng.normal(1.0, 0.03), 0.94, 1.06))
    return PersonMeasures(**values)
