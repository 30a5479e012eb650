"""Looks of the garment and of the floor below it, in pictures."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import sapien

from dgl_assets.importing import AnyGarment, ImportedGarment
from dgl_assets.importing.textures import read_picture
from dgl_assets.materials import FabricMaterial
from dgl_physics.drawing.garment import GarmentSurface
from dgl_physics.drawing.mesh import SHADOW, Image, Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Rasteriser
from dgl_tasks.drawing.bodies import ShownMeshes, read_meshes
from dgl_tasks.errors import RenderingUnavailableError
from dgl_tasks.shadows import CORNERS, HEIGHT, ShadowCaster
from dgl_tasks.studio import (
    KEY_DIRECTION,
    LIGHT,
    STUDIO,
    FloorLook,
    make_flat,
    make_floor,
    make_shade,
)

if TYPE_CHECKING:
    from mani_skill.envs.scene import ManiSkillScene
    from mani_skill.utils.structs import Actor

__all__ = ["Appearance"]

_SPECULAR = 0.008  # of cloth: share of perpendicular light that is reflected
_INSIDE_SHADE = 0.9  # brightness of a garment's inside, a factor on the linear colour
_COLUMN = 0.15  # width of the robots' columns [m]
_WORLD = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])  # pose of the world frame


@dataclass(frozen=True, kw_only=True, eq=False)
class _Garment:
    """A garment to draw, made when the first picture of it is taken."""

    surface: GarmentSurface
    look: SurfaceLook
    caster: ShadowCaster
    shown: ShownMeshes

    def make_mesh(self, positions: np.ndarray) -> Mesh:
        """Make the mesh of the garment, world frame, at its vertices' positions [m]."""
        vertices, normals = self.surface.compute(positions)
        return Mesh(
            vertices=vertices,
            normals=normals,
            faces=self.surface.faces,
            uvs=self.surface.uvs,
            surface=self.look,
            segment=self.shown.entity.per_scene_id,
        )


class Appearance:
    """The garment, the floor and the shadows on it, drawn when a picture is taken and no earlier.

    A `Rasteriser` draws the environment's pictures, SAPIEN those of ManiSkill's observations and
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
            pedestals: Upper ends of the robots' columns [m]; they throw shadows.
        """
        self._scene, self._can_render = scene.sub_scenes[0], scene.can_render()
        (self._ground,) = ground._objs  # noqa: SLF001  ManiSkill has no way to its entity
        self._floor = ShownMeshes(self._ground)
        self._mat_centre, self._pedestals = mat_centre, pedestals
        self._make_garment: Callable[[], _Garment] | None = None
        self._garment: _Garment | None = None
        self._shade: SurfaceLook | None = None
        self._shadow: ShownMeshes | None = None
        self._rasteriser: Rasteriser | None = None
        self._bodies: list[sapien.Entity] = []  # that the rasteriser moves
        self._moving = 0  # number of the garment's mesh in it; the shadow's follows
        self._is_drawn = False
        self.lay_floor(STUDIO)

    def lay_floor(self, look: FloorLook) -> None:
        """Change the floor's look."""
        if self._can_render:
            feet = [base[:2] for base in self._pedestals]
            near, far = make_floor(look, mat_centre=self._mat_centre, pedestals=feet)
            self._floor.replace([far, near])
            self._shade = make_shade(near.surface)
        self._rasteriser = None
        self.mark_moved()

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
            self._scene.remove_entity(self._garment.shown.entity)
        self._garment = self._rasteriser = None
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
            self._shadow = self._add_entity("floor_shadow")
        self._shadow.replace([self._make_shadow(garment, positions)])
        garment.shown.replace([garment.make_mesh(positions)])
        self._is_drawn = True

    def get_rasteriser(self, positions: np.ndarray) -> Rasteriser:
        """Give the rasteriser of the present scene.

        Args:
            positions: Of the garment's vertices [m], shape (V, 3), world frame.
        """
        garment = self._get_garment()
        if self._rasteriser is None:
            self._rasteriser = self._build_rasteriser(garment, positions)
        self._rasteriser.set_poses(np.array([*self.get_body_poses(), _WORLD]))
        self._rasteriser.set_vertices(self._moving, *garment.surface.compute(positions))
        shadow = self._make_shadow(garment, positions)
        self._rasteriser.set_vertices(self._moving + 1, shadow.vertices)
        return self._rasteriser

    def _make_shadow(self, garment: _Garment, positions: np.ndarray) -> Mesh:
        assert self._shade is not None
        flat, faces = garment.caster.cast(positions), garment.caster.faces
        mesh = make_flat(flat, faces, self._shade, self._mat_centre, height=HEIGHT)
        return replace(mesh, segment=SHADOW)

    def list_rigid_meshes(self) -> list[Mesh]:
        """List the meshes of the ground and of all bodies; `get_body_poses` moves them."""
        garment = self._get_garment()
        shown = [self._floor, garment.shown, *([self._shadow] if self._shadow else [])]
        ids = {meshes.entity.per_scene_id for meshes in shown}
        meshes, self._bodies = read_meshes(self._ground, None), []
        for entity in self._scene.entities:
            if entity.per_scene_id not in ids and (parts := read_meshes(entity, len(self._bodies))):
                meshes += parts
                self._bodies.append(entity)
        return meshes

    def get_body_poses(self) -> np.ndarray:
        """Give the present pose of each body: xyz [m] and wxyz, shape (B, 7), world frame."""
        poses = [e.pose for e in self._bodies]
        return np.array([np.concatenate([pose.p, pose.q]) for pose in poses]).reshape(-1, 7)

    def _build_rasteriser(self, garment: _Garment, positions: np.ndarray) -> Rasteriser:
        meshes = self.list_rigid_meshes()
        self._moving, world = len(meshes), len(self._bodies)
        cloth = replace(garment.make_mesh(positions), body=world)
        shadow = self._make_shadow(garment, positions)
        shadow = replace(shadow, surface=SurfaceLook(), uvs=None, body=world)
        return Rasteriser([*meshes, cloth, shadow], LIGHT)

    @property
    def garment_segment(self) -> int:
        """Segmentation id of the garment in pictures."""
        return self._get_garment().shown.entity.per_scene_id

    def _get_garment(self) -> _Garment:
        if not self._can_render:
            raise RenderingUnavailableError(
                "pictures need a renderer: make the environment with "
                'render_backend="cpu" or "gpu"; got "none"'
            )
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
        maps, faces = fabric.render(), garment.faces
        roughness = maps.mean_roughness
        if isinstance(garment, ImportedGarment) and garment.texture and garment.uvs is not None:
            # its coordinates go upwards, rows of a picture downwards
            uvs, texture = garment.uvs, np.ascontiguousarray(read_picture(garment.texture)[::-1])
        else:
            # the pattern is laid on shells as seen from above, and on imported garments as they
            # lie, because their rest shape may not be flat
            is_imported = isinstance(garment, ImportedGarment)
            flat = garment.vertices if is_imported else garment.rest_vertices
            uvs, texture = maps.compute_uvs(flat[:, :2]), maps.base_colour
        columns = [
            np.array([x, y, z / 2]) + CORNERS * [_COLUMN / 2, _COLUMN / 2, z / 2]
            for x, y, z in self._pedestals
        ]
        return _Garment(
            surface=GarmentSurface(faces, uvs),
            look=SurfaceLook(
                roughness=roughness,
                specular=_SPECULAR,
                image=Image(pixels=texture),
                inside_shade=_INSIDE_SHADE,
            ),
            caster=ShadowCaster(bodies, faces=faces, direction=KEY_DIRECTION, fixed=columns),
            shown=self._add_entity("garment"),
        )

    def _add_entity(self, name: str) -> ShownMeshes:
        entity = sapien.Entity()
        entity.name = name
        self._scene.add_entity(entity)
        return ShownMeshes(entity)
