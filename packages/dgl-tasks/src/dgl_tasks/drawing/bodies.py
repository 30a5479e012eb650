"""Meshes of bodies, to draw: those that SAPIEN shows, those that it shall show, and props."""

from collections.abc import Sequence

import numpy as np
import sapien
from sapien import render

from dgl_assets.props import PropPart
from dgl_physics.drawing.mesh import Image, Mesh, SurfaceLook

_STRAIGHT = 0.08  # SAPIEN's unit of specular reflection
_PROP_SPECULAR = 0.024


def make_part_mesh(part: PropPart, *, texels: int, segment: int = 0) -> Mesh:
    """Make the mesh of a prop's part; a tile of wood has `texels` along each side."""
    finish, uvs, image = part.finish, part.uvs, None
    if finish.wood is not None:
        maps = finish.wood.render(texels)
        image, uvs = Image(pixels=maps.base_colour), maps.compute_uvs(uvs)
    return Mesh(
        vertices=part.vertices,
        normals=part.normals,
        faces=part.faces,
        uvs=uvs,
        surface=SurfaceLook(
            colour=finish.colour,
            roughness=finish.roughness,
            metallic=finish.metallic,
            specular=_PROP_SPECULAR,
            image=image,
        ),
        segment=segment,
    )


class ShownMeshes:
    """Meshes that an entity shows in SAPIEN's pictures, where they are fixed once shown."""

    def __init__(self, entity: sapien.Entity) -> None:
        """Show nothing yet."""
        self.entity = entity
        self._component: render.RenderBodyComponent | None = None
        self._materials: dict[SurfaceLook, list[render.RenderMaterial]] = {}

    def replace(self, meshes: Sequence[Mesh]) -> None:
        """Show these meshes instead, whose frame is the entity's.

        SAPIEN culls back faces, so that a surface with an inside is shown with both windings.
        """
        component, before = render.RenderBodyComponent(), self._materials
        self._materials = {
            mesh.surface: before.get(mesh.surface) or _make_materials(mesh.surface)
            for mesh in meshes
        }
        for mesh in meshes:
            for side, material in zip((1, -1), self._materials[mesh.surface], strict=False):
                shape = render.RenderShapeTriangleMesh(
                    vertices=np.asarray(mesh.vertices, dtype=np.float32),
                    triangles=np.asarray(mesh.faces[:, ::side], dtype=np.uint32),
                    normals=side * np.asarray(mesh.normals, dtype=np.float32),
                    uvs=np.asarray(mesh.uvs, dtype=np.float32),
                    material=material,
                )
                component.attach(shape)
        if self._component is not None:
            self.entity.remove_component(self._component)
        self.entity.add_component(component)
        self._component = component


def _make_materials(surface: SurfaceLook) -> list[render.RenderMaterial]:
    """Make the material of the outside and, if it is seen, that of the inside."""
    shades = (1.0, surface.inside_shade) if surface.inside_shade else (1.0,)
    return [_make_material(surface, shade) for shade in shades]


def _make_material(surface: SurfaceLook, shade: float) -> render.RenderMaterial:
    material = render.RenderMaterial()
    material.base_color = [*(shade * c for c in surface.colour), 1.0]
    material.roughness, material.metallic = surface.roughness, surface.metallic
    material.specular = surface.specular / _STRAIGHT
    if surface.image is not None:
        # sRGB is close to a power law, so a linear factor is this factor on its values
        pixels = (surface.image.pixels * shade ** (1 / 2.2)).astype(np.uint8)
        opaque = np.full((*pixels.shape[:2], 1), 255, dtype=np.uint8)
        material.base_color_texture = render.RenderTexture2D(
            np.concatenate([pixels, opaque], axis=2),
            "R8G8B8A8Unorm",
            mipmap_levels=max(1, int(np.log2(min(pixels.shape[:2])))),
            address_mode="repeat" if surface.image.is_repeated else "edge",
            srgb=True,
        )
    return material


def read_meshes(entity: sapien.Entity, body: int | None) -> list[Mesh]:
    """Read everything that an entity shows.

    Args:
        entity: Of a scene that can render.
        body: Number of the body that it becomes; None for what never moves.
    """
    return [
        _read_part(shape, part, entity.per_scene_id, body)
        for component in entity.components
        if isinstance(component, render.RenderBodyComponent)
        for shape in component.render_shapes
        for part in shape.parts
    ]


def _read_part(
    shape: render.RenderShape,
    part: render.RenderShapeTriangleMeshPart,
    segment: int,
    body: int | None,
) -> Mesh:
    T = shape.local_pose.to_transformation_matrix()
    scale = _get_scale(shape)
    faces = np.asarray(part.triangles, dtype=np.int32).reshape(-1, 3)
    if shape.front_face == "clockwise":
        faces = faces[:, ::-1]
    return Mesh(
        vertices=np.asarray(part.vertices) * scale @ T[:3, :3].T + T[:3, 3],
        normals=np.asarray(part.get_vertex_normal()) / scale @ T[:3, :3].T,
        faces=faces,
        uvs=np.asarray(part.get_vertex_uv()),
        surface=_read_surface(part.material),
        segment=segment,
        body=body,
    )


def _get_scale(shape: render.RenderShape) -> np.ndarray:
    """Factors on a shape's vertices: those of most primitives are of unit size."""
    if isinstance(shape, render.RenderShapeTriangleMesh | render.RenderShapePlane):
        return np.asarray(shape.scale)
    if isinstance(shape, render.RenderShapeBox):
        return np.asarray(shape.half_size)
    if isinstance(shape, render.RenderShapeSphere):
        return np.full(3, shape.radius)
    if isinstance(shape, render.RenderShapeCylinder):
        return np.array([shape.half_length, shape.radius, shape.radius])
    return np.ones(3)


def _read_surface(material: render.RenderMaterial) -> SurfaceLook:
    r, g, b, _ = material.base_color
    texture = material.base_color_texture
    image = None
    if texture is not None:
        pixels = np.ascontiguousarray(texture.download()[..., :3])
        image = Image(pixels=pixels, is_repeated=texture.address_mode == "repeat")
    return SurfaceLook(
        colour=(r, g, b),
        roughness=material.roughness,
        metallic=material.metallic,
        specular=_STRAIGHT * material.specular,
        image=image,
    )
