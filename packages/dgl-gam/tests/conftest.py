"""Small garments made of arrays alone: a shirt of a body and two sleeves in two layers."""

from pathlib import Path

import numpy as np
import pytest

from dgl_gam.data import write_garment

LANDMARKS = {
    "left_cuff": (-2.0, 0.85, 1),
    "right_cuff": (2.0, 0.85, 1),
    "left_hem": (-1.0, 0.0, 1),
    "right_hem": (1.0, 0.0, 1),
    "collar": (0.0, 1.0, 1),
}


def _make_grid(us, vs):
    u, v = np.meshgrid(us, vs, indexing="ij")
    columns = len(vs)
    corner = (np.arange(len(us) - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    lower = np.stack([corner, corner + columns, corner + 1], axis=1)
    upper = np.stack([corner + 1, corner + columns, corner + columns + 1], axis=1)
    return np.stack([u.ravel(), v.ravel()], axis=1), np.concatenate([lower, upper])


def make_shirt(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Flat shirt with random measures: canonical (V, 3), vertices (V, 3) [m], faces, landmarks."""
    parts = [
        _make_grid(np.linspace(-1, 1, 13), np.linspace(0, 1, 15)),
        _make_grid(np.linspace(-2, -1, 11), np.linspace(0.7, 1, 5)),
        _make_grid(np.linspace(1, 2, 11), np.linspace(0.7, 1, 5)),
    ]
    planes, faces, start = [], [], 0
    for plane, triangles in parts:
        planes.append(plane)
        faces.append(triangles + start)
        start += len(plane)
    uv, faces = np.concatenate(planes), np.concatenate(faces)
    width, height = rng.uniform(0.4, 0.6), rng.uniform(0.45, 0.7)
    length, droop, flare = rng.uniform(0.2, 0.5), rng.uniform(0.0, 0.7), rng.uniform(-0.1, 0.2)
    beyond = np.maximum(np.abs(uv[:, 0]) - 1, 0)
    across = np.clip(uv[:, 0], -1, 1) * width / 2 * (1 + flare * (1 - uv[:, 1]))
    flat = np.stack(
        [
            across + np.sign(uv[:, 0]) * beyond * length * np.cos(droop),
            height * uv[:, 1] - beyond * length * np.sin(droop),
        ],
        axis=1,
    )
    flat -= (flat.min(axis=0) + flat.max(axis=0)) / 2
    count = len(uv)
    canonical = np.concatenate([np.c_[uv, np.ones(count)], np.c_[uv, -np.ones(count)]])
    vertices = np.concatenate([np.c_[flat, np.full(count, 0.008)], np.c_[flat, np.zeros(count)]])
    places = np.array(list(LANDMARKS.values()))
    nearest = np.linalg.norm(canonical[None] - places[:, None], axis=2).argmin(axis=1)
    return {
        "canonical": canonical.astype(np.float32),
        "vertices": vertices.astype(np.float32),
        "faces": np.concatenate([faces, faces[:, ::-1] + count]).astype(np.int32),
        "landmarks": nearest.astype(np.int32),
    }


def deform(vertices: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Bend a flat garment smoothly, and turn it a little."""
    phase, wave = rng.uniform(0, 2 * np.pi, 2), rng.uniform(3, 6, (2, 2))
    out = vertices.astype(np.float64).copy()
    for axis in range(2):
        out[:, axis] += 0.02 * np.sin(vertices[:, :2] @ wave[axis] + phase[axis])
    out[:, 2] += 0.03 * (1 + np.sin(vertices[:, :2] @ wave[0] * 2))
    angle = rng.uniform(-0.3, 0.3)
    c, s = np.cos(angle), np.sin(angle)
    out[:, :2] = out[:, :2] @ np.array([[c, s], [-s, c]])
    return out


def see(vertices: np.ndarray, faces: np.ndarray, rng: np.random.Generator, count: int = 2048):
    """Draw points on the front layer, (N, 3), with their nearest vertices, (N,)."""
    front = faces[: len(faces) // 2]
    corners = vertices[front]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    chosen = rng.choice(len(front), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)
    points = (corners[chosen] * weights[..., None]).sum(axis=1)
    return points.astype(np.float32), front[chosen, weights.argmax(axis=1)].astype(np.int32)


def make_fields(seed: int, *, views_per_state: int = 2, category: str = "Shirt") -> dict:
    """Everything that `write_garment` takes, but the path."""
    rng = np.random.default_rng(seed)
    shirt = make_shirt(rng)
    states = [shirt["vertices"], *(deform(shirt["vertices"], rng) for _ in range(2))]
    views = [
        (state, *see(vertices, shirt["faces"], rng))
        for state, vertices in enumerate(states)
        for _ in range(views_per_state)
    ]
    return {
        "category": category,
        "garment_id": f"{category}/{seed:06d}",
        "split": "test" if seed % 4 == 3 else "train",
        "seed": seed,
        "state_names": ["flat", "dropped_0", "dropped_1"],
        "landmark_names": list(LANDMARKS),
        "view_directions": np.tile([0.0, 0.0, 1.0], (len(views), 1)),
        "generator_versions": {"tests": "1"},
        "canonical": shirt["canonical"],
        "states": np.stack(states).astype(np.float16),
        "faces": shirt["faces"],
        "landmarks": shirt["landmarks"],
        "view_points": np.stack([points for _, points, _ in views]),
        "view_vertices": np.stack([vertices for _, _, vertices in views]),
        "view_state": np.array([state for state, _, _ in views]),
    }


@pytest.fixture(scope="session")
def shirts(tmp_path_factory) -> Path:
    """A folder of twelve shirts, three of them for testing."""
    folder = tmp_path_factory.mktemp("shirts")
    for seed in range(12):
        write_garment(folder / f"{seed:06d}.safetensors", **make_fields(seed))
    return folder


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="session")
def shirt_fields():
    """Maker of everything that `write_garment` takes, but the path."""
    return make_fields


@pytest.fixture
def make_flat_shirt():
    """Maker of flat shirts, and what sees them."""
    return make_shirt, see
