"""Press a felt bowl hat onto a head with a plate, release it, and measure how it springs back.

Run with `python bowl_hat.py`.
"""

from itertools import pairwise

import numpy as np

from dgl_physics import ModelBuilder, Shape, SolidMaterial, SolverXPBD, State

RADIUS = 0.09  # m, outside
WALL = 0.004  # m
HEAD = 0.086  # m; with the rest offset 3 mm more than the hat is wide inside
MASS = 0.075  # kg
PLATE = 0.01  # m, half of its thickness


def make_bowl(radius: float, height: float, edge: float) -> tuple[np.ndarray, np.ndarray]:
    """Make half an ellipsoid, open below, of rings of nearly equal triangles.

    Args:
        radius: Of the rim [m].
        height: Of the top above the rim [m].
        edge: Length of an edge [m].

    Returns:
        Vertices [m], shape (V, 3), the rim at z = 0, and faces, shape (F, 3), seen from outside.
    """
    rings = round(np.pi / 2 * radius / edge)
    angles = np.pi / 2 * np.arange(1, rings + 1) / rings
    counts = [max(6, round(2 * np.pi * radius * np.sin(a) / edge)) for a in angles]
    vertices = [np.array([[0.0, 0.0, height]])]
    for angle, count in zip(angles, counts, strict=True):
        turn = 2 * np.pi * np.arange(count) / count
        r, z = radius * np.sin(angle), height * np.cos(angle)
        vertices.append(np.column_stack([r * np.cos(turn), r * np.sin(turn), np.full(count, z)]))
    faces = [(0, 1 + j, 1 + (j + 1) % counts[0]) for j in range(counts[0])]
    first = 1
    for upper, lower in pairwise(counts):
        below, i, j = first + upper, 0, 0
        while i < upper or j < lower:  # go around both rings, always on with what is behind
            a, b = first + i % upper, below + j % lower
            if (j + 1) * upper <= (i + 1) * lower:
                faces.append((a, b, below + (j + 1) % lower))
                j += 1
            else:
                faces.append((a, b, first + (i + 1) % upper))
                i += 1
        first = below
    return np.concatenate(vertices), np.array(faces)


def measure_change(positions: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Distances to the rest shape after the best rigid motion [m], shape (V,)."""
    a, b = positions - positions.mean(axis=0), rest - rest.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    sign = np.diag([1.0, 1.0, np.linalg.det(u @ vt)])
    return np.linalg.norm(a @ (u @ sign @ vt) - b, axis=1)


def main(youngs_modulus: float = 3e5, edge: float = 0.0125, speed: float = 0.1) -> dict:
    """Put the hat on, press it down until it is 2 mm from the head, hold and release it.

    Args:
        youngs_modulus: Of the felt [Pa].
        edge: Length of an edge of the hat's mesh [m].
        speed: Of the plate [m/s].

    Returns:
        Of "worn", "pressed" and "released": mean and largest change of shape [mm], and the
        vertical force on the head [N].
    """
    vertices, faces = make_bowl(RADIUS, RADIUS, edge)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    felt = SolidMaterial(
        youngs_modulus=youngs_modulus, density=MASS / (area * WALL), rest_offset=0.003
    )
    reach = HEAD + felt.rest_offset
    above = np.sqrt(reach**2 - (RADIUS - WALL) ** 2) + 0.005  # where the rim meets the head
    builder = ModelBuilder()
    builder.add_solid(np.add(vertices, [0, 0, above]), faces, material=felt, thickness=WALL)
    builder.add_shape(Shape(kind="sphere", size=(HEAD, 0, 0)))
    builder.add_shape(Shape(kind="box", size=(0.15, 0.15, PLATE)), body=builder.add_body("plate"))
    model = builder.build()
    state, solver = State(model), SolverXPBD(model)
    rest = model.initial_positions[0]
    height = above + RADIUS + felt.rest_offset + PLATE + 0.01
    depth = height - (reach + WALL + felt.rest_offset + PLATE + 0.002)

    def move_plate(to: float, *, is_jump: bool = False) -> None:
        poses = np.zeros((1, 2, 7), dtype=np.float32)
        poses[..., 3] = 1.0
        poses[0, 1, 2] = to
        state.set_body_poses(poses, is_jump=is_jump)

    def step(frames: int, velocity: float) -> None:
        nonlocal height
        for _ in range(frames):
            height += velocity / 60
            move_plate(height)
            solver.step(state)

    move_plate(height, is_jump=True)
    facts = {}
    travel = round(depth / speed * 60)
    parts = {
        "worn": [(60, 0.0)],
        "pressed": [(travel, -speed), (30, 0.0)],
        "released": [(travel, speed), (60, 0.0)],
    }
    for name, moves in parts.items():
        for frames, velocity in moves:
            step(frames, velocity)
        change = 1e3 * measure_change(state.get_positions()[0], rest)
        force = float(state.impulse.numpy()[0, 0, 2] * 60)
        facts[name] = {"mean": float(change.mean()), "max": float(change.max()), "force": force}
    return facts


if __name__ == "__main__":
    for name, fact in main().items():
        print(
            f"{name}: changed by {fact['mean']:.2f} mm on average, {fact['max']:.2f} mm at most; "
            f"{-fact['force']:.2f} N on the head"
        )
