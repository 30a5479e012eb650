"""What pictures show of the garment and of the floor below it."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import sapien

from dgl_assets.materials import FabricMaterial
from dgl_physics.sapien_bridge import GarmentVisual
from dgl_tasks.scene import STUDIO, FloorLook, FloorPicture
from dgl_tasks.shadows import FloorShadow

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

__all__ = ["Appearance"]


class Appearance:
    """The garment, the floor and the shadows on it, drawn when a picture is taken and no earlier.

    Where nothing can be rendered the scene has no materials; then `draw_garment` is an error and all else does nothing.
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
        self._garment: GarmentVisual | None = None
        self._shadow: FloorShadow | None = None
        self._floor: FloorPicture | None = None
        self._is_current = False
        self.floor_look = STUDIO
        """What the floor looks like."""
        if scene.can_render():
            self._floor = FloorPicture(scene, ground, mat_centre=mat_centre, pedestals=pedestals)
            self._floor.draw(STUDIO)

    def lay_floor(self, look: FloorLook) -> None:
        """Make the floor look otherwise."""
        self.floor_look = look
        if self._floor is not None:
            self._floor.draw(look)
        if self._shadow is not None:  # it shows the floor as it was
            self._scene.remove_entity(self._shadow.entity)
            self._shadow = None

    def remove_garment(self) -> None:
        """Take the garment out of the pictures; `draw_garment` shows another one."""
        if self._garment is not None:
            self._scene.remove_entity(self._garment.entity)
            self._garment = None
        self._is_current = False

    def mark_moved(self) -> None:
        """Say that the garment or a body has moved."""
        self._is_current = False

    def draw_garment(
        self,
        positions: np.ndarray,
        faces: np.ndarray,
        *,
        flat: np.ndarray,
        fabric: FabricMaterial,
        bodies: Sequence[sapien.physx.PhysxRigidBaseComponent],
    ) -> None:
        """Show the garment and the shadows as they are now, unless nothing has moved since.

        Args:
            positions: Of the garment's vertices [m], shape (V, 3), world frame.
            faces: Its triangles, shape (F, 3).
            flat: Its vertices as it lies flat [m], shape (V, 2), where the fabric's pattern is laid on.
            fabric: What it is made of.
            bodies: Rigid bodies that throw shadows.
        """
        if self._is_current:
            return
        if self._garment is None:
            maps = fabric.render()
            self._garment = GarmentVisual(
                self._scene,
                faces,
                colour=maps.mean_colour,
                roughness=maps.mean_roughness,
                uvs=maps.compute_uvs(flat),
                texture=maps.base_colour,
            )
        if self._shadow is None:
            if self._floor is None:
                raise RuntimeError("the scene must be able to render before a garment is drawn")
            self._shadow = self._floor.build_shadow(bodies)
        self._garment.update(positions)
        self._shadow.update(positions, faces)
        self._is_current = True

    @property
    def garment_segment(self) -> int:
        """Segmentation id of the garment in pictures; it must have been drawn."""
        if self._garment is None:
            raise RuntimeError("draw_garment() must be called before its segment is known")
        return self._garment.entity.per_scene_id
