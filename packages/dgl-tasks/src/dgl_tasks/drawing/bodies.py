"""Meshes of SAPIEN's bodies, to draw."""

import numpy as np
import sapien
from sapien import render

from dgl_physics.drawing.mesh import Image, Mesh, SurfaceLook

_STRAIGHT = 0.08  # SAPIEN's unit of specular reflection


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
