"""Garments in a simulation: sheets of cloth and elastic shells."""

import logging
from collections.abc import Mapping

import numpy as np

from dgl_assets.importing import AnyGarment, ImportedGarment
from dgl_physics import ClothMaterial, ModelBuilder, SolidMaterial
from dgl_physics.sapien_bridge import SapienCloth

logger = logging.getLogger(__name__)


def add_soft_body(
    cloth: SapienCloth | ModelBuilder,
    garment: AnyGarment,
    vertices: np.ndarray,
    material: ClothMaterial | SolidMaterial,
    stiffness: Mapping[str, float] | None = None,
    shrinkage: Mapping[str, float] | None = None,
) -> None:
    """Add a garment to a simulation.

    Its vertices are the first particles; the inner side of a solid wall follows. A shell of cloth
    has no wall.

    Args:
        cloth: The simulation.
        garment: A sheet of cloth, or an elastic shell.
        vertices: Initial vertices [m], shape (V, 3); a shell is moved, but not bent.
        material: A cloth's, or, for the wall of a shell, a solid's.
        stiffness: Factor on a cloth's flexural rigidity or a solid's Young's modulus by panel,
            where it is not 1.
        shrinkage: Factor on the rest lengths of a cloth by panel, where it is not 1.

    Raises:
        ValueError: If a sheet's material is a solid's, a solid is to shrink, or there is no such
            panel.
        MeshError: If the mesh cannot be simulated.
    """
    if isinstance(material, SolidMaterial) and garment.wall_thickness is None:
        raise ValueError(
            f"the material of {garment.category} must be a ClothMaterial; got a SolidMaterial"
        )
    factors = _spread(garment, stiffness, "stiffness", np.maximum)
    if isinstance(material, SolidMaterial):
        if shrinkage:
            raise ValueError(f"a solid does not shrink: shrinkage must be empty; got {shrinkage}")
        cloth.add_solid(
            vertices,
            garment.faces,
            material=material,
            thickness=garment.wall_thickness,
            stiffness=factors,
        )
    else:
        cloth.add_garment(
            vertices,
            garment.faces,
            rest=garment.rest_vertices,
            material=material,
            stiffness=factors,
            shrinkage=_spread(garment, shrinkage, "shrinkage", np.minimum),
        )


def _spread(
    garment: AnyGarment, by_name: Mapping[str, float] | None, what: str, among: np.ufunc
) -> np.ndarray | None:
    """Give the factor at each vertex, shape (V,): one among those of the panels that meet there."""
    if not by_name:
        return None
    if isinstance(garment, ImportedGarment):
        logger.warning("%s has no panels: its %s is equal all over", garment.name, what)
        return None
    unknown = sorted(set(by_name) - set(garment.panels))
    if unknown:
        raise ValueError(
            f"{what} must be of panels {sorted(garment.panels)} of {garment.category}; "
            f"got {unknown}"
        )
    by_panel = np.array([by_name.get(name, 1.0) for name in garment.panels])
    factors = np.full(len(garment.vertices), 0.0 if among is np.maximum else np.inf)
    for corner in garment.faces.T:
        among.at(factors, corner, by_panel[garment.face_panels])
    return factors
