"""Fabric and contact parameters of a garment."""

from dataclasses import dataclass, fields

from dgl_physics.contact_material import ContactMaterial


@dataclass(frozen=True, kw_only=True)
class ClothMaterial(ContactMaterial):
    """Parameters of one garment.

    The four contact parameters that make a dexterous grasp possible (friction, adhesion and
    the two particle scales) follow the DexGarmentLab paper, section on garment simulation.
    """

    area_density: float = 0.2
    """Mass per layer area [kg/m^2]; > 0. Knitted cotton is about 0.15 to 0.3."""

    stretch_stiffness: float = 1000.0
    """Stiffness of an edge of the mesh [N/m]; > 0."""

    bend_stiffness: float = 0.3
    """Stiffness of the spring across two neighbouring triangles [N/m]; >= 0."""

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

    thickness: float = 0.008
    """Distance at which two particles of different places of the cloth rest [m]; > 0."""

    def __post_init__(self) -> None:
        positive = ("area_density", "stretch_stiffness", "rest_offset", "thickness")
        for field in fields(self):
            value = getattr(self, field.name)
            if not value >= 0 or (field.name in positive and value == 0):
                bound = "> 0" if field.name in positive else ">= 0"
                raise ValueError(f"{field.name} must be {bound}; got {value}")
