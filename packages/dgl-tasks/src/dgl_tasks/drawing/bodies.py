"""What SAPIEN's bodies look like, as meshes to draw."""

import numpy as np
import sapien

from dgl_tasks.drawing.mesh import Image, Mesh, Surface


def read_meshes(entity: sapien.Entity, images: dict[int, Image]) -> list[Mesh]:
    """Read everything that an entity shows.

    Args:
        entity: Of a scene that can render.
        images: Textures that have been read already, by SAPIEN's texture; new ones are added.
    """
    meshes = []
    for component in entity.components:
        if isinstance(component, sapien.render.RenderBodyComponent):
            for shape in component.render_shapes:
                meshes += [_read_part(shape, part, entity.per_scene_id, images) for part in shape.parts]
    return meshes


def _read_part(shape, part, segment: int, images: dict[int, Image]) -> Mesh:
    T = shape.local_pose.to_transformation_matrix()
    scale = np.asarray(getattr(shape, "scale", (1.0, 1.0, 1.0)))
    normals = np.asarray(part.get_vertex_normal()) / scale @ T[:3, :3].T
    faces = np.asarray(part.triangles, dtype=np.int32).reshape(-1, 3)
    if shape.front_face == "clockwise":
        faces = faces[:, ::-1]
    return Mesh(
        vertices=np.asarray(part.vertices) * scale @ T[:3, :3].T + T[:3, 3],
        normals=normals,
        faces=faces,
        uvs=part.get_vertex_uv(),
        surface=_read_surface(part.material, images),
        segment=segment,
    )


def _read_surface(material, images) -> Surface:
    texture = material.base_color_texture
    image = None
    if texture is not None:
        image = Image(pixels=np.ascontiguousarray(texture.download()[..., :3]), is_repeated=texture.address_mode == "repeat")
    return Surface(
        colour=tuple(material.base_color[:3]),
        roughness=material.roughness,
        metallic=material.metallic,
        specular=0.08 * material.specular,
        image=image,
    )
