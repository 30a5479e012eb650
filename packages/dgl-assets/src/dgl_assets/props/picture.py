"""Pictures of props, computed in numpy: surfaces by a depth buffer, light by many small lamps.

Visibility of lamp and sky is found by splatting points of the surface into depth maps, one for
each direction that light comes from; a large lamp and the sky are many directions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from dgl_assets.materials.maps import GAMMA
from dgl_assets.props.prop import Prop, PropPart

BACKGROUND = (244, 242, 238)
_KEY = np.array([-0.55, -0.55, 1.0]) / np.linalg.norm([-0.55, -0.55, 1.0])
_KEY_SPREAD, _KEY_LAMPS, _SKY_LAMPS = 0.16, 20, 44
_KEY_LIGHT, _SKY_LIGHT = 0.80, 0.42
_TEXELS, _POINTS = 220, 120_000
_OVERSAMPLING = 2


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A pinhole camera that looks at a prop from in front, from the left and above."""

    eye: np.ndarray
    right: np.ndarray
    up: np.ndarray
    toward: np.ndarray
    """Unit vector from the target to the eye."""
    focal: float
    """Pixels at 1 m."""
    size: tuple[int, int]
    """Width and height [pixels]."""

    def project(self, points: np.ndarray) -> np.ndarray:
        """Columns, rows [pixels] and distances along the axis [m], shape (N, 3)."""
        offset = points - self.eye
        depth = -offset @ self.toward
        return np.stack(
            [
                self.size[0] / 2 + self.focal * (offset @ self.right) / depth,
                self.size[1] / 2 - self.focal * (offset @ self.up) / depth,
                depth,
            ],
            axis=1,
        )

    def compute_rays(self) -> np.ndarray:
        """Direction through each pixel, shape (H, W, 3), with depth 1 along the axis."""
        width, height = self.size
        x = (np.arange(width) + 0.5 - width / 2) / self.focal
        y = -(np.arange(height) + 0.5 - height / 2) / self.focal
        return x[None, :, None] * self.right + y[:, None, None] * self.up - self.toward


def draw_prop(
    prop: Prop, *, size: tuple[int, int] = (480, 400), azimuth: float = 0.5, elevation: float = 0.32
) -> tuple[np.ndarray, View]:
    """Draw a prop under a large lamp and a pale sky.

    Args:
        prop: What to draw; solid parts fill the picture.
        size: Width and height of the picture [pixels].
        azimuth: Of the viewer, from the front (-y) to the left [rad].
        elevation: Of the viewer above the horizon [rad].

    Returns:
        Picture, shape (H, W, 3), uint8, sRGB, and the view that projects into it.
    """
    large = (size[0] * _OVERSAMPLING, size[1] * _OVERSAMPLING)
    view = _aim(prop, large, azimuth, elevation)
    index, weights = _rasterise(prop, view)
    occlusion = _Occlusion(prop)
    ground = _draw_ground(_aim(prop, size, azimuth, elevation), occlusion)
    image = ground.repeat(_OVERSAMPLING, axis=0).repeat(_OVERSAMPLING, axis=1)
    start = 0
    for part in prop.parts:
        stop = start + len(part.faces)
        row, column = np.nonzero((index >= start) & (index < stop))
        corners = part.faces[index[row, column] - start]
        image[row, column] = _shade(part, corners, weights[row, column], view, occlusion)
        start = stop
    image = np.clip(image, 0.0, 1.0)
    k = _OVERSAMPLING
    small = image.reshape(size[1], k, size[0], k, 3).mean(axis=(1, 3))
    picture = (255 * small ** (1 / GAMMA) + 0.5).astype(np.uint8)
    return picture, _aim(prop, size, azimuth, elevation)


def _aim(prop: Prop, size: tuple[int, int], azimuth: float, elevation: float) -> View:
    low, high = prop.extent
    middle = (low + high) / 2
    toward = np.array([
        -np.sin(azimuth) * np.cos(elevation),
        -np.cos(azimuth) * np.cos(elevation),
        np.sin(elevation),
    ])  # fmt: skip
    right = np.array([np.cos(azimuth), -np.sin(azimuth), 0.0])
    up = np.cross(toward, right)
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1])
                        for z in (low[2], high[2])]) - middle  # fmt: skip
    distance = 4.0 * float(np.linalg.norm(high - low))
    reach = np.abs(np.stack([corners @ right / size[0], corners @ up / size[1]])).max()
    focal = 0.80 * distance / (2 * reach)
    return View(
        eye=middle + distance * toward, right=right, up=up, toward=toward, focal=focal, size=size
    )


def _rasterise(prop: Prop, view: View) -> tuple[np.ndarray, np.ndarray]:
    """Find the face in each pixel, -1 for none, and the weights of its corners."""
    width, height = view.size
    index = np.full((height, width), -1)
    weights = np.zeros((height, width, 3))
    nearest = np.full((height, width), np.inf)
    start = 0
    for part in prop.parts:
        screen = view.project(part.vertices.astype(np.float64))
        for face, corners in enumerate(screen[part.faces]):
            _fill(corners, start + face, index, weights, nearest)
        start += len(part.faces)
    return index, weights


def _fill(
    corners: np.ndarray, face: int, index: np.ndarray, weights: np.ndarray, nearest: np.ndarray
) -> None:
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = corners.tolist()
    area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
    if area >= 0.0 or min(az, bz, cz) <= 0.0:  # rows run downward: front faces are negative
        return
    height, width = index.shape
    x0, x1 = max(int(min(ax, bx, cx)), 0), min(int(max(ax, bx, cx)) + 1, width)
    y0, y1 = max(int(min(ay, by, cy)), 0), min(int(max(ay, by, cy)) + 1, height)
    if x0 >= x1 or y0 >= y1:
        return
    x, y = np.arange(x0, x1) + 0.5, (np.arange(y0, y1) + 0.5)[:, None]
    v = ((x - ax) * (cy - ay) - (cx - ax) * (y - ay)) / area
    w = ((bx - ax) * (y - ay) - (x - ax) * (by - ay)) / area
    u = 1.0 - v - w
    depth = 1.0 / (u / az + v / bz + w / cz)
    box = (slice(y0, y1), slice(x0, x1))
    hit = (u >= 0) & (v >= 0) & (w >= 0) & (depth < nearest[box])
    if not hit.any():
        return
    nearest[box][hit] = depth[hit]
    index[box][hit] = face
    # Perspective: what is linear on the surface is so after division by depth.
    true = np.stack([u / az, v / bz, w / cz], axis=2) * depth[..., None]
    weights[box][hit] = true[hit]


class _Occlusion:
    """How much of lamp and sky places see."""

    def __init__(self, prop: Prop) -> None:
        rng = np.random.default_rng(0)
        self._points = _sample_surface(prop, rng)
        low, high = prop.extent
        self._bias = 0.012 * float(np.linalg.norm(high - low))
        jitter = rng.normal(0.0, _KEY_SPREAD, (_KEY_LAMPS, 3))
        self._key = [self._map(_unit(_KEY + offset)) for offset in jitter]
        self._sky = [self._map(direction) for direction in _spread_over_sky(_SKY_LAMPS)]

    def see_key(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Light of the lamp that falls on places, as a share, shape (N,)."""
        return self._gather(self._key, points, normals) / float(_KEY[2])

    def see_sky(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Light of the sky that falls on places; 1 on open level ground, shape (N,)."""
        level = np.array([[0.0, 0.0, 1.0]])
        open_ground = np.mean([level @ entry[0] for entry in self._sky])
        return self._gather(self._sky, points, normals) / float(open_ground)

    def _map(self, direction: np.ndarray) -> tuple[np.ndarray, ...]:
        """Make a depth map of the prop as seen from a direction."""
        aside = _unit(np.cross(direction, [0.31, 0.95, 0.05]))
        frame = np.stack([aside, np.cross(direction, aside)])
        flat = self._points @ frame.T
        corner, side = flat.min(axis=0), np.ptp(flat, axis=0).max() / (_TEXELS - 4)
        cell = ((flat - corner) / side).astype(int) + 1
        height = np.full((_TEXELS, _TEXELS), -np.inf)
        np.maximum.at(height, (cell[:, 0], cell[:, 1]), self._points @ direction)
        height = ndimage.grey_closing(height, size=(3, 3), mode="nearest")
        height[[0, -1]] = height[:, [0, -1]] = -np.inf  # nothing beyond
        return direction, frame, corner, np.array(side), height

    def _gather(
        self, maps: list[tuple[np.ndarray, ...]], points: np.ndarray, normals: np.ndarray
    ) -> np.ndarray:
        total = np.zeros(len(points))
        for direction, frame, corner, side, height in maps:
            place = np.clip((points @ frame.T - corner) / side + 1, 0, _TEXELS - 1)
            cell = place.astype(int)
            blocked = height[cell[:, 0], cell[:, 1]] > points @ direction + self._bias
            total += np.where(blocked, 0.0, np.clip(normals @ direction, 0.0, None))
        return total / len(maps)


def _sample_surface(prop: Prop, rng: np.random.Generator) -> np.ndarray:
    """Draw points evenly over all parts near the solid ones, shape (N, 3)."""
    corners = np.concatenate([part.vertices[part.faces] for part in prop.parts]).astype(np.float64)
    low, high = prop.extent
    reach = np.linalg.norm(high - low)
    middle = corners.mean(axis=1)
    corners = corners[((middle > low - reach) & (middle < high + reach)).all(axis=1)]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    face = rng.choice(len(corners), _POINTS, p=area / area.sum())
    r, s = np.sqrt(rng.random(_POINTS)), rng.random(_POINTS)
    weights = np.stack([1 - r, r * (1 - s), r * s], axis=1)
    return np.einsum("nk,nkd->nd", weights, corners[face])


def _spread_over_sky(count: int) -> np.ndarray:
    """Directions spread evenly over the upper half sphere, shape (count, 3)."""
    z = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    flat = np.sqrt(1 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _draw_ground(view: View, occlusion: _Occlusion) -> np.ndarray:
    """Draw the floor, which runs into the backdrop, with what the prop throws onto it."""
    paper = (np.array(BACKGROUND) / 255.0) ** GAMMA
    image = np.broadcast_to(paper, (view.size[1], view.size[0], 3)).copy()
    rays = view.compute_rays()
    row, column = np.nonzero(rays[..., 2] < -1e-3)
    down = rays[row, column]
    place = view.eye - down * (view.eye[2] / down[:, 2:])
    level = np.broadcast_to([0.0, 0.0, 1.0], place.shape)
    light = _KEY_LIGHT * occlusion.see_key(place, level) + _SKY_LIGHT * occlusion.see_sky(
        place, level
    )
    open_ground = _KEY_LIGHT * np.mean([e[0][2] for e in occlusion._key]) / _KEY[2] + _SKY_LIGHT  # noqa: SLF001
    share = np.clip(light / open_ground, 0.0, 1.0)
    image[row, column] *= (0.12 + 0.88 * share)[:, None]
    return image


def _shade(
    part: PropPart, corners: np.ndarray, weights: np.ndarray, view: View, occlusion: _Occlusion
) -> np.ndarray:
    """Linear colour of pixels on a part, shape (N, 3)."""

    def blend(values: np.ndarray) -> np.ndarray:
        return np.einsum("nk,nkd->nd", weights, values[corners].astype(np.float64))

    place, normal = blend(part.vertices), blend(part.normals)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-9)
    finish = part.finish
    colour = np.broadcast_to(finish.colour, place.shape)
    if finish.wood is not None:
        maps, uv = finish.wood.render(512), blend(part.uvs)
        colour = (maps.sample_colour(uv[:, 0], uv[:, 1]) / 255.0) ** GAMMA
    key, sky = occlusion.see_key(place, normal), occlusion.see_sky(place, normal)
    bounce = 0.16 * np.clip(0.5 - 0.5 * normal[:, 2], 0.0, 1.0)
    diffuse = colour * (1.0 - 0.7 * finish.metallic) * (
        _KEY_LIGHT * key + _SKY_LIGHT * sky + bounce
    )[:, None]  # fmt: skip
    to_eye = _unit(view.eye - place)
    half = _unit(_KEY + to_eye)
    power = 2.0 / max(finish.roughness, 0.15) ** 4
    lobe = np.clip(np.einsum("nd,nd->n", normal, half), 0.0, 1.0) ** power * (power + 8) / 8
    facing = np.clip(np.einsum("nd,nd->n", normal, to_eye), 0.0, 1.0)
    mirror = 2 * facing[:, None] * normal - to_eye
    base = 0.04 + (colour - 0.04) * finish.metallic
    fresnel = base + (1 - base) * ((1 - facing) ** 5 * (1 - finish.roughness))[:, None]
    room = 0.5 + 0.42 * mirror[:, 2] + 0.25 * np.clip(mirror @ _KEY, 0.0, 1.0) ** 4
    gloss = (1.0 - finish.roughness) + 0.9 * finish.metallic
    shine = 0.12 * lobe * np.clip(key, 0.0, 1.0) + gloss * room * (0.35 + 0.65 * np.clip(sky, 0, 1))
    return diffuse + fresnel * shine[:, None]


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
