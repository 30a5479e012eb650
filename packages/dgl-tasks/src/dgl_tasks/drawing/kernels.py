"""Warp kernels of the rasteriser: vertices to the picture, triangles to pixels, pixels to colours.

A pixel holds one 64-bit key: the bits of the inverse depth above, the number of the triangle below. The
largest key is what is seen, whatever the order in which triangles are drawn.
"""

# pyright: reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportIndexIssue=false
# pyright: reportOperatorIssue=false, reportCallIssue=false, reportArgumentType=false
import warp as wp

wp.set_module_options({"enable_backward": False, "fast_math": True})

NOTHING = wp.constant(wp.uint64(0))
"""Key of a pixel that shows nothing."""
_EDGE = wp.constant(-1.0e-5)  # weights down to this are inside: neighbours leave no crack


@wp.struct
class Camera:
    """A pinhole camera."""

    rotation: wp.mat33
    """World to camera: x right, y down, z forward."""
    position: wp.vec3
    """Optical centre [m], world frame."""
    focal: wp.float32
    """[pixels]"""
    centre_x: wp.float32
    centre_y: wp.float32
    width: wp.int32
    height: wp.int32
    near: wp.float32
    """Near plane [m]."""


@wp.struct
class Material:
    """What a surface looks like."""

    colour: wp.vec3
    """Base colour, linear; unused with a texture."""
    roughness: wp.float32
    metallic: wp.float32
    specular: wp.float32
    """Share of the light that falls straight on it and is reflected, metal aside."""
    inside_shade: wp.float32
    """Brightness of its back, a factor on the linear colour; 0 where the back is not seen."""
    texture: wp.int32
    """Number of its texture; -1 for none."""
    segment: wp.int32
    """What the segmentation picture shows; -1 for a shadow, which darkens what is there already."""


@wp.struct
class Texture:
    """A picture with its mipmaps, one after the other among all texels."""

    first: wp.int32
    """Where the finest level begins [texels]."""
    width: wp.int32
    height: wp.int32
    levels: wp.int32
    is_repeated: wp.int32
    """Whether the picture repeats; otherwise its edge goes on."""


@wp.struct
class Light:
    """One lamp, and a dome that is the same all around."""

    toward: wp.vec3
    """Unit vector to the lamp."""
    colour: wp.vec3
    """Light of the lamp, linear."""
    shade: wp.float32
    """Brightness of what is in shadow, a factor on the values of the picture."""


@wp.struct
class Tables:
    """Functions that are looked up."""

    dome: wp.array2d(dtype=wp.vec3)
    """Light of the dome, linear: a row as it is, one as matt surfaces see it, and one as each material
    mirrors it, by the sine of the height in [-1, 1]."""
    mirror: wp.array2d(dtype=wp.vec2)
    """Share of that light that each material mirrors, a factor on its reflection of straight light and a term, by
    the cosine to the eye in [0, 1]."""
    decode: wp.array(dtype=wp.float32)
    """Linear value of each of 256 values of a texture."""
    encode: wp.array(dtype=wp.uint8)
    """Value in the picture by the root of the linear one."""


@wp.kernel
def place_vertices(
    camera: Camera,
    first: wp.int32,
    poses: wp.array(dtype=wp.transform),
    body: wp.array(dtype=wp.int32),
    local: wp.array(dtype=wp.vec3),
    local_normal: wp.array(dtype=wp.vec3),
    normal: wp.array(dtype=wp.vec3),
    projected: wp.array(dtype=wp.vec3),
):
    """Bring vertices from `first` on into the picture, as (column, row, 1) times the depth."""
    i = first + wp.tid()
    pose = poses[body[i]]
    x = wp.transform_point(pose, local[i])
    normal[i] = wp.transform_vector(pose, local_normal[i])
    projected[i] = _project(camera, x)


@wp.func
def _project(camera: Camera, x: wp.vec3) -> wp.vec3:
    c = camera.rotation * (x - camera.position)
    return wp.vec3(
        camera.focal * c[0] + camera.centre_x * c[2],
        camera.focal * c[1] + camera.centre_y * c[2],
        c[2],
    )


@wp.kernel
def draw_triangles(
    camera: Camera,
    first: wp.int32,
    triangles: wp.array(dtype=wp.vec3i),
    triangle_material: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    projected: wp.array(dtype=wp.vec3),
    keys: wp.array(dtype=wp.uint64),
):
    """Enter triangles in the keys of the pixels they cover.

    Homogeneous coordinates need no clipping (Olano and Greer 1997). They are counted from a pixel
    near the triangle, or rounding would spoil small ones.
    """
    t = first + wp.tid()
    corners = triangles[t]
    a = projected[corners[0]]
    b = projected[corners[1]]
    c = projected[corners[2]]
    near = camera.near
    if a[2] < near and b[2] < near and c[2] < near:
        return
    x0 = wp.int32(0)
    y0 = wp.int32(0)
    x1 = camera.width - 1
    y1 = camera.height - 1
    if a[2] >= near and b[2] >= near and c[2] >= near:
        ia = 1.0 / a[2]
        ib = 1.0 / b[2]
        ic = 1.0 / c[2]
        ax = a[0] * ia
        ay = a[1] * ia
        bx = b[0] * ib
        by = b[1] * ib
        cx = c[0] * ic
        cy = c[1] * ic
        # most triangles end here: they show their back, or lie between the centres of pixels
        if (bx - ax) * (cy - ay) > (by - ay) * (cx - ax) and materials[
            triangle_material[t]
        ].inside_shade == 0.0:
            return
        x0 = wp.max(x0, wp.int32(wp.ceil(wp.min(ax, wp.min(bx, cx)) - 0.5)))
        x1 = wp.min(x1, wp.int32(wp.floor(wp.max(ax, wp.max(bx, cx)) - 0.5)))
        y0 = wp.max(y0, wp.int32(wp.ceil(wp.min(ay, wp.min(by, cy)) - 0.5)))
        y1 = wp.min(y1, wp.int32(wp.floor(wp.max(ay, wp.max(by, cy)) - 0.5)))
    if x0 > x1 or y0 > y1:
        return
    origin = wp.vec3(wp.float32(x0) + 0.5, wp.float32(y0) + 0.5, 0.0)
    a = a - origin * a[2]
    b = b - origin * b[2]
    c = c - origin * c[2]
    ea = wp.cross(b, c)
    eb = wp.cross(c, a)
    ec = wp.cross(a, b)
    volume = wp.dot(a, ea)
    # Rows run downward: the front is clockwise, and has a negative volume.
    if volume == 0.0:
        return
    if volume > 0.0 and materials[triangle_material[t]].inside_shade == 0.0:
        return
    s = 1.0 / volume
    ea = ea * s
    eb = eb * s
    ec = ec * s
    total = ea + eb + ec  # of the weights: the inverse depth
    number = wp.uint64(t + 1)
    # where a row crosses the edges, per unit of their value at its beginning
    ia = _invert(ea[0])
    ib = _invert(eb[0])
    ic = _invert(ec[0])
    last = wp.float32(x1 - x0)
    for y in range(y0, y1 + 1):
        fy = wp.float32(y - y0)
        ra = ea[1] * fy + ea[2]
        rb = eb[1] * fy + eb[2]
        rc = ec[1] * fy + ec[2]
        rs = total[1] * fy + total[2]
        low = wp.float32(0.0)
        high = last
        if last > 3.0:  # a long thin triangle fills little of its rectangle
            low = wp.max(
                low,
                wp.max(
                    _enter(ea[0], ra * ia), wp.max(_enter(eb[0], rb * ib), _enter(ec[0], rc * ic))
                ),
            )
            high = wp.min(
                high,
                wp.min(
                    _leave(ea[0], ra * ia), wp.min(_leave(eb[0], rb * ib), _leave(ec[0], rc * ic))
                ),
            )
        for x in range(x0 + wp.int32(low), x0 + wp.int32(high) + 1):
            fx = wp.float32(x - x0)
            inverse = total[0] * fx + rs
            least = wp.min(ea[0] * fx + ra, wp.min(eb[0] * fx + rb, ec[0] * fx + rc))
            if least >= _EDGE * inverse and inverse * near <= 1.0 and inverse > 0.0:
                key = (wp.uint64(wp.cast(inverse, wp.uint32)) << wp.uint64(32)) | number
                wp.atomic_max(keys, y * camera.width + x, key)


@wp.func
def _invert(slope: wp.float32) -> wp.float32:
    return wp.where(slope == 0.0, 0.0, 1.0 / slope)


@wp.func
def _enter(slope: wp.float32, place: wp.float32) -> wp.float32:
    """Where a row comes inside of an edge, up to a pixel before; `place` is minus where it crosses it."""
    return wp.where(slope > 0.0, -place - 1.0, -1.0)


@wp.func
def _leave(slope: wp.float32, place: wp.float32) -> wp.float32:
    return wp.where(slope < 0.0, 1.0 - place, 1.0e6)


@wp.func
def _get_triangle(key: wp.uint64) -> wp.int32:
    """Number of the triangle that a pixel shows; -1 for none."""
    return wp.int32(key & wp.uint64(0xFFFFFFFF)) - 1


@wp.func
def _get_depth(key: wp.uint64) -> wp.float32:
    return 1.0 / wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)


@wp.func
def _trace(camera: Camera, x: wp.int32, y: wp.int32) -> wp.vec3:
    """Way through a pixel's centre, of depth 1 along the optical axis, world frame."""
    ray = wp.vec3(
        (wp.float32(x) + 0.5 - camera.centre_x) / camera.focal,
        (wp.float32(y) + 0.5 - camera.centre_y) / camera.focal,
        1.0,
    )
    return wp.transpose(camera.rotation) * ray


@wp.kernel
def locate_pixels(
    camera: Camera,
    first: wp.int32,
    triangle_material: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    keys: wp.array(dtype=wp.uint64),
    points: wp.array(dtype=wp.vec3),
    segments: wp.array(dtype=wp.int32),
):
    """Write where the pixels' surfaces are and what they belong to, for triangles from `first` on."""
    i = wp.tid()
    t = _get_triangle(keys[i])
    if t < first:
        return
    segment = materials[triangle_material[t]].segment
    if segment < 0:
        return
    segments[i] = segment
    ray = _trace(camera, i % camera.width, i // camera.width)
    points[i] = camera.position + ray * _get_depth(keys[i])


@wp.func
def _fetch(
    texture: Texture,
    texels: wp.array(dtype=wp.vec3ub),
    decode: wp.array(dtype=wp.float32),
    level: wp.int32,
    u: wp.float32,
    v: wp.float32,
) -> wp.vec3:
    """Blend the four texels of a level around a place, linear."""
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
        # -1 and the width are all that can come of places in [0, 1)
        x0 = wp.where(x0 < 0, width - 1, x0)
        y0 = wp.where(y0 < 0, height - 1, y0)
        x1 = wp.where(x1 >= width, 0, x1)
        y1 = wp.where(y1 >= height, 0, y1)
    else:
        x0 = wp.clamp(x0, 0, width - 1)
        y0 = wp.clamp(y0, 0, height - 1)
        x1 = wp.clamp(x1, 0, width - 1)
        y1 = wp.clamp(y1, 0, height - 1)
    a = _decode(texels[first + y0 * width + x0], decode)
    b = _decode(texels[first + y0 * width + x1], decode)
    c = _decode(texels[first + y1 * width + x0], decode)
    d = _decode(texels[first + y1 * width + x1], decode)
    return (a * (1.0 - s) + b * s) * (1.0 - t) + (c * (1.0 - s) + d * s) * t


@wp.func
def _decode(texel: wp.vec3ub, decode: wp.array(dtype=wp.float32)) -> wp.vec3:
    return wp.vec3(
        decode[wp.int32(texel[0])], decode[wp.int32(texel[1])], decode[wp.int32(texel[2])]
    )


@wp.func
def _sample(
    texture: Texture,
    texels: wp.array(dtype=wp.vec3ub),
    decode: wp.array(dtype=wp.float32),
    uv: wp.vec2,
    right: wp.vec2,
    down: wp.vec2,
) -> wp.vec3:
    """Look a colour up, linear, as fine as the pixel: `right` and `down` are places of its neighbours."""
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
    colour = _fetch(texture, texels, decode, coarse, u, v)
    if share > 0.0:
        colour += (_fetch(texture, texels, decode, coarse + 1, u, v) - colour) * share
    return colour


@wp.func
def _look_up_dome(dome: wp.array2d(dtype=wp.vec3), row: wp.int32, sine: wp.float32) -> wp.vec3:
    y = (0.5 + 0.5 * wp.clamp(sine, -1.0, 1.0)) * wp.float32(dome.shape[1] - 1)
    j = wp.min(wp.int32(y), dome.shape[1] - 2)
    t = y - wp.float32(j)
    return dome[row, j] * (1.0 - t) + dome[row, j + 1] * t


@wp.func
def _encode(colour: wp.vec3, encode: wp.array(dtype=wp.uint8)) -> wp.vec3ub:
    last = wp.float32(encode.shape[0] - 1)
    return wp.vec3ub(
        encode[wp.int32(wp.sqrt(wp.clamp(colour[0], 0.0, 1.0)) * last + 0.5)],
        encode[wp.int32(wp.sqrt(wp.clamp(colour[1], 0.0, 1.0)) * last + 0.5)],
        encode[wp.int32(wp.sqrt(wp.clamp(colour[2], 0.0, 1.0)) * last + 0.5)],
    )


@wp.func
def _shine(
    number: wp.int32,
    material: Material,
    albedo: wp.vec3,
    n: wp.vec3,
    v: wp.vec3,
    light: Light,
    tables: Tables,
) -> wp.vec3:
    """Light that a surface sends to the eye, linear.

    A matt share and a mirrored one: GGX, Schlick's Fresnel and Smith's shadowing as Karis (2013) writes them.
    """
    to_lamp = wp.max(wp.dot(n, light.toward), 0.0)
    metallic = material.metallic
    colour = wp.cw_mul(
        albedo * (1.0 - metallic),
        light.colour * (to_lamp / wp.pi) + _look_up_dome(tables.dome, 1, n[2]),
    )
    if material.specular == 0.0 and metallic == 0.0:
        return colour
    f0 = wp.vec3(1.0, 1.0, 1.0) * (material.specular * (1.0 - metallic)) + albedo * metallic
    to_eye = wp.clamp(wp.dot(n, v), 1.0e-6, 1.0)
    if to_lamp > 0.0:
        h = wp.normalize(light.toward + v)
        on_h = wp.clamp(wp.dot(n, h), 0.0, 1.0)
        aside = 1.0 - wp.clamp(wp.dot(v, h), 0.0, 1.0)
        aside2 = aside * aside
        alpha = material.roughness * material.roughness
        alpha2 = alpha * alpha
        k = (alpha + 2.0 * material.roughness + 1.0) / 8.0
        spread = on_h * on_h * (alpha2 - 1.0) + 1.0
        hidden = (to_eye * (1.0 - k) + k) * (to_lamp * (1.0 - k) + k)
        lobe = alpha2 * to_lamp / wp.max(4.0 * wp.pi * spread * spread * hidden, 1.0e-6)
        fresnel = f0 + (wp.vec3(1.0, 1.0, 1.0) - f0) * (aside2 * aside2 * aside)
        colour += wp.cw_mul(light.colour, fresnel) * lobe
    share = tables.mirror[number, wp.int32(to_eye * wp.float32(tables.mirror.shape[1] - 1) + 0.5)]
    seen = _look_up_dome(tables.dome, 2 + number, 2.0 * to_eye * n[2] - v[2])
    return colour + wp.cw_mul(seen, f0 * share[0] + wp.vec3(share[1], share[1], share[1]))


@wp.kernel
def shade_pixels(
    camera: Camera,
    light: Light,
    tables: Tables,
    first: wp.int32,
    triangles: wp.array(dtype=wp.vec3i),
    triangle_material: wp.array(dtype=wp.int32),
    materials: wp.array(dtype=Material),
    textures: wp.array(dtype=Texture),
    texels: wp.array(dtype=wp.vec3ub),
    uvs: wp.array(dtype=wp.vec2),
    normal: wp.array(dtype=wp.vec3),
    projected: wp.array(dtype=wp.vec3),
    keys: wp.array(dtype=wp.uint64),
    rgb: wp.array(dtype=wp.vec3ub),
):
    """Write the colours of pixels that show a triangle from `first` on."""
    i = wp.tid()
    t = _get_triangle(keys[i])
    if t < first:
        return
    number = triangle_material[t]
    material = materials[number]
    if material.segment < 0:
        seen = rgb[i]
        rgb[i] = wp.vec3ub(
            wp.uint8(wp.float32(seen[0]) * light.shade),
            wp.uint8(wp.float32(seen[1]) * light.shade),
            wp.uint8(wp.float32(seen[2]) * light.shade),
        )
        return
    x = i % camera.width
    y = i // camera.width
    corners = triangles[t]
    origin = wp.vec3(wp.float32(x) + 0.5, wp.float32(y) + 0.5, 0.0)
    a = projected[corners[0]]
    b = projected[corners[1]]
    c = projected[corners[2]]
    a = a - origin * a[2]
    b = b - origin * b[2]
    c = c - origin * c[2]
    ea = wp.cross(b, c)
    eb = wp.cross(c, a)
    ec = wp.cross(a, b)
    here = _weigh(ea[2], eb[2], ec[2])
    n = normal[corners[0]] * here[0] + normal[corners[1]] * here[1] + normal[corners[2]] * here[2]
    n = wp.normalize(n)
    ray = wp.normalize(_trace(camera, x, y))
    albedo = material.colour
    if material.texture >= 0:
        ua = uvs[corners[0]]
        ub = uvs[corners[1]]
        uc = uvs[corners[2]]
        right = _weigh(ea[2] + ea[0], eb[2] + eb[0], ec[2] + ec[0])
        down = _weigh(ea[2] + ea[1], eb[2] + eb[1], ec[2] + ec[1])
        albedo = _sample(
            textures[material.texture],
            texels,
            tables.decode,
            ua * here[0] + ub * here[1] + uc * here[2],
            ua * right[0] + ub * right[1] + uc * right[2],
            ua * down[0] + ub * down[1] + uc * down[2],
        )
    if wp.dot(a, ea) > 0.0:  # the back
        n = -n
        albedo = albedo * material.inside_shade
    rgb[i] = _encode(_shine(number, material, albedo, n, -ray, light, tables), tables.encode)


@wp.func
def _weigh(a: wp.float32, b: wp.float32, c: wp.float32) -> wp.vec3:
    s = 1.0 / (a + b + c)
    return wp.vec3(a * s, b * s, c * s)


@wp.kernel
def draw_backdrop(camera: Camera, tables: Tables, rgb: wp.array(dtype=wp.vec3ub)):
    """Fill a picture with the dome."""
    i = wp.tid()
    ray = wp.normalize(_trace(camera, i % camera.width, i // camera.width))
    rgb[i] = _encode(_look_up_dome(tables.dome, 0, ray[2]), tables.encode)
