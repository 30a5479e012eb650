"""Contact parameters, the same for cloth and for solids."""

from dataclasses import dataclass, fields
from typing import ClassVar


@dataclass(frozen=True, kw_only=True)
class ContactMaterial:
    """Contact parameters of a garment, with rigid shapes and between particles.

    The four parameters that make a dexterous grasp possible (friction, adhesion and the two
    particle scales) follow the DexGarmentLab paper, section on garment simulation.
    """

    _POSITIVE: ClassVar[tuple[str, ...]] = ("rest_offset", "thickness")

    drag: float = 0.5
    """Rate at which velocity decays in air [1/s]; >= 0."""

    friction: float = 1.0
    """Coulomb coefficient against a rigid surface of friction 1; >= 0."""

    adhesion: float = 0.05
    """Stiffness of the spring that holds a particle near a rigid surface [N/m]; >= 0."""

    adhesion_radius: float = 0.004
    """Gap to a surface within which adhesion acts [m]; >= 0."""

    particle_friction_scale: float = 0.5
    """Friction between particles, relative to `friction`; >= 0."""

    particle_adhesion_scale: float = 0.5
    """Adhesion between particles, relative to `adhesion`; >= 0."""

    rest_offset: float = 0.004
    """Distance at which a particle rests on a rigid surface [m]; > 0."""

    thickness: float = 0.012
    """Distance at which two particles rest that share no edge [m]; > 0. Larger where edges are
    longer than 1.4 times this: the spheres of particles must cover the mesh."""

    compression_stiffness: float = 1.8e6
    """Pressure of squeezed cloth over its compression [Pa/m]; >= 0. Friction in a pinch comes from
    it. It is less within the first tenth of the thickness."""

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:  # stands for a choice that the field explains
                continue
            if not value >= 0 or (field.name in self._POSITIVE and value == 0):
                bound = "> 0" if field.name in self._POSITIVE else ">= 0"
                raise ValueError(f"{field.name} must be {bound}; got {value}")
