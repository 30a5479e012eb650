"""Fabrics by name, with measured numbers.

Units of textile testing: 1 gf cm^2/cm = 9.807e-5 N m of flexural rigidity,
1 mg/cm^2 = 0.01 kg/m^2. Rigidities are means of warp and weft.

Sources:
    W: H. Wang, J. F. O'Brien, R. Ramamoorthi: Data-Driven Elastic Models for Cloth: Modeling and
        Measurement, SIGGRAPH 2011, with the published data of ten fabrics. Their coefficients are
        of the energy k l^2 theta^2 / (8 (A0 + A1)) of a hinge with angle theta, edge l, areas A,
        so B = k / 4 (see `dgl_physics.bending`; here of the smallest curvature measured), and of
        the energies k E_11^2 and k E_12^2 per area with E the Green strain, so the moduli are 2 k
        in tension and k / 2 in shear (small strain; knits at 17 % strain, where their loops have
        straightened).
    M: M. Matsudaira, T. Masuda, M. Wada, H. Yokura: Shape Factor of Flared Skirts Compared with
        That of Circular Fabrics, J. Textile Eng. 61(6), 2015, table 1: KES-FB measurements.
    T: M. Temel, A. A. Johnson, A. B. Lloyd: Evaluating the Repeatability of Friction Coefficient
        Measurements and Tactile Perceptions in Skin-Textile Interactions Across Body Regions,
        Tribology Letters 70, 2022: dynamic friction of cotton on skin, 0.25 to 0.79.

Friction is the middle of T for all fabrics, for want of measurements by fabric. Friction between
fabrics and the contact thickness are the defaults of `ClothMaterial`, which are numerical.
"""

from difflib import get_close_matches

from dgl_physics.material import ClothMaterial

_SKIN_FRICTION = 0.5  # T

FABRICS: dict[str, ClothMaterial] = {
    # W, "gray interlock", T-shirt of 60 % cotton and 40 % polyester:
    # B = (23.2e-6 + 14.3e-6) / 2 / 4; 2 (46.4 + 405.9) / 2; 36.9 / 2.
    "knit_cotton": ClothMaterial(
        area_density=0.187,
        bending_stiffness=4.7e-6,
        stretch_stiffness=452.0,
        shear_stiffness=18.4,
        friction=_SKIN_FRICTION,
    ),
    # M, "cotton broad", plain weave: W = 12.38 mg/cm^2, B = 0.118 gf cm^2/cm.
    # In plane W, "royal target", trousers of 65 % cotton: 2 (2016.6 + 2035.0) / 2; 104.8 / 2.
    "woven_cotton": ClothMaterial(
        area_density=0.124,
        bending_stiffness=1.16e-5,
        stretch_stiffness=4050.0,
        shear_stiffness=52.4,
        friction=_SKIN_FRICTION,
    ),
    # W, "11 oz black denim", 99 % cotton: B = (64.2e-6 + 97.0e-6) / 2 / 4; 2 (205.4 + 1013.9) / 2;
    # 53.4 / 2. KES measurements of other denims are 0.14 to 0.23 gf cm^2/cm = 1.4e-5 to 2.2e-5 N m
    # (J. Textiles 2016, 4614168, table 5).
    "denim": ClothMaterial(
        area_density=0.324,
        bending_stiffness=2.01e-5,
        stretch_stiffness=1220.0,
        shear_stiffness=26.7,
        friction=_SKIN_FRICTION,
    ),
    # No table of silk was found: 16 momme, a usual crepe de Chine, of 4.34 g/m^2 each, with the
    # bending length of the silk-like filament weave below, c = 12.2 mm: B = w g c^3 with
    # w = 0.069 kg/m^2. In plane as that one.
    "silk": ClothMaterial(
        area_density=0.069,
        bending_stiffness=1.23e-6,
        stretch_stiffness=4030.0,
        shear_stiffness=9.6,
        friction=_SKIN_FRICTION,
    ),
    # M, "wool tropical", plain weave: W = 16.29 mg/cm^2, B = 0.067 gf cm^2/cm. In plane as woven
    # cotton, for want of a table.
    "wool": ClothMaterial(
        area_density=0.163,
        bending_stiffness=6.57e-6,
        stretch_stiffness=4050.0,
        shear_stiffness=52.4,
        friction=_SKIN_FRICTION,
    ),
    # M, "polyester faille": W = 10.43 mg/cm^2, B = 0.019 gf cm^2/cm. In plane W, "white dots on
    # black", a weave of polyester: 2 (2002.1 + 2027.5) / 2; 19.2 / 2.
    "polyester": ClothMaterial(
        area_density=0.104,
        bending_stiffness=1.86e-6,
        stretch_stiffness=4030.0,
        shear_stiffness=9.6,
        friction=_SKIN_FRICTION,
    ),
}
"""Materials of fabrics by name; vary them with `dataclasses.replace`."""


def get_fabric(name: str) -> ClothMaterial:
    """Return the material of a fabric.

    Args:
        name: A name in `FABRICS`.

    Raises:
        ValueError: If there is none of this name; the message lists all.
    """
    if name not in FABRICS:
        close = get_close_matches(name, FABRICS, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else ""
        raise ValueError(f"name must be one of {sorted(FABRICS)}; got {name!r}{hint}")
    return FABRICS[name]
