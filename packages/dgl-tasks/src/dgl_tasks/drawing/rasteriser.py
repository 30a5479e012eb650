"""Draws meshes as a camera sees them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from dgl_tasks.cameras import CameraPlacement
from dgl_tasks.drawing import kernels
from dgl_tasks.drawing.light import DECODE, ENCODE, GAMMA, Studio, compute_mirror
from dgl_tasks.drawing.mesh import Mesh, Surface

_DEVICE = "cpu"
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


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

    camera: kernels.Camera
    keys: wp.array
    rgb: wp.array
    points: wp.array
    segments: wp.array


class Rasteriser:
    """Draws what moves over pictures of what never does, which are drawn once a camera.

    Everything is computed on the processor, in one thread, and is the same on every machine up to rounding.

    Limitations: nothing is transparent; no anti-aliasing; shadows are meshes of their own.
    """

    def __init__(
        self,
        still: Sequence[Mesh],
        moving: Sequence[Mesh],
        bodies: Sequence[int],
        *,
        studio: Studio,
    ) -> None:
        """Prepare meshes.

        Args:
            still: What never moves, in the world frame.
            moving: What does.
            bodies: Which of the poses of `draw` each of the moving meshes has, shape (len(moving),).
            studio: The light.
        """
        meshes = [*still, *moving]
        self._starts = np.cumsum([0, *(len(m.vertices) for m in meshes)])
        self._still = len(still)
        self._still_vertices = int(self._starts[len(still)])
        faces = [m.faces + s for m, s in zip(meshes, self._starts, strict=False)]
        self._still_faces = sum(len(m.faces) for m in still)
        owner = [0] * len(still) + [1 + b for b in bodies]
        sizes = [len(m.vertices) for m in meshes]
        self._poses = _make(
            np.tile(np.float32(_IDENTITY), (2 + max(bodies, default=-1), 1)), wp.transform
        )
        self._body = _make(np.repeat(owner, sizes), wp.int32)
        self._local = _make(_join([m.vertices for m in meshes]), wp.vec3)
        self._local_normal = _make(_join([m.normals for m in meshes]), wp.vec3)
        self._uvs = _make(
            _join([np.zeros((len(m.vertices), 2)) if m.uvs is None else m.uvs for m in meshes]),
            wp.vec2,
        )
        self._normal, self._projected = wp.zeros_like(self._local), wp.zeros_like(self._local)
        self._triangles = _make(_join(faces), wp.vec3i, np.int32)
        self._triangle_material = _make(
            np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]), wp.int32
        )
        self._set_materials(meshes)
        self._light = kernels.Light()
        toward = -np.array(studio.direction) / np.linalg.norm(studio.direction)
        self._light.toward = wp.vec3(*toward)
        self._light.colour = wp.vec3(*studio.colour)
        self._light.shade = studio.shade ** (1 / GAMMA)
        self._tables = kernels.Tables()
        roughnesses = [m.surface.roughness for m in meshes]
        blurred = {r: studio.blur_dome(r) for r in {0.0, 1.0, *roughnesses}}
        rows = np.stack([blurred[r] for r in (0.0, 1.0, *roughnesses)])
        self._tables.dome = wp.array(rows.astype(np.float32), dtype=wp.vec3, device=_DEVICE)
        mirrors = np.stack([compute_mirror(r) for r in roughnesses])
        self._tables.mirror = wp.array(mirrors.astype(np.float32), dtype=wp.vec2, device=_DEVICE)
        self._tables.decode = _make(DECODE, wp.float32)
        self._tables.encode = wp.array(ENCODE, dtype=wp.uint8, device=_DEVICE)
        self._views: dict[CameraPlacement, _View] = {}

    def _set_materials(self, meshes: Sequence[Mesh]) -> None:
        materials, textures, texels, first = [], [], [], 0
        numbers: dict[int, int] = {}
        for mesh in meshes:
            material = _make_material(mesh.surface, mesh.segment)
            image = mesh.surface.image
            if image is not None:
                if id(image) not in numbers:
                    numbers[id(image)] = len(textures)
                    levels = image.build_levels()
                    texture = kernels.Texture()
                    texture.first = first
                    texture.height, texture.width = image.pixels.shape[:2]
                    texture.levels = len(levels)
                    texture.is_repeated = int(image.is_repeated)
                    textures.append(texture)
                    texels += [level.reshape(-1, 3) for level in levels]
                    first += sum(level.shape[0] * level.shape[1] for level in levels)
                material.texture = numbers[id(image)]
            materials.append(material)
        self._materials = wp.array(materials, dtype=kernels.Material, device=_DEVICE)
        self._textures = wp.array(
            textures or [kernels.Texture()], dtype=kernels.Texture, device=_DEVICE
        )
        self._texels = wp.array(
            np.concatenate([*texels, np.zeros((1, 3), np.uint8)]), dtype=wp.vec3ub, device=_DEVICE
        )

    def set_poses(self, poses: np.ndarray) -> None:
        """Move the bodies.

        Args:
            poses: Position [m] and quaternion wxyz of each, shape (B, 7), world frame.
        """
        self._poses.numpy()[1:] = poses[:, [0, 1, 2, 4, 5, 6, 3]]

    def set_vertices(
        self, mesh: int, vertices: np.ndarray, normals: np.ndarray | None = None
    ) -> None:
        """Change the shape of a moving mesh.

        Args:
            mesh: Its number among the moving ones.
            vertices: [m], shape (V, 3), frame of its body.
            normals: Shape (V, 3); as they were when None.
        """
        k = self._still + mesh
        part = slice(int(self._starts[k]), int(self._starts[k + 1]))
        self._local.numpy()[part] = vertices
        if normals is not None:
            self._local_normal.numpy()[part] = normals

    def draw(self, placement: CameraPlacement) -> np.ndarray:
        """Draw colours, shape (H, W, 3), uint8."""
        view = self._get_view(placement)
        rgb = wp.clone(view.rgb)
        keys = self._draw_moving(view)
        self._shade(view.camera, keys, rgb, self._still_faces)
        return rgb.numpy().reshape(placement.height, placement.width, 3)

    def draw_picture(self, placement: CameraPlacement) -> Picture:
        """Draw colours, and what is where."""
        view = self._get_view(placement)
        rgb, points, segments = (wp.clone(a) for a in (view.rgb, view.points, view.segments))
        keys = self._draw_moving(view)
        self._shade(view.camera, keys, rgb, self._still_faces)
        self._locate(view.camera, keys, points, segments, self._still_faces)
        size = (placement.height, placement.width)
        return Picture(
            rgb=rgb.numpy().reshape(*size, 3),
            points=points.numpy().reshape(*size, 3),
            segments=segments.numpy().reshape(size),
        )

    def _draw_moving(self, view: _View) -> wp.array:
        keys = wp.clone(view.keys)
        vertices = len(self._local) - self._still_vertices
        self._enter(
            view.camera,
            keys,
            self._still_vertices,
            vertices,
            self._still_faces,
            len(self._triangles) - self._still_faces,
        )
        return keys

    def _get_view(self, placement: CameraPlacement) -> _View:
        if placement not in self._views:
            camera = _make_camera(placement)
            count = placement.width * placement.height
            view = _View(
                camera=camera,
                keys=wp.zeros(count, dtype=wp.uint64, device=_DEVICE),
                rgb=wp.zeros(count, dtype=wp.vec3ub, device=_DEVICE),
                points=wp.full(count, wp.vec3(np.nan), dtype=wp.vec3, device=_DEVICE),
                segments=wp.zeros(count, dtype=wp.int32, device=_DEVICE),
            )
            wp.launch(
                kernels.draw_backdrop,
                dim=count,
                inputs=[camera, self._tables, view.rgb],
                device=_DEVICE,
            )
            self._enter(camera, view.keys, 0, self._still_vertices, 0, self._still_faces)
            self._shade(camera, view.keys, view.rgb, 0)
            self._locate(camera, view.keys, view.points, view.segments, 0)
            self._views[placement] = view
        return self._views[placement]

    def _enter(
        self,
        camera: kernels.Camera,
        keys: wp.array,
        vertex: int,
        vertices: int,
        face: int,
        faces: int,
    ) -> None:
        wp.launch(
            kernels.place_vertices,
            dim=vertices,
            inputs=[
                camera, vertex, self._poses, self._body, self._local, self._local_normal,
                self._normal, self._projected,
            ],
            device=_DEVICE,
        )  # fmt: skip
        wp.launch(
            kernels.draw_triangles,
            dim=faces,
            inputs=[
                camera, face, self._triangles, self._triangle_material, self._materials,
                self._projected, keys,
            ],
            device=_DEVICE,
        )  # fmt: skip

    def _shade(self, camera: kernels.Camera, keys: wp.array, rgb: wp.array, first: int) -> None:
        wp.launch(
            kernels.shade_pixels,
            dim=len(keys),
            inputs=[
                camera, self._light, self._tables, first, self._triangles, self._triangle_material,
                self._materials, self._textures, self._texels, self._uvs, self._normal, self._projected, keys, rgb,
            ],
            device=_DEVICE,
        )  # fmt: skip

    def _locate(
        self,
        camera: kernels.Camera,
        keys: wp.array,
        points: wp.array,
        segments: wp.array,
        first: int,
    ) -> None:
        wp.launch(
            kernels.locate_pixels,
            dim=len(keys),
            inputs=[
                camera,
                first,
                self._triangle_material,
                self._materials,
                keys,
                points,
                segments,
            ],
            device=_DEVICE,
        )


def _make_camera(placement: CameraPlacement) -> kernels.Camera:
    camera = kernels.Camera()
    to_camera = np.linalg.inv(placement.transform_camera_to_world)
    camera.rotation = wp.mat33(*to_camera[:3, :3].ravel())
    camera.position = wp.vec3(*placement.position)
    intrinsics = placement.intrinsics
    camera.focal = float(intrinsics[0, 0])
    camera.centre_x, camera.centre_y = float(intrinsics[0, 2]), float(intrinsics[1, 2])
    camera.width, camera.height = placement.width, placement.height
    camera.near = placement.near
    return camera


def _make_material(surface: Surface, segment: int) -> kernels.Material:
    material = kernels.Material()
    material.colour = wp.vec3(*surface.colour)
    material.roughness = surface.roughness
    material.metallic = surface.metallic
    material.specular = surface.specular
    material.inside_shade = surface.inside_shade
    material.texture = -1
    material.segment = segment
    return material


def _join(parts: Sequence[np.ndarray]) -> np.ndarray:
    return np.concatenate(parts)


def _make(values: np.ndarray, dtype: type, kind: type = np.float32) -> wp.array:
    if dtype is wp.int32:
        kind = np.int32
    return wp.array(np.ascontiguousarray(values, dtype=kind), dtype=dtype, device=_DEVICE)
