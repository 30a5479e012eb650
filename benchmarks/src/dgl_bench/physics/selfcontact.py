"""Random drops and folds of tops: layers that pass through each other are counted."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from dgl_assets import garment_ids, load_garment
from dgl_bench.physics.experiment import Bench, Result
from dgl_bench.physics.figures import Chart, ClothView, Figure, Limit, Series
from dgl_bench.rows import Reading
from dgl_physics import ClothMaterial, ModelBuilder, PhysicsError, Shape
from dgl_physics.measure import find_intersections
from dgl_physics.scene import Scene
from dgl_physics.topology import compute_edges

__all__ = ["measure_self_contact"]

RUNS = 50
DROP_FRAMES, LOWER_FRAMES, REST_FRAMES = 100, 80, 45
RELEASE_HEIGHT = 0.15
"""Height at which the pads let go [m]: above the layers that they have laid down."""
PAD = Shape(kind="box", size=(0.03, 0.01, 0.03))


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """State of the garment at the end of one run."""

    kind: str
    crossings: int
    """Edges that pierce a triangle."""
    closest: float
    """Distance of the closest two particles that share no edge [m]; the thickness where none is
    nearer."""
    vertices: np.ndarray
    faces: np.ndarray
    places: np.ndarray
    """Points at which edges pierce triangles [m], shape (N, 3)."""
    error: str = ""


def measure_self_contact(bench: Bench) -> Result:
    """Half of the runs drop a top as it happens to be turned, half lay one down in folds."""
    count = bench.scale(RUNS, least=2)
    ids = garment_ids("Tops_LongSleeve", "train")
    material = ClothMaterial()
    outcomes = []
    for run in range(count):
        rng = np.random.default_rng([bench.seed, run])
        garment_id = ids[int(rng.integers(len(ids)))]
        outcomes.append((_drop if run % 2 == 0 else _lay_down)(garment_id, material, rng))
    ended = [o for o in outcomes if not o.error] or outcomes
    caught = sum(o.crossings > 0 for o in ended)
    crossings = np.array([o.crossings for o in ended])
    closest = 100 * np.array([o.closest for o in ended]) / material.thickness
    failed = [o.error for o in outcomes if o.error]
    start = load_garment(ids[0])
    before = len(find_intersections(start.vertices, start.faces))
    rows = (
        Reading(
            "drops and folds that end with a layer through another",
            float(caught),
            f"of {count}",
            bar="<= 0",
            note="runs in whose last frame an edge pierces a triangle that it shares no vertex "
            "with, by exact "
            f"arithmetic; {before} at the start",
        ),
        Reading(
            "edges that pierce a triangle, mean of the runs",
            float(crossings.mean()),
            "",
            note=f"largest {crossings.max()}; of about {3 * len(start.faces) // 2} edges",
        ),
        Reading(
            "closest pair of particles that share no edge, worst run",
            float(closest.min()),
            "% of thickness",
            bar=">= 50",
            note=f"median run {np.median(closest):.0f} %",
        ),
        Reading(
            "drops and folds that failed",
            float(len(failed)),
            f"of {count}",
            bar="<= 0",
            note="; ".join(sorted(set(failed))),
        ),
    )
    return Result(rows, (_draw(ended, crossings, closest),))


def _draw(outcomes: list[Outcome], crossings: np.ndarray, closest: np.ndarray) -> Figure:
    drops = np.array([o.kind == "drop" for o in outcomes])
    runs = np.arange(len(outcomes))
    panels: list = []
    for kind in ("drop", "fold"):
        worst = max(
            (o for o in outcomes if o.kind == kind and not o.error),
            key=lambda o: o.crossings,
            default=None,
        )
        if worst is not None:
            panels.append(
                ClothView(
                    f"worst {kind}: {worst.crossings} edges pierce",
                    worst.vertices,
                    worst.faces,
                    azimuth=-60,
                    elevation=40,
                    marks=worst.places[:: max(1, len(worst.places) // 40)],
                )
            )
    panels += [
        Chart(
            f"{(crossings > 0).sum()} of {len(runs)} with layers caught",
            "run",
            "edges that pierce a triangle",
            (
                Series(runs[drops], crossings[drops], "drops", kind="measured"),
                Series(runs[~drops], crossings[~drops], "folds", kind="measured", tone=1),
            ),
            limits=(Limit(0.0, "bar: none"),),
        ),
        Chart(
            f"closest pair {closest.min():.0f} % of the thickness",
            "run",
            "closest pair [% of thickness]",
            (
                Series(runs[drops], closest[drops], "drops", kind="measured"),
                Series(runs[~drops], closest[~drops], "folds", kind="measured", tone=1),
            ),
            limits=(Limit(50.0, "bar"),),
            y_range=(0.0, 105.0),
        ),
    ]
    return Figure(
        "self_contact",
        "Tops of the catalogue, dropped as they happen to be turned and laid down in "
        "folds. Rings: where an "
        "edge pierces a triangle of another place of the cloth. Right: how many do in each run, "
        "and how near the "
        "closest two particles are that share no edge.",
        panels,
    )


def _drop(garment_id: str, material: ClothMaterial, rng: np.random.Generator) -> Outcome:
    """Drop a garment that is turned at random."""
    garment = load_garment(garment_id)
    vertices = garment.vertices.astype(float) @ _draw_rotation(rng).T
    vertices[:, 2] += material.rest_offset + 0.02 - vertices[:, 2].min() + rng.uniform(0, 0.2)
    builder = ModelBuilder()
    builder.add_garment(vertices, garment.faces, rest=garment.rest_vertices, material=material)
    builder.add_ground(0.5)
    scene = Scene(builder)
    spin = np.cross(rng.normal(0, 1.0, 3), vertices - vertices.mean(axis=0))
    scene.state.set_particles(vertices[None], spin[None])
    error = ""
    try:
        scene.step(DROP_FRAMES + REST_FRAMES)
    except PhysicsError as err:
        error = type(err).__name__
    return _judge(scene, "drop", material, error)


def _lay_down(garment_id: str, material: ClothMaterial, rng: np.random.Generator) -> Outcome:
    """Hold a hanging garment between two pads and lay it down to and fro, then let go."""
    garment = load_garment(garment_id)
    flat = garment.vertices.astype(float)
    names = ("left_shoulder", "right_shoulder", "collar", "left_cuff", "right_cuff")
    grip = flat[garment.landmarks[names[int(rng.integers(len(names)))]]]
    turn = _turn_about_z(rng.uniform(0, 2 * np.pi))
    # its own plane upright, turned so that the grip is its highest part
    away = grip[:2] - flat[:, :2].mean(axis=0)
    angle = np.pi / 2 - np.arctan2(away[1], away[0])
    upright = flat @ _turn_about_z(angle).T
    anchor = grip @ _turn_about_z(angle).T
    upright, anchor = upright[:, [0, 2, 1]] * [1, -1, 1], anchor[[0, 2, 1]] * [1, -1, 1]
    height = material.rest_offset + 0.02 - upright[:, 2].min()
    builder = ModelBuilder()
    builder.add_garment(
        upright @ turn.T + [0, 0, height],
        garment.faces,
        rest=garment.rest_vertices,
        material=material,
    )
    builder.add_ground(0.5)
    for name in ("left", "right"):
        builder.add_shape(PAD, body=builder.add_body(name))
    scene = Scene(builder)
    at = anchor @ turn.T + [0, 0, height]
    heading = rng.uniform(0, 2 * np.pi)
    to_and_fro = rng.uniform(0.05, 0.15) * np.array([np.cos(heading), np.sin(heading), 0.0])
    q = [np.cos(np.arctan2(turn[1, 0], turn[0, 0]) / 2), 0, 0]
    q.append(np.sin(np.arctan2(turn[1, 0], turn[0, 0]) / 2))
    closed = 0.5 * material.thickness + material.rest_offset + PAD.size[1] - 0.001

    def move(place: np.ndarray, opening: float, *, is_jump: bool = False) -> None:
        sides = [place + turn @ np.array([0, s * (closed + opening), 0]) for s in (-1, 1)]
        scene.move(np.array([[*p, *q] for p in sides]), is_jump=is_jump)
        scene.step()

    error = ""
    try:
        scene.state.set_gravity_scale(0.0)
        for k in range(11):
            move(at, 0.01 * (1 - k / 10), is_jump=k == 0)
        scene.state.set_gravity_scale(1.0)
        low = np.array([at[0], at[1], RELEASE_HEIGHT])
        for k in range(LOWER_FRAMES):
            s = (k + 1) / LOWER_FRAMES
            move(at + s * (low - at) + np.sin(4 * np.pi * s) * to_and_fro, 0.0)
        for k in range(REST_FRAMES):
            move(np.add(low, [0, 0, 0.004 * max(0, k - 10)]), 0.004 * min(k, 10))
    except PhysicsError as err:
        error = type(err).__name__
    return _judge(scene, "fold", material, error)


def _judge(scene: Scene, kind: str, material: ClothMaterial, error: str) -> Outcome:
    x, faces = scene.x, scene.faces
    if error:
        return Outcome(
            kind=kind, crossings=0, closest=0.0, vertices=x, faces=faces,
            places=np.zeros((0, 3)), error=error,
        )  # fmt: skip
    found = find_intersections(x, faces)
    gaps = measure_gaps(x, faces, reach=material.thickness)
    return Outcome(
        kind=kind,
        crossings=len(np.unique(found[:, :2], axis=0)),
        closest=min(float(gaps.min()), material.thickness),
        vertices=x,
        faces=faces,
        places=x[found[:, :2]].mean(axis=1),
    )


def _draw_rotation(rng: np.random.Generator) -> np.ndarray:
    """Draw a rotation, shape (3, 3), uniform."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else q[:, [1, 0, 2]]


def _turn_about_z(angle: float) -> np.ndarray:
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])


def measure_gaps(positions: np.ndarray, faces: np.ndarray, *, reach: float) -> np.ndarray:
    """Measure the distance of each particle to the nearest one that it shares no edge with.

    Args:
        positions: [m], shape (V, 3).
        faces: Vertex indices, shape (F, 3).
        reach: Largest distance that is searched [m]. Second neighbours of flat cloth are 1.7 edges
            apart, so a smaller reach finds contacts and folds only.

    Returns:
        Distance [m], shape (V,), infinite where nothing is in reach.
    """
    pairs = KDTree(positions).query_pairs(reach, output_type="ndarray")
    keys = [len(positions), 1]
    pairs = pairs[~np.isin(pairs @ keys, compute_edges(faces).astype(np.int64) @ keys)]
    distance = np.linalg.norm(positions[pairs[:, 0]] - positions[pairs[:, 1]], axis=1)
    gaps = np.full(len(positions), np.inf)
    np.minimum.at(gaps, pairs, distance[:, None])
    return gaps
