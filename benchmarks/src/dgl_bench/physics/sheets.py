"""Meshes of the experiments: sheets, a sewn panel, a bowl, a box, and rigid bodies for pictures."""

import numpy as np

from dgl_bench.physics.figures import ShownSolid

__all__ = ["join", "make_bowl", "make_box", "make_capsule", "make_panel", "make_sheet", "place"]


def make_sheet(width: float, length: float, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Make a flat sheet of equilateral triangles.

    Args:
        width: Along x [m].
        length: Along y [m].
        edge: Length of an edge [m].

    Returns:
        Vertices [m], shape (V, 3), row by row, centred at the origin; faces, shape (F, 3), int32,
        normals up.
    """
    columns, rows = round(width / edge) + 1, round(length / (edge * np.sqrt(0.75))) + 1
    r, c = np.divmod(np.arange(rows * columns), columns)
    xy = np.column_stack([(c + 0.5 * (r % 2)) * edge, r * edge * np.sqrt(0.75)])
    a = np.flatnonzero((r < rows - 1) & (c < columns - 1))
    b, d, e = a + 1, a + columns, a + columns + 1
    even = (r[a] % 2 == 0)[:, None]
    first = np.where(even, np.column_stack([a, b, d]), np.column_stack([a, b, e]))
    second = np.where(even, np.column_stack([b, e, d]), np.column_stack([a, e, d]))
    vertices = np.column_stack([xy - xy.mean(axis=0), np.zeros(len(xy))])
    return vertices, np.concatenate([first, second]).astype(np.int32)


def make_panel(
    width: float, length: float, edge: float, *, gap: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make two layers that are sewn together along their sides, as the body of a shirt.

    Args:
        width: Along x [m].
        length: Along y [m].
        edge: Length of an edge [m].
        gap: Distance of the layers in the middle [m].

    Returns:
        Vertices [m], shape (V, 3), flat in x and y; faces, shape (F, 3), normals outwards; and flat
        rest coordinates [m], shape (V, 2). The four corners are vertices that both layers share.
    """
    sheet, faces = make_sheet(width, length, edge)
    columns = round(width / edge) + 1
    column = np.arange(len(sheet)) % columns
    is_seam = (column == 0) | (column == columns - 1)
    steps = np.minimum(column, columns - 1 - column)  # edges from the nearer seam
    rise = 0.5 * gap * np.clip(steps / 3, 0, 1)
    back = np.full(len(sheet), -1)
    back[is_seam] = np.flatnonzero(is_seam)
    back[~is_seam] = len(sheet) + np.arange((~is_seam).sum())
    front = sheet + np.column_stack([np.zeros((len(sheet), 2)), rise])
    behind = (sheet - np.column_stack([np.zeros((len(sheet), 2)), rise]))[~is_seam]
    vertices = np.concatenate([front, behind])
    return vertices, np.concatenate([faces, back[faces][:, ::-1]]).astype(np.int32), vertices[:, :2]


def make_bowl(radius: float, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """Make half a sphere, open below, of rings of 6, 12, 18, ... vertices around its top.

    Args:
        radius: Of the sphere [m].
        rings: Number of rings; the last one is the rim.

    Returns:
        Vertices [m], shape (V, 3), the rim at z = 0; faces, shape (F, 3), int32, seen from outside.
    """
    vertices, faces = [np.array([[0.0, 0.0, radius]])], []
    first = 0  # of the ring above
    for k in range(1, rings + 1):
        polar, turn = np.pi / 2 * k / rings, 2 * np.pi * np.arange(6 * k) / (6 * k)
        flat = radius * np.sin(polar)
        height = np.full(6 * k, radius * np.cos(polar))
        vertices.append(np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height]))
        below, upper = first + max(6 * (k - 1), 1), max(6 * (k - 1), 1)
        for sixth in range(6):
            for j in range(k):
                a, b = (below + (sixth * k + j + n) % (6 * k) for n in (0, 1))
                c, d = (first + (sixth * (k - 1) + j + n) % upper for n in (0, 1))
                faces.append((c, a, b))
                if j < k - 1:
                    faces.append((c, b, d))
        first = below
    return np.concatenate(vertices), np.array(faces, dtype=np.int32)


def make_box(size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Make the surface of a box of a size [m] about the origin: vertices (8, 3), faces (12, 3)."""
    corner = np.array([[k >> 2 & 1, k >> 1 & 1, k & 1] for k in range(8)]) - 0.5
    quads = np.array(
        [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    )
    faces = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return corner * np.asarray(size), faces.astype(np.int32)


def join(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Join meshes into one: vertices (V, 3) and faces (F, 3)."""
    first = np.cumsum([0, *(len(v) for v, _ in parts)])
    return (
        np.concatenate([v for v, _ in parts]),
        np.concatenate([f + n for (_, f), n in zip(parts, first, strict=False)]),
    )


def make_capsule(start: np.ndarray, end: np.ndarray, radius: float) -> ShownSolid:
    """Make a capsule between two points [m] for a picture."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    axis = end - start
    length = float(np.linalg.norm(axis))
    axis = axis / length if length > 0 else np.array([0.0, 0.0, 1.0])
    side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.9 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    other = np.cross(axis, side)
    latitudes = np.radians(np.array([-90, -60, -30, 0, 0, 30, 60, 90]))
    centres = np.array([start] * 4 + [end] * 4)
    around = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    ring = np.cos(around)[:, None] * side + np.sin(around)[:, None] * other  # (16, 3)
    vertices = np.concatenate(
        [
            c + radius * (np.cos(a) * ring + np.sin(a) * axis)
            for c, a in zip(centres, latitudes, strict=True)
        ]
    )
    i, j = np.meshgrid(np.arange(7), np.arange(16), indexing="ij")
    a, b = (i * 16 + j).ravel(), (i * 16 + (j + 1) % 16).ravel()
    c, d = a + 16, b + 16
    faces = np.concatenate([np.column_stack([a, b, d]), np.column_stack([a, d, c])])
    return ShownSolid(vertices, faces)


def place(solid: ShownSolid, pose: np.ndarray) -> ShownSolid:
    """Move a solid by a pose, xyz [m] + quaternion wxyz, shape (7,)."""
    w, x, y, z = pose[3:]
    rotation = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    return ShownSolid(solid.vertices @ rotation.T + pose[:3], solid.faces)
