"""Drop a square sheet on a sphere and print its heights at rest.

Run with `python drape_sheet.py`.
"""

import numpy as np

from dgl_physics import ClothMaterial, ModelBuilder, Shape, SolverXPBD, State

EDGE = 0.0125  # m; the thickness of the cloth must be more than 0.58 of it
RADIUS = 0.1  # m


def make_sheet(side: float) -> tuple[np.ndarray, np.ndarray]:
    """Make a flat square sheet of nearly equilateral triangles.

    Args:
        side: Length of a side [m].

    Returns:
        Vertices [m], shape (V, 3), centred on the origin, and faces, shape (F, 3).
    """
    rows, columns = round(side / (EDGE * np.sqrt(0.75))) + 1, round(side / EDGE) + 1
    row, column = np.divmod(np.arange(rows * columns), columns)
    x = (column + 0.5 * (row % 2)) * EDGE
    y = row * EDGE * np.sqrt(0.75)
    vertices = np.column_stack([x - x.mean(), y - y.mean(), np.zeros(len(x))])
    faces = []
    for i in range(rows - 1):
        for j in range(columns - 1):
            a, b = i * columns + j, i * columns + j + 1
            c, d = a + columns, b + columns
            faces += [(a, b, c), (b, d, c)] if i % 2 == 0 else [(a, b, d), (a, d, c)]
    return vertices, np.array(faces)


def main(frames: int = 180, side: float = 0.5) -> np.ndarray:
    """Drop the sheet from 5 cm above a sphere that lies on the ground.

    Args:
        frames: Frames of 1/60 s to simulate.
        side: Length of the sheet's side [m].

    Returns:
        Final heights of its particles [m], shape (V,).
    """
    vertices, faces = make_sheet(side)
    builder = ModelBuilder()
    vertices[:, 2] += 2 * RADIUS + 0.05
    builder.add_garment(vertices, faces, material=ClothMaterial())
    pose = np.array([0, 0, RADIUS, 1, 0, 0, 0])
    builder.add_shape(Shape(kind="sphere", size=(RADIUS, 0, 0), pose=pose))
    builder.add_ground()
    model = builder.build()
    state, solver = State(model), SolverXPBD(model)
    for _ in range(frames):
        solver.step(state)
    return state.get_positions()[0, :, 2]


if __name__ == "__main__":
    heights = main()
    print(f"top {heights.max():.3f} m, hem {heights.min():.3f} m, mean {heights.mean():.3f} m")
