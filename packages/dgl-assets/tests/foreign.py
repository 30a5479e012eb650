"""Garments as other programs would export them: other units, axes, formats, shapes and habits."""

import functools
import io
import json
import zipfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image
from scipy.spatial import KDTree

from dgl_assets import Garment, make_garment, sample_measures

Y_UP = np.eye(3)  # a body that stands: its height, the garment's y, is the file's y
Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
X_UP = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])
LIES_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])  # its front, the garment's z, is up


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """A garment in its own frame, in metres, as it should be after the import."""

    vertices: np.ndarray
    faces: np.ndarray
    landmarks: dict[str, int] = field(default_factory=dict)
    uvs: np.ndarray | None = None

    @property
    def area(self) -> float:
        return float(trimesh.triangles.area(self.vertices[self.faces]).sum())


@functools.cache
def _make_top(seed: int) -> Garment:
    return make_garment(sample_measures("Tops_LongSleeve", seed), spacing=0.02)


def make_lying_top(seed: int) -> Shape:
    top = _make_top(seed)
    return Shape(
        vertices=top.vertices.astype(np.float64),
        faces=top.faces.astype(np.int64),
        landmarks=top.landmarks,
        uvs=top.rest_vertices.astype(np.float64) / 1.3 + 0.5,
    )


def blow_up(garment, *, depth: float = 0.2) -> np.ndarray:
    """Positions of a lying garment as if a body were in it [m], shape (V, 3)."""
    flat = garment.vertices.astype(np.float64)
    side = np.sign(garment.canonical[:, 2])
    distance = KDTree(flat[side == 0, :2]).query(flat[:, :2])[0]
    share = np.clip(distance / 0.13, 0, 1)
    flat[:, 2] = side * depth / 2 * np.sqrt(share * (2 - share))
    return flat


def make_worn_top(seed: int, *, depth: float = 0.2) -> Shape:
    """A top that is blown up as if a body were in it."""
    top = _make_top(seed)
    flat = blow_up(top, depth=depth)
    uvs = top.rest_vertices.astype(np.float64) / 1.3 + 0.5
    return Shape(vertices=flat, faces=top.faces.astype(np.int64), landmarks=top.landmarks, uvs=uvs)


def make_boxy(cells: np.ndarray, open_x, open_y, *, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """Two layers of square cells, sewn along the outline except at openings.

    Args:
        cells: Which cells are cloth, shape (rows from below, columns), bool.
        open_x: Columns of vertices that may be open, as a function of the row.
        open_y: Rows of vertices that may be open, as a function of the column.
        cell: Side of a cell [m].

    Returns:
        Vertices [m], centred, and quads, shape (Q, 4).
    """
    rows, columns = cells.shape
    padded = np.pad(cells, 1)
    around = [padded[i : i + rows + 1, j : j + columns + 1] for i in (0, 1) for j in (0, 1)]
    touched = np.any(around, axis=0)
    outline = touched & ~np.all(around, axis=0)
    row, column = np.nonzero(touched)
    is_open = np.array([c in open_x(r) or r in open_y(c) for r, c in zip(row, column, strict=True)])
    sewn = outline[row, column] & ~is_open
    front = np.full(touched.shape, -1)
    front[row, column] = np.arange(len(row))
    back_ids = np.where(sewn, np.arange(len(row)), len(row) + np.cumsum(~sewn) - 1)
    back = np.full(touched.shape, -1)
    back[row, column] = back_ids
    flat = np.column_stack([column * cell, row * cell, np.zeros(len(row))])
    away = KDTree(flat[sewn]).query(flat)[0]
    flat[:, 2] = 0.006 * np.clip(away / 0.05, 0, 1)
    other = flat[~sewn] * [1, 1, -1]
    r, c = np.nonzero(cells)
    corners = [(r, c), (r, c + 1), (r + 1, c + 1), (r + 1, c)]
    quads = np.concatenate(
        [
            np.column_stack([front[i, j] for i, j in corners]),
            np.column_stack([back[i, j] for i, j in corners[::-1]]),
        ]
    )
    vertices = np.concatenate([flat, other])
    return vertices - (vertices.max(axis=0) + vertices.min(axis=0)) / 2, quads


def make_trousers() -> tuple[np.ndarray, np.ndarray]:
    cells = np.ones((45, 24), dtype=bool)
    cells[:30, 11:13] = False
    return make_boxy(
        cells,
        lambda r: (),
        lambda c: ((45,) if 0 < c < 24 else ()) + ((0,) if 0 < c < 11 or 13 < c < 24 else ()),
        cell=0.02,
    )


def make_dress() -> tuple[np.ndarray, np.ndarray]:
    """As long as it is wide, sleeves straight out."""
    cells = np.zeros((45, 44), dtype=bool)
    cells[:, 11:33] = True
    cells[34:, :] = True
    return make_boxy(
        cells,
        lambda r: (0, 44) if 34 < r < 45 else (),
        lambda c: ((0,) if 11 < c < 33 else ()) + ((45,) if 17 < c < 27 else ()),
        cell=0.02,
    )


def make_vest() -> tuple[np.ndarray, np.ndarray]:
    cells = np.ones((28, 20), dtype=bool)
    return make_boxy(
        cells,
        lambda r: (0, 20) if 17 < r < 27 else (),
        lambda c: ((0,) if 0 < c < 20 else ()) + ((28,) if 5 < c < 15 else ()),
        cell=0.02,
    )


def make_coat(seed: int) -> Shape:
    """A top whose front is cut open in the middle."""
    top = make_worn_top(seed)
    middle = top.vertices[top.faces].mean(axis=1)
    strip = (np.abs(middle[:, 0]) < 0.03) & (middle[:, 2] > 0)
    faces = top.faces[~strip]
    used = np.unique(faces)
    number = np.zeros(len(top.vertices), dtype=np.int64)
    number[used] = np.arange(len(used))
    return Shape(vertices=top.vertices[used], faces=number[faces])


def paint() -> Image.Image:
    """A picture with a different colour in each quarter."""
    pixels = np.zeros((64, 64, 3), dtype=np.uint8)
    pixels[:32, :32], pixels[:32, 32:] = (220, 60, 40), (60, 200, 60)
    pixels[32:, :32], pixels[32:, 32:] = (50, 80, 220), (230, 210, 60)
    return Image.fromarray(pixels)


def to_file(shape: Shape, *, unit: float, axes: np.ndarray) -> np.ndarray:
    """Positions in the units and axes of a file, away from its origin."""
    return shape.vertices @ axes.T / unit + np.array([0.3, -0.2, 0.1]) / unit


def to_mesh(shape: Shape, vertices: np.ndarray, *, texture: bool = False) -> trimesh.Trimesh:
    visual = None
    if texture:
        material = trimesh.visual.material.PBRMaterial(baseColorTexture=paint())
        visual = trimesh.visual.TextureVisuals(uv=shape.uvs, material=material)
    return trimesh.Trimesh(vertices, shape.faces, process=False, visual=visual)


def save_keypoints(path: Path, shape: Shape, vertices: np.ndarray | None = None) -> Path:
    """As vertex numbers, or as positions when vertices are given."""
    points = shape.landmarks
    if vertices is not None:
        points = {name: vertices[vertex].tolist() for name, vertex in points.items()}
    path.write_text(json.dumps(points))
    return path


def save_quads(path: Path, vertices: np.ndarray, quads: np.ndarray) -> Path:
    lines = [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices]
    lines += ["f " + " ".join(f"{i + 1}" for i in quad) for quad in quads]
    path.write_text("# made by hand\no garment\n" + "\n".join(lines))
    return path


def save_usd(path: Path, shape: Shape, vertices: np.ndarray, *, unit: float, up: str) -> Path:
    from pxr import Gf, Usd, UsdGeom, Vt

    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, unit)
    frame = UsdGeom.Xform.Define(stage, "/World")
    frame.AddTranslateOp().Set(Gf.Vec3d(10, 20, 30))
    mesh = UsdGeom.Mesh.Define(stage, "/World/garment")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(vertices.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(shape.faces))
    mesh.CreateFaceVertexIndicesAttr(shape.faces.ravel().tolist())
    stage.Save()
    return path


def save_zip(path: Path, files: dict[str, bytes]) -> Path:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    path.write_bytes(stream.getvalue())
    return path


def make_bowl(radius: float, rings: int = 14) -> tuple[np.ndarray, np.ndarray]:
    """A little less than half a ball, open below."""
    turn, tilt = np.meshgrid(
        2 * np.pi * np.arange(4 * rings) / (4 * rings), np.linspace(0.12, 1.5, rings)
    )
    across = np.sin(tilt)
    points = np.stack([across * np.cos(turn), across * np.sin(turn), np.cos(tilt)], axis=-1)
    ids = np.arange(turn.size).reshape(turn.shape)
    a, b = ids[:-1], np.roll(ids, -1, axis=1)[:-1]
    c, d = ids[1:], np.roll(ids, -1, axis=1)[1:]
    cap = [[turn.size, i, j] for i, j in zip(ids[0], np.roll(ids[0], -1), strict=True)]
    faces = [np.stack(t, axis=-1).reshape(-1, 3) for t in ((a, c, d), (a, d, b))]
    vertices = np.concatenate([points.reshape(-1, 3), [[0, 0, 1.0]]])
    return radius * vertices, np.concatenate([*faces, np.array(cap)])
