# type: ignore  # kernels are in the language of Warp
"""Data of the rasteriser's kernels."""

import warp as wp


@wp.struct
class Camera:
    """A pinhole camera."""

    rotation: wp.mat33
    """World to camera: x right, y down, z forward."""
    position: wp.vec3
    """Optical centre [m], world frame."""
    focal: wp.float32
    """Focal length [pixels]."""
    centre_x: wp.float32
    """Column of the optical axis [pixels]."""
    centre_y: wp.float32
    """Row of the optical axis [pixels]."""
    width: wp.int32
    """[pixels]"""
    height: wp.int32
    """[pixels]"""
    near: wp.float32
    """Near plane [m]."""
    far: wp.float32
    """Far plane [m]."""


@wp.struct
class Geometry:
    """All triangles; fixed meshes come first."""

    body: wp.array(dtype=wp.int32)
    """Number of the pose that a vertex moves with, shape (V,)."""
    local: wp.array(dtype=wp.vec3)
    """Vertices [m], shape (V,), frame of their body."""
    local_normal: wp.array(dtype=wp.vec3)
    """Their normals, shape (V,), frame of their body."""
    uv: wp.array(dtype=wp.vec2)
    """Texture coordinates, shape (V,)."""
    triangles: wp.array(dtype=wp.vec3i)
    """Vertices of each, counter-clockwise from outside, shape (F,)."""
    material: wp.array(dtype=wp.int32)
    """Number of the material of each triangle, shape (F,)."""
    normal: wp.array(dtype=wp.vec3)
    """Normals in the world frame, shape (V,); of any length."""
    projected: wp.array(dtype=wp.vec3)
    """(Column, row, 1) of each vertex in the picture, times its depth [m], shape (V,)."""


@wp.struct
class ShadedMaterial:
    """Look of a surface."""

    colour: wp.vec3
    """Base colour, linear; unused with a texture."""
    roughness: wp.float32
    """0 for a mirror, 1 for chalk."""
    metallic: wp.float32
    """0 for plastic, 1 for bare metal."""
    specular: wp.float32
    """Share of perpendicular light that is reflected, metal aside."""
    inside_shade: wp.float32
    """Brightness of the back, a factor on the linear colour; 0 to cull it."""
    texture: wp.int32
    """Number of its texture; -1 for none."""
    segment: wp.int32
    """Number in the segmentation; -1 for a shadow, which darkens the pixels behind it."""


@wp.struct
class TextureLevels:
    """A picture and its mipmaps, one after another among all texels."""

    first: wp.int32
    """First texel of the finest level."""
    width: wp.int32
    """[texels]"""
    height: wp.int32
    """[texels]"""
    levels: wp.int32
    """Number of mipmap levels."""
    is_repeated: wp.int32
    """1 to repeat the picture; 0 to extend its edge."""


@wp.struct
class Looks:
    """Surfaces and light."""

    materials: wp.array(dtype=ShadedMaterial)
    textures: wp.array(dtype=TextureLevels)
    texels: wp.array(dtype=wp.vec3ub)
    """Of all textures, sRGB."""
    to_lamp: wp.vec3
    """Unit vector to the lamp."""
    lamp: wp.vec3
    """Light of the lamp, linear."""
    shade: wp.float32
    """Brightness in shadow, a factor on the values of the picture."""
    dome: wp.array2d(dtype=wp.vec3)
    """Light of the dome, linear, by the sine of the elevation in [-1, 1]: the dome itself, its
    diffuse light, and one row for the reflection of each material."""
    mirror: wp.array2d(dtype=wp.vec2)
    """Factor and term of each material's reflection of the dome, by the cosine to the eye in
    [0, 1]."""
    decode: wp.array(dtype=wp.float32)
    """Linear value of each of 256 values of a texture."""
    encode: wp.array(dtype=wp.uint8)
    """Value in the picture by the root of the linear one in [0, 1]."""
