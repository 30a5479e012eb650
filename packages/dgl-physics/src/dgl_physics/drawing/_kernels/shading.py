# type: ignore  # kernels are in the language of Warp
"""Colours of pixels: textures and light."""

import warp as wp

from dgl_physics.drawing._kernels.raster import get_triangle, trace
from dgl_physics.drawing._kernels.types import Camera, Geometry, Looks, TextureLevels

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def draw_backdrop(camera: Camera, looks: Looks, rgb: wp.array(dtype=wp.vec3ub)):
    """Fill a picture with the dome."""
    i = wp.tid()
    ray = wp.normalize(trace(camera, i))
    rgb[i] = _encode(looks, _look_up_dome(looks, 0, ray[2]))


@wp.kernel
def shade_pixels(
    camera: Camera,
    first: wp.int32,
    geometry: Geometry,
    looks: Looks,
    keys: wp.array(dtype=wp.uint64),
    rgb: wp.array(dtype=wp.vec3ub),
):
    """Write the colours of pixels that show a triangle from `first` on."""
    i = wp.tid()
    t = get_triangle(keys[i])
    if t < first:
        return
    number = geometry.material[t]
    material = looks.materials[number]
    if material.segment < 0:
        seen = rgb[i]
        rgb[i] = wp.vec3ub(
            wp.uint8(wp.float32(seen[0]) * looks.shade),
            wp.uint8(wp.float32(seen[1]) * looks.shade),
            wp.uint8(wp.float32(seen[2]) * looks.shade),
        )
        return
    # Weights of the corners at this pixel and, for the texture, at its neighbours.
    corners = geometry.triangles[t]
    origin = wp.vec3(wp.float32(i % camera.width) + 0.5, wp.float32(i // camera.width) + 0.5, 0.0)
    a = geometry.projected[corners[0]]
    b = geometry.projected[corners[1]]
    c = geometry.projected[corners[2]]
    a = a - origin * a[2]
    b = b - origin * b[2]
    c = c - origin * c[2]
    ea = wp.cross(b, c)
    eb = wp.cross(c, a)
    ec = wp.cross(a, b)
    here = _weigh(ea[2], eb[2], ec[2])
    n = wp.normalize(
        geometry.normal[corners[0]] * here[0]
        + geometry.normal[corners[1]] * here[1]
        + geometry.normal[corners[2]] * here[2]
    )
    albedo = material.colour
    if material.texture >= 0:
        ua = geometry.uv[corners[0]]
        ub = geometry.uv[corners[1]]
        uc = geometry.uv[corners[2]]
        right = _weigh(ea[2] + ea[0], eb[2] + eb[0], ec[2] + ec[0])
        down = _weigh(ea[2] + ea[1], eb[2] + eb[1], ec[2] + ec[1])
        albedo = _sample(
            looks,
            looks.textures[material.texture],
            ua * here[0] + ub * here[1] + uc * here[2],
            ua * right[0] + ub * right[1] + uc * right[2],
            ua * down[0] + ub * down[1] + uc * down[2],
        )
    if wp.dot(a, ea) > 0.0:  # the back
        n = -n
        albedo = albedo * material.inside_shade
    eye = -wp.normalize(trace(camera, i))
    rgb[i] = _encode(looks, _shine(looks, number, albedo, n, eye))


@wp.func
def _weigh(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.vec3:
    s = 1.0 / (a + b + c)
    return wp.vec3(a * s, b * s, c * s)


@wp.func
def _sample(
    looks: Looks, texture: TextureLevels, uv: wp.vec2, right: wp.vec2, down: wp.vec2
) -> wp.vec3:
    """Sample a texture, linear, at the pixel's scale; `right`, `down`: uv of its neighbours."""
    u = uv[0]
    v = uv[1]
    size = wp.vec2(wp.float32(texture.width), wp.float32(texture.height))
    dx = wp.length(wp.cw_mul(right - uv, size))
    dy = wp.length(wp.cw_mul(down - uv, size))
    if texture.is_repeated != 0:
        u = u - wp.floor(u)
        v = v - wp.floor(v)
    level = wp.clamp(wp.log2(wp.max(wp.max(dx, dy), 1.0e-6)), 0.0, wp.float32(texture.levels - 1))
    coarse = wp.int32(level)
    share = level - wp.float32(coarse)
    colour = _fetch(looks, texture, coarse, u, v)
    if share > 0.0:
        colour += (_fetch(looks, texture, coarse + 1, u, v) - colour) * share
    return colour


@wp.func
def _fetch(
    looks: Looks,
    texture: TextureLevels,
    level: wp.int32,
    u: wp.float32,
    v: wp.float32,
) -> wp.vec3:
    """Blend the four texels of a level around a position, linear."""
    first = texture.first
    width = texture.width
    height = texture.height
    for _k in range(level):
        first += width * height
        width = wp.max(1, width / 2)
        height = wp.max(1, height / 2)
    x = u * wp.float32(width) - 0.5
    y = v * wp.float32(height) - 0.5
    fx = wp.floor(x)
    fy = wp.floor(y)
    s = x - fx
    t = y - fy
    x0 = wp.int32(fx)
    y0 = wp.int32(fy)
    x1 = x0 + 1
    y1 = y0 + 1
    if texture.is_repeated != 0:
        # -1 and the width are all that can come of places in [0, 1]
        x0 = wp.where(x0 < 0, width - 1, x0)
        y0 = wp.where(y0 < 0, height - 1, y0)
        x1 = wp.where(x1 >= width, 0, x1)
        y1 = wp.where(y1 >= height, 0, y1)
    x0 = wp.clamp(x0, 0, width - 1)
    y0 = wp.clamp(y0, 0, height - 1)
    x1 = wp.clamp(x1, 0, width - 1)
    y1 = wp.clamp(y1, 0, height - 1)
    a = _decode(looks, first + y0 * width + x0)
    b = _decode(looks, first + y0 * width + x1)
    c = _decode(looks, first + y1 * width + x0)
    d = _decode(looks, first + y1 * width + x1)
    return (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t


@wp.func
def _decode(looks: Looks, place: wp.int32) -> wp.vec3:
    texel = looks.texels[place]
    return wp.vec3(
        looks.decode[wp.int32(texel[0])],
        looks.decode[wp.int32(texel[1])],
        looks.decode[wp.int32(texel[2])],
    )


@wp.func
def _look_up_dome(looks: Looks, row: wp.int32, sine: wp.float32) -> wp.vec3:
    y = (0.5 + 0.5 * wp.clamp(sine, -1.0, 1.0)) * wp.float32(looks.dome.shape[1] - 1)
    j = wp.clamp(wp.int32(y), 0, looks.dome.shape[1] - 2)
    t = y - wp.float32(j)
    return looks.dome[row, j] * (1.0 - t) + looks.dome[row, j + 1] * t


@wp.func
def _shine(looks: Looks, number: wp.int32, albedo: wp.vec3, n: wp.vec3, v: wp.vec3) -> wp.vec3:
    """Compute the light that a surface sends to the eye, linear.

    Diffuse and specular: GGX, Schlick's Fresnel and Smith's shadowing, after Karis (2013).
    """
    material = looks.materials[number]
    metallic = material.metallic
    on_lamp = wp.max(wp.dot(n, looks.to_lamp), 0.0)
    colour = wp.cw_mul(
        albedo * (1.0 - metallic),
        looks.lamp * (on_lamp / wp.pi) + _look_up_dome(looks, 1, n[2]),
    )
    if material.specular == 0.0 and metallic == 0.0:
        return colour
    straight = wp.vec3(material.specular * (1.0 - metallic)) + albedo * metallic
    on_eye = wp.clamp(wp.dot(n, v), 1.0e-6, 1.0)
    if on_lamp > 0.0:
        h = wp.normalize(looks.to_lamp + v)
        on_h = wp.clamp(wp.dot(n, h), 0.0, 1.0)
        aside = 1.0 - wp.clamp(wp.dot(v, h), 0.0, 1.0)
        alpha = material.roughness * material.roughness
        alpha2 = alpha * alpha
        k = (alpha + 2.0 * material.roughness + 1.0) / 8.0
        spread = on_h * on_h * (alpha2 - 1.0) + 1.0
        hidden = (on_eye * (1.0 - k) + k) * (on_lamp * (1.0 - k) + k)
        lobe = alpha2 * on_lamp / wp.max(4.0 * wp.pi * spread * spread * hidden, 1.0e-6)
        aside2 = aside * aside
        fresnel = straight + (wp.vec3(1.0) - straight) * (aside2 * aside2 * aside)
        colour += wp.cw_mul(looks.lamp, fresnel) * lobe
    last = looks.mirror.shape[1] - 1
    share = looks.mirror[number, wp.clamp(wp.int32(on_eye * wp.float32(last) + 0.5), 0, last)]
    seen = _look_up_dome(looks, 2 + number, 2.0 * on_eye * n[2] - v[2])
    return colour + wp.cw_mul(seen, straight * share[0] + wp.vec3(share[1]))


@wp.func
def _encode(looks: Looks, colour: wp.vec3) -> wp.vec3ub:
    return wp.vec3ub(
        _encode_value(looks, colour[0]),
        _encode_value(looks, colour[1]),
        _encode_value(looks, colour[2]),
    )


@wp.func
def _encode_value(looks: Looks, value: wp.float32) -> wp.uint8:
    last = looks.encode.shape[0] - 1
    place = wp.sqrt(wp.clamp(value, 0.0, 1.0)) * wp.float32(last) + 0.5
    return looks.encode[wp.clamp(wp.int32(place), 0, last)]
