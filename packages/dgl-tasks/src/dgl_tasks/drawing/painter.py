"""A SAPIEN scene with a garment, as the rasteriser draws it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import sapien

from dgl_physics.drawing.light import Studio
from dgl_physics.drawing.mesh import SHADOW, Mesh, SurfaceLook
from dgl_physics.drawing.rasteriser import Picture, Rasteriser
from dgl_tasks.cameras import CameraPlacement
from dgl_tasks.drawing.bodies import read_meshes
from dgl_tasks.shadows import HEIGHT


class Painter:
    """The bodies of a scene, a garment and a shadow: read once, moved by `update`."""

    def __init__(
        self,
        bodies: Sequence[sapien.Entity],
        ground: sapien.Entity,
        *,
        garment: Mesh,
        shadow_faces: np.ndarray,
        studio: Studio,
    ) -> None:
        """Read the bodies' meshes.

        Args:
            bodies: Entities that may move.
            ground: Entity that never moves.
            garment: The garment; its vertices and normals are those of `update`.
            shadow_faces: Triangles of the shadow, shape (G, 3), counter-clockwise seen from above.
            studio: The light.
        """
        meshes = read_meshes(ground, None)
        self._bodies: list[sapien.Entity] = []
        for entity in bodies:
            parts = read_meshes(entity, len(self._bodies))
            if parts:
                meshes += parts
                self._bodies.append(entity)
        world = len(self._bodies)  # the frame of garment and shadow
        self._poses = np.zeros((world + 1, 7))
        self._poses[world, 3] = 1.0
        self._garment, self._shadow = len(meshes), len(meshes) + 1
        count = int(shadow_faces.max()) + 1
        shadow = Mesh(
            vertices=np.full((count, 3), HEIGHT),
            normals=np.zeros((count, 3)),
            faces=shadow_faces,
            surface=SurfaceLook(),
            segment=SHADOW,
            body=world,
        )
        self._rasteriser = Rasteriser([*meshes, replace(garment, body=world), shadow], studio)
        self._shadow_vertices = shadow.vertices

    def update(self, vertices: np.ndarray, normals: np.ndarray, shadow: np.ndarray) -> None:
        """Move everything to its present place.

        Args:
            vertices: Of the garment [m], shape (V, 3), world frame.
            normals: At these, shape (V, 3).
            shadow: Vertices of the shadow on the ground [m], shape (W, 2), world frame.
        """
        for row, entity in zip(self._poses, self._bodies, strict=False):
            pose = entity.pose
            row[:3], row[3:] = pose.p, pose.q
        self._rasteriser.set_poses(self._poses)
        self._rasteriser.set_vertices(self._garment, vertices, normals)
        self._shadow_vertices[:, :2] = shadow
        self._rasteriser.set_vertices(self._shadow, self._shadow_vertices)

    def draw(self, camera: CameraPlacement) -> np.ndarray:
        """Draw what a camera sees, shape (H, W, 3), uint8."""
        return self._rasteriser.draw(camera)

    def draw_picture(self, camera: CameraPlacement) -> Picture:
        """Draw what a camera sees, with position and segment of each pixel."""
        return self._rasteriser.draw_picture(camera)
