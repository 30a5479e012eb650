"""Looks of the garment and of the floor below it, in pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import sapien

from dgl_assets.importing import AnyGarment, ImportedGarment
from dgl_assets.importing.textures import read_picture
from dgl_assets.materials import FabricMaterial
from dgl_physics.drawing.mesh import Image, Mesh, SurfaceLook
from dgl_physics.sapien_bridge import GarmentVisual
from dgl_tasks.drawing.painter import Painter
from dgl_tasks.errors import RenderingUnavailableError
from dgl_tasks.shadows import FloorShadow, ShadowCaster
from dgl_tasks.studio import LIGHT, STUDIO, FloorLook, FloorPicture

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

__all__ = ["Appearance"]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Garment:
    """A garment to draw, made when the first picture of it is taken."""

    surface: SurfaceLook
    caster: ShadowCaster
    visual: GarmentVisual


class Appearance:
    """The garment, the floor and the shadows on it, drawn when a picture is taken and no earlier.

    A `Painter` draws the environment's pictures, SAPIEN those of ManiSkill's observations and
    viewer. Without a renderer, taking a picture is an error and all else does nothing.
    """

    def __init__(
        self,
        scene: "ManiSkillScene",
        ground: "Actor",
        *,
        mat_centre: tuple[float, float],
        pedestals: Sequence[tuple[float, float, float]],
    ) -> None:
        """Lay the studio's floor.

        Args:
            scene: ManiSkill's scene.
            ground: The ground.
            mat_centre: Centre of the work mat [m], world frame.
            pedestals: Upper ends of the robots' columns [m].
        """
        self._scene = scene.sub_scenes[0]
        (self._ground,) = ground._objs  # noqa: SLF001  ManiSkill has no way to its entity
        self._floor: FloorPicture | None = None
        self._make_garment: Callable[[], _Garment] | None = None
        self._garment: _Garment | None = None
        self._shadow: FloorShadow | None = None
        self._painter: Painter | None = None
        self._is_drawn = False
        self.floor_look = STUDIO
        """The floor's present look."""
        if scene.can_render():
            self._floor = FloorPicture(scene, ground, mat_centre=mat_centre, pedestals=pedestals)
            self._floor.draw(STUDIO)

    def lay_floor(self, look: FloorLook) -> None:
        """Change the floor's look."""
        self.floor_look = look
        if self._floor is not None:
            self._floor.draw(look)
        self._painter = None
        if self._shadow is not None:  # it shows the floor as it was
            self._scene.remove_entity(self._shadow.entity)
            self._shadow = None

    def dress(
        self,
        garment: AnyGarment,
        *,
        fabric: FabricMaterial,
        bodies: Sequence[sapien.physx.PhysxRigidBaseComponent],
    ) -> None:
        """Show this garment from now on.

        Args:
            garment: One with a texture wears that instead of the fabric's pattern.
            fabric: Its material.
            bodies: Rigid bodies that throw shadows.
        """
        if self._garment is not None:
            self._scene.remove_entity(self._garment.visual.entity)
        if self._shadow is not None:
            self._scene.remove_entity(self._shadow.entity)
        self._garment = self._shadow = self._painter = None
        self._make_garment = lambda: self._build_garment(garment, fabric, bodies)
        self.mark_moved()

    def mark_moved(self) -> None:
        """Note that the garment or a body has moved."""
        self._is_drawn = False

    def draw_garment(self, positions: np.ndarray) -> None:
        """Update garment and shadows in SAPIEN's pictures, if something has moved.

        Args:
            positions: Of the garment's vertices [m], shape (V, 3), world frame.
        """
        if self._is_drawn:
            return
        garment = self._get_garment()
        if self._shadow is None:
            self._shadow = self._get_floor().build_shadow(garment.caster)
        garment.visual.update(positions)
        self._shadow.update(positions)
        self._is_drawn = True

    def get_painter(self, positions: np.ndarray) -> Painter:
        """Give the painter of the present scene.

        Args:
            positions: Of the garment's vertices [m], shape (V, 3), world frame.
        """
        garment = self._get_garment()
        if self._painter is None:
            self._painter = self._build_painter(garment)
        surface, normals = garment.visual.compute_surface(positions)
        self._painter.update(surface, normals, garment.caster.cast(positions))
        return self._painter

    def _build_painter(self, garment: _Garment) -> Painter:
        drawn = {self._ground.per_scene_id, garment.visual.entity.per_scene_id}
        if self._shadow is not None:
            drawn.add(self._shadow.entity.per_scene_id)
        assert garment.visual.uvs is not None
        nothing = np.zeros((len(garment.visual.uvs), 3))
        return Painter(
            [entity for entity in self._scene.entities if entity.per_scene_id not in drawn],
            self._ground,
            garment=Mesh(
                vertices=nothing,
                normals=nothing,
                faces=garment.visual.faces,
                uvs=garment.visual.uvs,
                surface=garment.surface,
                segment=garment.visual.entity.per_scene_id,
            ),
            shadow_faces=garment.caster.faces,
            studio=LIGHT,
        )

    @property
    def garment_segment(self) -> int:
        """Segmentation id of the garment in pictures."""
        return self._get_garment().visual.entity.per_scene_id

    def _get_floor(self) -> FloorPicture:
        if self._floor is None:
            raise RenderingUnavailableError(
                "pictures need a renderer: make the environment with "
                'render_backend="cpu" or "gpu"; got "none"'
            )
        return self._floor

    def _get_garment(self) -> _Garment:
        if self._garment is None:
            if self._make_garment is None:
                raise RuntimeError("dress() must be called before a garment is shown")
            self._garment = self._make_garment()
        return self._garment

    def _build_garment(
        self,
        garment: AnyGarment,
        fabric: FabricMaterial,
        bodies: Sequence[sapien.physx.PhysxRigidBaseComponent],
    ) -> _Garment:
        floor, maps, faces = self._get_floor(), fabric.render(), garment.faces
        roughness = maps.mean_roughness
        if isinstance(garment, ImportedGarment) and garment.texture and garment.uvs is not None:
            # its coordinates go upwards, rows of a picture downwards
            uvs, texture = garment.uvs, np.ascontiguousarray(read_picture(garment.texture)[::-1])
        else:
            uvs, texture = maps.compute_uvs(_lay_out(garment)), maps.base_colour
        return _Garment(
            surface=SurfaceLook(
                roughness=roughness,
                specular=GarmentVisual.SPECULAR,
                image=Image(pixels=texture),
                inside_shade=GarmentVisual.INSIDE_SHADE,
            ),
            caster=floor.build_caster(bodies, faces),
            visual=GarmentVisual(self._scene, faces, roughness=roughness, uvs=uvs, texture=texture),
        )


def _lay_out(garment: AnyGarment) -> np.ndarray:
    """Give the flat garment's vertices [m], shape (V, 2), on which the pattern is laid.

    Of shells, as seen from above. The rest shape of an imported garment may not be flat.
    """
    is_imported = isinstance(garment, ImportedGarment)
    return (garment.vertices if is_imported else garment.rest_vertices)[:, :2]
