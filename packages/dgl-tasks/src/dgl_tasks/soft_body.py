"""A garment in a simulation: cloth, or an elastic shell, and its surface among the particles."""

import logging
from collections.abc import Mapping

import numpy as np

from dgl_assets.importing import AnyGarment, ImportedGarment
from dgl_physics import ClothMaterial, ModelBuilder, SolidMaterial
from dgl_physics.sapien_bridge import SapienCloth

logger = logging.getLogger(__name__)


class SoftBody:
    """A garment with its material."""

    def __init__(
        self,
        garment: AnyGarment,
        material: ClothMaterial | SolidMaterial,
        stiffness: Mapping[str, float] | None = None,
    ) -> None:
        """Check that they belong together.

        Args:
            garment: A sheet of cloth, or an elastic shell.
            material: Of a sheet a cloth's, of a shell a solid's.
            stiffness: Of a shell: factor on Young's modulus by panel, where it is not 1.

        Raises:
            ValueError: If the material is of the other kind, or there is no such panel.
        """
        kind = SolidMaterial if garment.wall_thickness is not None else ClothMaterial
        if not isinstance(material, kind):
            raise ValueError(
                f"the material of {garment.category} must be a {kind.__name__}; "
                f"got a {type(material).__name__}"
            )
        if stiffness and isinstance(garment, ImportedGarment):
            logger.warning("%s has no panels: it is equally stiff all over", garment.name)
            stiffness = None
        panels = () if isinstance(garment, ImportedGarment) else garment.panels
        unknown = sorted(set(stiffness or {}) - set(panels))
        if unknown:
            raise ValueError(
                f"stiffness must be of panels {sorted(panels)} of {garment.category}; got {unknown}"
            )
        self.garment, self._material, self._stiffness = garment, material, stiffness or {}

    def add_to(self, cloth: SapienCloth | ModelBuilder, vertices: np.ndarray) -> None:
        """Add it to a simulation.

        Args:
            cloth: The simulation.
            vertices: Initial vertices [m], shape (V, 3); an elastic shell is moved, but not bent.

        Raises:
            MeshError: If its mesh cannot be simulated.
        """
        garment, material = self.garment, self._material
        if isinstance(material, SolidMaterial):
            cloth.add_solid(
                vertices,
                garment.faces,
                material=material,
                thickness=garment.wall_thickness,
                stiffness=self._spread_stiffness(),
            )
        else:
            cloth.add_garment(
                vertices, garment.faces, rest=garment.rest_vertices, material=material
            )

    def get_surface(self, particles: np.ndarray) -> np.ndarray:
        """Select the garment's vertices, shape (V, 3), from all particles [m], shape (P, 3).

        The wall of a shell has particles on both sides; the outer ones come first.
        """
        return particles[: len(self.garment.vertices)]

    def _spread_stiffness(self) -> np.ndarray | None:
        """Factor at each vertex, shape (V,): the largest of the panels that meet there."""
        if not self._stiffness or isinstance(self.garment, ImportedGarment):
            return None
        by_panel = np.array([self._stiffness.get(name, 1.0) for name in self.garment.panels])
        factors = np.zeros(len(self.garment.vertices))
        for corner in self.garment.faces.T:
            np.maximum.at(factors, corner, by_panel[self.garment.face_panels])
        return factors
