"""Fabric and contact parameters of a garment."""

from dataclasses import dataclass
from typing import ClassVar

from dgl_physics.contact_material import ContactMaterial
from dgl_physics.membrane import ISOTROPIC_SHEAR


@dataclass(frozen=True, kw_only=True)
class ClothMaterial(ContactMaterial):
    """Parameters of one garment; `dgl_physics.fabrics` has those of measured fabrics.

    The defaults are a cotton jersey in weight and bending. In its plane the default is stiffer and
    isotropic, so that cloth keeps its size when robots pull at it and needs no yarns, which cost
    time.

    The four contact parameters that make a dexterous grasp possible (friction, adhesion and
    the two particle scales) follow the DexGarmentLab paper, section on garment simulation.
    """

    area_density: float = 0.2
    """Mass per layer area [kg/m^2]; > 0. Knitted cotton is about 0.15 to 0.3."""

    stretch_stiffness: float = 1000.0
    """Young's modulus of the membrane along warp and weft, force per width [N/m]; > 0."""

    shear_stiffness: float | None = None
    """Shear modulus of the membrane [N/m]; > 0, at most 3/8 of `stretch_stiffness`. None means 3/8:
    isotropic. Other values need flat rest coordinates with axes weft (x) and warp (y); garments
    with three-dimensional rest coordinates are isotropic."""

    bending_stiffness: float = 5.0e-6
    """Flexural rigidity per width [N m]; >= 0."""

    stretch_damping: float = 0.0
    """Relaxation time of stretch and shear, viscosity over modulus [s]; >= 0. It acts where the
    substep resolves the stiffness; elsewhere the solver itself damps."""

    bending_damping: float = 0.01
    """Relaxation time of bending, viscosity over rigidity [s]; >= 0."""

    _POSITIVE: ClassVar[tuple[str, ...]] = (
        "area_density", "stretch_stiffness", "shear_stiffness", "rest_offset", "thickness",
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        limit = ISOTROPIC_SHEAR * self.stretch_stiffness
        if self.shear_stiffness is not None and self.shear_stiffness > limit:
            raise ValueError(
                f"shear_stiffness must be at most 3/8 of stretch_stiffness, {limit:g}; "
                f"got {self.shear_stiffness}"
            )
