"""What SAPIEN's bodies look like, as meshes to draw."""

import numpy as np
import sapien
from sapien.render import (
    RenderBodyComponent,
    RenderMaterial,
    RenderShape,
    RenderShapeTriangleMesh,
    RenderShapeTriangleMeshPart,
)

from dgl_tasks.drawing.mesh import Image, Mesh, Surface

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
        if isinstance(component, RenderBodyComponent)
        for shape in component.render_shapes
        for part in shape.parts
    ]


def _read_part(
    shape: RenderShape,
    part: RenderShapeTriangleMeshPart,
    segment: int,
    body: int | None,
) -> Mesh:
    T = shape.local_pose.to_transformation_matrix()
    # primitives have their size in their vertices
    scale = np.asarray(shape.scale if isinstance(shape, RenderShapeTriangleMesh) else (1, 1, 1))
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


def _read_surface(material: RenderMaterial) -> Surface:
    r, g, b, _ = material.base_color
    texture = material.base_color_texture
    image = None
    if texture is not None:
        pixels = np.ascontiguousarray(texture.download()[..., :3])
        image = Image(pixels=pixels, is_repeated=texture.address_mode == "repeat")
    return Surface(
        colour=(r, g, b),
        roughness=material.roughness,
        metallic=material.metallic,
        specular=_STRAIGHT * material.specular,
        image=image,
    )
