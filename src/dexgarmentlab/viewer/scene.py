"""The scene of an environment in the viewer: bodies, garment and clouds."""

from typing import TYPE_CHECKING

import numpy as np

from dgl_physics.drawing.mesh import SurfaceLook

if TYPE_CHECKING:
    from viser import ViserServer

    from dgl_tasks.env import GarmentEnv

__all__ = ["SceneView", "pick_colour"]

GAMMA = 2.2


def pick_colour(surface: SurfaceLook) -> tuple[int, int, int]:
    """Choose one sRGB colour for a surface: that of its image on average, or its own."""
    if surface.image is not None:
        r, g, b = surface.image.pixels.reshape(-1, 3).mean(axis=0)
    else:
        r, g, b = 255 * np.clip(surface.colour, 0, 1) ** (1 / GAMMA)
    return int(r), int(g), int(b)


class SceneView:
    """Shows an environment that has been reset; `show` moves what has moved."""

    def __init__(
        self, server: "ViserServer", env: "GarmentEnv", *, colour: tuple[int, int, int]
    ) -> None:
        """Add the scene's meshes.

        Args:
            server: Its scene is emptied.
            env: An environment that can render.
            colour: The garment's.
        """
        self._server = server
        server.scene.reset()
        server.scene.set_up_direction("+z")
        meshes, self._poses = env.list_rigid_meshes(), env.get_body_poses()
        self._frames = [
            server.scene.add_frame(
                f"/bodies/{k}", show_axes=False, position=pose[:3], wxyz=pose[3:]
            )
            for k, pose in enumerate(self._poses)
        ]
        for k, mesh in enumerate(meshes):
            parent = "/ground" if mesh.body is None else f"/bodies/{mesh.body}"
            server.scene.add_mesh_simple(
                f"{parent}/mesh_{k}",
                np.asarray(mesh.vertices, dtype=np.float32),
                np.asarray(mesh.faces),
                color=pick_colour(mesh.surface),
                side="double",
            )
        self._garment = server.scene.add_mesh_simple(
            "/garment",
            env.get_particles().astype(np.float32),
            np.asarray(env.garment.faces),
            color=colour,
            side="double",
        )

    def show(self, particles: np.ndarray, poses: np.ndarray) -> None:
        """Move bodies and garment.

        Args:
            particles: [m], shape (V, 3), world frame.
            poses: As of `GarmentEnv.get_body_poses`, shape (B, 7).
        """
        with self._server.atomic():
            for frame, pose, before in zip(self._frames, poses, self._poses, strict=True):
                if not np.array_equal(pose, before):
                    frame.position, frame.wxyz = pose[:3], pose[3:]
            self._garment.vertices = particles.astype(np.float32)
        self._poses = poses

    def show_points(self, name: str, points: np.ndarray, colours: np.ndarray) -> None:
        """Show a cloud instead of the one of the same name; none for no points.

        Args:
            name: Of the cloud.
            points: [m], shape (N, 3), world frame.
            colours: In [0, 1], shape (N, 3).
        """
        self._server.scene.remove_by_name(f"/{name}")
        if len(points):
            self._server.scene.add_point_cloud(
                f"/{name}", points.astype(np.float32), colours.astype(np.float32), point_size=0.008
            )
