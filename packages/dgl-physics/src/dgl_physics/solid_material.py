"""Elastic and contact parameters of a solid."""

from dataclasses import dataclass
from typing import ClassVar

from dgl_physics.contact_material import ContactMaterial


@dataclass(frozen=True, kw_only=True)
class SolidMaterial(ContactMaterial):
    """Parameters of one elastic solid: a hat, a glove.

    The thickness acts between solids and other garments, and between distant parts of one solid;
    particles that are near each other at rest do not touch.
    """

    _POSITIVE: ClassVar[tuple[str, ...]] = (
        "rest_offset", "thickness", "density", "youngs_modulus",
    )  # fmt: skip

    density: float = 400.0
    """Mass per volume [kg/m^3]; > 0. Felt and foam are about 100 to 400, rubber 1000."""

    youngs_modulus: float = 3.0e5
    """Stress over strain in tension, for small strains [Pa]; > 0."""

    poisson_ratio: float = 0.0
    """Contraction across over stretch along, for small strains; in [0, 0.49]. The original's
    hats and gloves have 0."""

    damping: float = 0.002
    """Time constant of the material's damping [s]; >= 0. A vibration of angular frequency w has the
    damping ratio w (damping + substep) / 2, where the substep is the integrator's part."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.poisson_ratio > 0.49:
            raise ValueError(f"poisson_ratio must be <= 0.49; got {self.poisson_ratio}")

    def compute_lame(self) -> tuple[float, float]:
        """Return the shear modulus and Lame's first parameter [Pa]."""
        e, nu = self.youngs_modulus, self.poisson_ratio
        return e / (2 * (1 + nu)), e * nu / ((1 + nu) * (1 - 2 * nu))
