"""Rasteriser of triangle meshes."""

# What wp.struct returns is no class to pyright.
# pyright: reportGeneralTypeIssues=false
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from dgl_physics.drawing._kernels import raster, shading
from dgl_physics.drawing._kernels.types import (
    Camera,
    Geometry,
    Looks,
    ShadedMaterial,
    TextureLevels,
)
from dgl_physics.drawing.camera import PinholeCamera
from dgl_physics.drawing.light import (
    DAYLIGHT,
    DECODE,
    ENCODE,
    GAMMA,
    Studio,
    blur_dome,
    compute_mirror,
)
from dgl_physics.drawing.mesh import SHADOW, Image, Mesh, SurfaceLook
from dgl_physics.launcher import Kernel
from dgl_physics.quiet import quiet_warp

_DEVICE = "cpu"


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """Picture of a camera: colours, positions and segments."""

    rgb: np.ndarray
    """Shape (H, W, 3), uint8."""
    points: np.ndarray
    """Position of each pixel [m], shape (H, W, 3), world frame; NaN for background."""
    segments: np.ndarray
    """Segment of each pixel, shape (H, W), int32; 0 for background."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """Visible triangle of each pixel."""

    meshes: np.ndarray
    """Number of its mesh, shape (H, W), int32; -1 for background."""
    faces: np.ndarray
    """Number of the triangle in its mesh, shape (H, W), int32; -1 for background."""
    points: np.ndarray
    """Position of each pixel [m], shape (H, W, 3), world frame; NaN for background."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _View:
    """A camera, and its view of the fixed meshes."""

    lens: Camera
    keys: wp.array
    rgb: wp.array
    points: wp.array
    segments: wp.array


class Rasteriser:
    """Draws moving meshes over fixed ones, which are drawn once for each fixed camera.

    It runs on the CPU in one thread; equal scenes give equal pictures, to the bit.

    Limitations: no transparency, no smooth edges; shadows are meshes of their own.
    """

    @quiet_warp()
    def __init__(self, meshes: Sequence[Mesh], studio: Studio = DAYLIGHT) -> None:
        """Prepare meshes.

        Args:
            meshes: Fixed and moving meshes.
            studio: Light.
        """
        # Fixed meshes come first.
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
        self._order = np.array(order, dtype=np.int32)
        self._is_shadow = np.array([mesh.segment == SHADOW for mesh in ordered])
        self._first_faces = np.cumsum([0, *(len(mesh.faces) for mesh in ordered)])[:-1]
        self._geometry = _make_geometry(ordered, bodies)
        self._looks = _make_looks(ordered, studio)
        self._views: dict[PinholeCamera, _View] = {}

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

    @quiet_warp()
    def draw(self, camera: PinholeCamera) -> np.ndarray:
        """Draw colours, shape (H, W, 3), uint8."""
        view = self._get_view(camera)
        rgb = wp.clone(view.rgb)
        self._shade(view.lens, self._draw_moving(view), rgb, first=self._still_faces)
        return rgb.numpy().reshape(camera.height, camera.width, 3)

    @quiet_warp()
    def draw_picture(self, camera: PinholeCamera, *, moves: bool = False) -> Picture:
        """Draw colours, positions and segments.

        Args:
            camera: The camera.
            moves: Keep nothing for the next picture, which is of another camera.
        """
        view = self._draw_still(camera) if moves else self._get_view(camera)
        rgb, points, segments = (wp.clone(a) for a in (view.rgb, view.points, view.segments))
        keys = self._draw_moving(view)
        self._shade(view.lens, keys, rgb, first=self._still_faces)
        self._locate(view.lens, keys, points, segments, first=self._still_faces)
        size = (camera.height, camera.width)
        return Picture(
            rgb=rgb.numpy().reshape(*size, 3),
            points=points.numpy().reshape(*size, 3),
            segments=segments.numpy().reshape(size),
        )

    @quiet_warp()
    def find_triangles(self, camera: PinholeCamera) -> Sight:
        """Find the visible triangle and position of each pixel; shadows count as background."""
        view = self._get_view(camera)
        points, segments = wp.clone(view.points), wp.clone(view.segments)
        keys = self._draw_moving(view)
        self._locate(view.lens, keys, points, segments, first=self._still_faces)
        places, meshes = points.numpy(), np.full(len(keys), -1, dtype=np.int32)
        numbers = (keys.numpy() & np.uint64(0xFFFFFFFF)).astype(np.int64) - 1
        owners = self._geometry.material.numpy()[numbers]
        is_seen = (numbers >= 0) & ~self._is_shadow[owners]
        meshes[is_seen] = self._order[owners[is_seen]]
        places[~is_seen] = np.nan
        faces = np.where(is_seen, numbers - self._first_faces[owners], -1).astype(np.int32)
        size = (camera.height, camera.width)
        return Sight(
            meshes=meshes.reshape(size), faces=faces.reshape(size), points=places.reshape(*size, 3)
        )

    def _get_view(self, camera: PinholeCamera) -> _View:
        if camera not in self._views:
            self._views[camera] = self._draw_still(camera)
        return self._views[camera]

    def _draw_still(self, camera: PinholeCamera) -> _View:
        lens = _make_lens(camera)
        count = camera.width * camera.height
        view = _View(
            lens=lens,
            keys=wp.zeros(count, dtype=wp.uint64, device=_DEVICE),
            rgb=wp.zeros(count, dtype=wp.vec3ub, device=_DEVICE),
            points=_make(np.full((count, 3), np.nan), wp.vec3),
            segments=wp.zeros(count, dtype=wp.int32, device=_DEVICE),
        )
        _launch(shading.draw_backdrop, count, lens, self._looks, view.rgb)
        _launch(raster.place_vertices, self._still_vertices, lens, 0, self._poses, self._geometry)
        faces = self._still_faces
        _launch(raster.draw_triangles, faces, lens, 0, self._geometry, self._looks, view.keys)
        self._shade(lens, view.keys, view.rgb, first=0)
        self._locate(lens, view.keys, view.points, view.segments, first=0)
        return view

    def _draw_moving(self, view: _View) -> wp.array:
        keys = wp.clone(view.keys)
        first, vertices = self._still_vertices, len(self._geometry.local) - self._still_vertices
        _launch(raster.place_vertices, vertices, view.lens, first, self._poses, self._geometry)
        first, faces = self._still_faces, len(self._geometry.triangles) - self._still_faces
        _launch(raster.draw_triangles, faces, view.lens, first, self._geometry, self._looks, keys)
        return keys

    def _shade(self, lens: Camera, keys: wp.array, rgb: wp.array, *, first: int) -> None:
        _launch(
            shading.shade_pixels, len(keys), lens, first, self._geometry, self._looks, keys, rgb
        )

    def _locate(
        self, lens: Camera, keys: wp.array, points: wp.array, segments: wp.array, *, first: int
    ) -> None:
        _launch(
            raster.locate_pixels, len(keys), lens, first, self._geometry, self._looks, keys,
            points, segments,
        )  # fmt: skip


def weigh_corners(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute barycentric weights of points on triangles.

    Args:
        corners: [m], shape (N, 3, 3): triangle, corner, axis.
        points: A point on or near each triangle [m], shape (N, 3).

    Returns:
        Shape (N, 3), float64; not negative, and their sum is 1.
    """
    corners = corners.astype(np.float64)
    origin = corners[:, 0]
    ab, ac, ap = corners[:, 1] - origin, corners[:, 2] - origin, points - origin
    normal = np.cross(ab, ac)
    area = np.maximum((normal**2).sum(axis=1), 1e-300)
    b = (np.cross(ap, ac) * normal).sum(axis=1) / area
    c = (np.cross(ab, ap) * normal).sum(axis=1) / area
    weights = np.maximum(np.column_stack([1 - b - c, b, c]), 0.0)
    return weights / weights.sum(axis=1, keepdims=True)


def _launch(kernel: Kernel, count: int, *inputs: Any) -> None:
    wp.launch(kernel, dim=count, inputs=list(inputs), device=_DEVICE)


def _make_lens(camera: PinholeCamera) -> Camera:
    lens = Camera()
    to_camera = np.linalg.inv(camera.transform_camera_to_world)
    lens.rotation = wp.mat33(*to_camera[:3, :3].ravel())
    lens.position = wp.vec3(*camera.position)
    intrinsics = camera.intrinsics
    lens.focal = float(intrinsics[0, 0])
    lens.centre_x, lens.centre_y = float(intrinsics[0, 2]), float(intrinsics[1, 2])
    lens.width, lens.height = camera.width, camera.height
    lens.near, lens.far = camera.near, camera.far
    return lens


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
    looks.materials = _make(materials, ShadedMaterial)
    looks.to_lamp = wp.vec3(*(-np.array(studio.direction) / np.linalg.norm(studio.direction)))
    looks.lamp = wp.vec3(*studio.colour)
    looks.shade = studio.shade ** (1 / GAMMA)
    roughnesses = [mesh.surface.roughness for mesh in meshes]
    looks.dome = _make(np.stack([blur_dome(studio, r) for r in (0.0, 1.0, *roughnesses)]), wp.vec3)
    looks.mirror = _make(np.stack([compute_mirror(r) for r in roughnesses]), wp.vec2)
    looks.decode, looks.encode = _make(DECODE, wp.float32), _make(ENCODE, wp.uint8)
    return looks


def _make_material(surface: SurfaceLook, segment: int, numbers: dict[int, int]) -> ShadedMaterial:
    material = ShadedMaterial()
    material.colour = wp.vec3(*surface.colour)
    material.roughness = surface.roughness
    material.metallic = surface.metallic
    material.specular = surface.specular
    material.inside_shade = surface.inside_shade
    material.texture = -1 if surface.image is None else numbers[id(surface.image)]
    material.segment = segment
    return material


def _make_textures(images: Sequence[Image]) -> tuple[wp.array, wp.array]:
    textures, texels, first = [TextureLevels()], [np.zeros((1, 3), np.uint8)], 1  # none is refused
    for image in images:
        levels = image.build_levels()
        texture = TextureLevels()
        texture.first = first
        texture.height, texture.width = image.pixels.shape[:2]
        texture.levels = len(levels)
        texture.is_repeated = int(image.is_repeated)
        textures.append(texture)
        texels += [level.reshape(-1, 3) for level in levels]
        first += sum(len(level) * level.shape[1] for level in levels)
    texels = np.concatenate(texels)
    return _make(textures[1:] or textures, TextureLevels), _make(texels, wp.vec3ub)


def _make(values: np.ndarray | list[Any], dtype: Any) -> wp.array:
    return wp.array(values, dtype=dtype, device=_DEVICE)
