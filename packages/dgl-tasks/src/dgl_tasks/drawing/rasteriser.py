"""Draws meshes as cameras see them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dgl_tasks.cameras import CameraPlacement
from dgl_tasks.drawing._kernels import raster, shading
from dgl_tasks.drawing._kernels.types import Camera, Geometry, Looks, Material, Texture
from dgl_tasks.drawing.light import DECODE, ENCODE, GAMMA, Studio, blur_dome, compute_mirror
from dgl_tasks.drawing.mesh import Image, Mesh, Surface

_DEVICE = "cpu"


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """What a camera sees, drawn once and used for everything."""

    rgb: np.ndarray
    """Shape (H, W, 3), uint8."""
    points: np.ndarray
    """Place of each pixel [m], shape (H, W, 3), world frame; NaN where nothing is."""
    segments: np.ndarray
    """Segment of each pixel, shape (H, W), int32; 0 where nothing is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """A camera, and what it sees of all that never moves."""

    camera: Camera
    keys: wp.array
    rgb: wp.array
    points: wp.array
    segments: wp.array


class Rasteriser:
    """Draws what moves over what never does, which is drawn once a camera.

    Everything is computed on the processor, in one thread, and equal scenes give equal pictures to the last bit.

    Limitations: nothing is transparent, edges are not smoothed, and shadows are meshes of their own.
    """

    def __init__(self, meshes: Sequence[Mesh], studio: Studio) -> None:
        """Prepare meshes.

        Args:
            meshes: What there is.
            studio: The light.
        """
        # Poses and triangles of what never moves come first.
        order = sorted(range(len(meshes)), key=lambda k: meshes[k].body is not None)
        ordered = [meshes[k] for k in order]
        still = [mesh for mesh in ordered if mesh.body is None]
        self._still_vertices = sum(len(mesh.vertices) for mesh in still)
        self._still_faces = sum(len(mesh.faces) for mesh in still)
        bodies = [0 if mesh.body is None else mesh.body + 1 for mesh in ordered]
        poses = np.zeros((max(bodies, default=0) + 1, 7), dtype=np.float32)
        poses[:, 6] = 1.0
        self._poses = _make(poses, wp.transform)
        starts = np.cumsum([0, *(len(mesh.vertices) for mesh in ordered)])
        self._parts = {k: slice(starts[i], starts[i + 1]) for i, k in enumerate(order)}
        self._geometry = _make_geometry(ordered, bodies)
        self._looks = _make_looks(ordered, studio)
        self._views: dict[CameraPlacement, _View] = {}

    def set_poses(self, poses: np.ndarray) -> None:
        """Move the bodies.

        Args:
            poses: Position [m] and quaternion wxyz of each, shape (B, 7), world frame.
        """
        if poses.shape != (len(self._poses) - 1, 7):
            raise ValueError(
                f"poses must have shape ({len(self._poses) - 1}, 7); got {poses.shape}"
            )
        self._poses.numpy()[1:] = poses[:, [0, 1, 2, 4, 5, 6, 3]]

    def set_vertices(
        self, mesh: int, vertices: np.ndarray, normals: np.ndarray | None = None
    ) -> None:
        """Change the shape of a mesh that moves.

        Args:
            mesh: Its number.
            vertices: [m], shape (V, 3), frame of its body.
            normals: Shape (V, 3); as they were when None.
        """
        part = self._parts[mesh]
        if part.start < self._still_vertices:
            raise ValueError(f"mesh must be one that moves; got {mesh}")
        if vertices.shape != (part.stop - part.start, 3):
            raise ValueError(
                f"vertices must have shape ({part.stop - part.start}, 3); got {vertices.shape}"
            )
        self._geometry.local.numpy()[part] = vertices
        if normals is not None:
            self._geometry.local_normal.numpy()[part] = normals

    def draw(self, placement: CameraPlacement) -> np.ndarray:
        """Draw colours, shape (H, W, 3), uint8."""
        view = self._get_view(placement)
        rgb = wp.clone(view.rgb)
        self._shade(view.camera, self._draw_moving(view), rgb, first=self._still_faces)
        return rgb.numpy().reshape(placement.height, placement.width, 3)

    def draw_picture(self, placement: CameraPlacement) -> Picture:
        """Draw colours, and what is where."""
        view = self._get_view(placement)
        rgb, points, segments = (wp.clone(a) for a in (view.rgb, view.points, view.segments))
        keys = self._draw_moving(view)
        self._shade(view.camera, keys, rgb, first=self._still_faces)
        self._locate(view.camera, keys, points, segments, first=self._still_faces)
        size = (placement.height, placement.width)
        return Picture(
            rgb=rgb.numpy().reshape(*size, 3),
            points=points.numpy().reshape(*size, 3),
            segments=segments.numpy().reshape(size),
        )

    def _get_view(self, placement: CameraPlacement) -> _View:
        if placement not in self._views:
            self._views[placement] = self._draw_still(placement)
        return self._views[placement]

    def _draw_still(self, placement: CameraPlacement) -> _View:
        camera = _make_camera(placement)
        count = placement.width * placement.height
        view = _View(
            camera=camera,
            keys=wp.zeros(count, dtype=wp.uint64, device=_DEVICE),
            rgb=wp.zeros(count, dtype=wp.vec3ub, device=_DEVICE),
            points=_make(np.full((count, 3), np.nan), wp.vec3),
            segments=wp.zeros(count, dtype=wp.int32, device=_DEVICE),
        )
        _launch(shading.draw_backdrop, count, camera, self._looks, view.rgb)
        _launch(raster.place_vertices, self._still_vertices, camera, 0, self._poses, self._geometry)
        _launch(
            raster.draw_triangles,
            self._still_faces,
            camera,
            0,
            self._geometry,
            self._looks,
            view.keys,
        )
        self._shade(camera, view.keys, view.rgb, first=0)
        self._locate(camera, view.keys, view.points, view.segments, first=0)
        return view

    def _draw_moving(self, view: _View) -> wp.array:
        keys = wp.clone(view.keys)
        first, vertices = self._still_vertices, len(self._geometry.local) - self._still_vertices
        _launch(raster.place_vertices, vertices, view.camera, first, self._poses, self._geometry)
        first, faces = self._still_faces, len(self._geometry.triangles) - self._still_faces
        _launch(raster.draw_triangles, faces, view.camera, first, self._geometry, self._looks, keys)
        return keys

    def _shade(self, camera: Camera, keys: wp.array, rgb: wp.array, *, first: int) -> None:
        _launch(
            shading.shade_pixels, len(keys), camera, first, self._geometry, self._looks, keys, rgb
        )

    def _locate(
        self, camera: Camera, keys: wp.array, points: wp.array, segments: wp.array, *, first: int
    ) -> None:
        _launch(
            raster.locate_pixels,
            len(keys),
            camera,
            first,
            self._geometry,
            self._looks,
            keys,
            points,
            segments,
        )


def _launch(kernel: wp.Kernel, count: int, *inputs: Any) -> None:
    wp.launch(kernel, dim=count, inputs=list(inputs), device=_DEVICE)


def _make_camera(placement: CameraPlacement) -> Camera:
    camera = Camera()
    to_camera = np.linalg.inv(placement.transform_camera_to_world)
    camera.rotation = wp.mat33(*to_camera[:3, :3].ravel())
    camera.position = wp.vec3(*placement.position)
    intrinsics = placement.intrinsics
    camera.focal = float(intrinsics[0, 0])
    camera.centre_x, camera.centre_y = float(intrinsics[0, 2]), float(intrinsics[1, 2])
    camera.width, camera.height = placement.width, placement.height
    camera.near, camera.far = placement.near, placement.far
    return camera


def _make_geometry(meshes: Sequence[Mesh], bodies: Sequence[int]) -> Geometry:
    sizes = [len(mesh.vertices) for mesh in meshes]
    starts = np.cumsum([0, *sizes[:-1]])
    geometry = Geometry()
    geometry.body = _make(np.repeat(bodies, sizes), wp.int32)
    geometry.local = _make(np.concatenate([mesh.vertices for mesh in meshes]), wp.vec3)
    geometry.local_normal = _make(np.concatenate([mesh.normals for mesh in meshes]), wp.vec3)
    uvs = [np.zeros((len(m.vertices), 2)) if m.uvs is None else m.uvs for m in meshes]
    geometry.uv = _make(np.concatenate(uvs), wp.vec2)
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]
    geometry.triangles = _make(np.concatenate(faces), wp.vec3i)
    owners = np.repeat(np.arange(len(meshes)), [len(mesh.faces) for mesh in meshes])
    geometry.material = _make(owners, wp.int32)
    geometry.normal = wp.zeros_like(geometry.local)
    geometry.projected = wp.zeros_like(geometry.local)
    return geometry


def _make_looks(meshes: Sequence[Mesh], studio: Studio) -> Looks:
    images = {id(m.surface.image): m.surface.image for m in meshes if m.surface.image is not None}
    numbers = {key: number for number, key in enumerate(images)}
    looks = Looks()
    looks.textures, looks.texels = _make_textures(list(images.values()))
    materials = [_make_material(m.surface, m.segment, numbers) for m in meshes]
    looks.materials = _make(materials, Material)
    looks.to_lamp = wp.vec3(*(-np.array(studio.direction) / np.linalg.norm(studio.direction)))
    looks.lamp = wp.vec3(*studio.colour)
    looks.shade = studio.shade ** (1 / GAMMA)
    roughnesses = [mesh.surface.roughness for mesh in meshes]
    looks.dome = _make(np.stack([blur_dome(studio, r) for r in (0.0, 1.0, *roughnesses)]), wp.vec3)
    looks.mirror = _make(np.stack([compute_mirror(r) for r in roughnesses]), wp.vec2)
    looks.decode, looks.encode = _make(DECODE, wp.float32), _make(ENCODE, wp.uint8)
    return looks


def _make_material(surface: Surface, segment: int, numbers: dict[int, int]) -> Material:
    material = Material()
    material.colour = wp.vec3(*surface.colour)
    material.roughness = surface.roughness
    material.metallic = surface.metallic
    material.specular = surface.specular
    material.inside_shade = surface.inside_shade
    material.texture = -1 if surface.image is None else numbers[id(surface.image)]
    material.segment = segment
    return material


def _make_textures(images: Sequence[Image]) -> tuple[wp.array, wp.array]:
    textures, texels, first = (
        [Texture()],
        [np.zeros((1, 3), np.uint8)],
        1,
    )  # Warp has no use for none
    for image in images:
        levels = image.build_levels()
        texture = Texture()
        texture.first = first
        texture.height, texture.width = image.pixels.shape[:2]
        texture.levels = len(levels)
        texture.is_repeated = int(image.is_repeated)
        textures.append(texture)
        texels += [level.reshape(-1, 3) for level in levels]
        first += sum(len(level) * level.shape[1] for level in levels)
    return (
        _make(textures[1:] or textures, Texture),
        _make(np.concatenate(texels), wp.vec3ub),
    )


def _make(values: np.ndarray | Sequence[Any], dtype: Any) -> wp.array:
    return wp.array(values, dtype=dtype, device=_DEVICE)
