"""Compare our pictures with SAPIEN's on the same scenes: pixels, matches of GAM, and verdicts.

    python benchmarks/scripts/compare_pictures.py --scenes 50 --json agreement.json

Scenes are drawn from all tasks: garments as they fell, folded over a line, or spread out; every
third one with arms that reach out at random. SAPIEN's pictures are the reference. GAM's matches
depend on which points of a cloud are drawn, so the distance between its matches in both pictures
stands beside that between two draws from one.
"""

import argparse
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.spatial import cKDTree

from dgl_collect.point_finder import PointFinder
from dgl_collect.setup import Setup, make_setup
from dgl_tasks import perception as see
from dgl_tasks import task_ids
from dgl_tasks.env import GarmentEnv

CAMERAS = ("garment_camera", "environment_camera")
TOLERANCES = {
    "colour, mean difference [of 255]": 1.5,
    "share of pixels of another segment": 1e-4,
    "places, 99 % [mm]": 0.2,
    "garment cloud to garment cloud, mean [mm]": 8.0,
    "value of the rule": 0.002,
    "another verdict": 0.0,
}
"""Largest values that count as agreement, in every scene."""


def photograph(env: GarmentEnv, camera: str) -> see.Picture:
    """Let SAPIEN take a picture."""
    placement = env.task.cameras[camera]
    env.draw_garment()
    env.scene.update_render(update_sensors=True, update_human_render_cameras=False)
    sensor = env.scene.sensors[camera]
    sensor.capture()
    # Positions of the fast shaders are rounded to millimetres; their depth buffer is not.
    colour, buffer, mixed = (
        texture[0].cpu().numpy()
        for texture in sensor.camera.get_picture(["Color", "GbufferDepth", "PositionSegmentation"])
    )
    buffer = buffer.reshape(colour.shape[:2])
    depth = (
        placement.near * placement.far / (placement.far - buffer * (placement.far - placement.near))
    )
    depth[buffer >= 1.0] = np.nan
    return see.Picture(
        rgb=np.ascontiguousarray(colour[..., :3]),
        points=np.array(placement.position) + depth[..., None] * placement.compute_rays(),
        segments=mixed[..., 3].astype(np.int32),
    )


def arrange(env: GarmentEnv, number: int) -> None:
    """Set a scene up."""
    env.reset(seed=number)
    rng = np.random.default_rng([number, 20])
    if number % 3 == 2:
        joints = env.agent.read_joints()
        env.agent.set_joint_state(joints + rng.normal(0.0, 0.25, joints.shape))
    particles = env.get_particles().copy()
    if number % 4 == 1:
        flat = env.garment.vertices
        particles = (flat - [*flat[:, :2].mean(axis=0), flat[:, 2].min()]).astype(np.float32)
        particles += np.float32([0.0, np.mean(env.task.start.y_range), 0.01])
    if number % 4 == 3:
        angle = rng.uniform(0.0, 2 * np.pi)
        normal = np.array([np.cos(angle), np.sin(angle), 0.0])
        beyond = (particles - particles.mean(axis=0)) @ normal - rng.uniform(0.0, 0.15)
        is_moved = beyond > 0
        particles[is_moved] -= 2 * beyond[is_moved, None] * normal
        particles[is_moved, 2] += 0.04
    if number % 2 == 1:
        env.cloth.state.set_particles(particles[None], np.zeros_like(particles)[None])
        for _ in range(40):
            env.cloth.step()
    env._appearance.mark_moved()  # noqa: SLF001  as after a control step


def compare(setup: Setup, number: int) -> dict[str, float]:
    """Compare both pictures of one scene."""
    env = setup.env
    arrange(env, number)
    row: dict[str, float] = {}
    for camera in CAMERAS:
        ours, theirs = env.take_picture(camera), photograph(env, camera)
        row |= {
            f"{name}, {camera}": value for name, value in _compare_pixels(env, ours, theirs).items()
        }
        if camera == "garment_camera":
            row |= _compare_garments(setup, ours, theirs)
    return row


def _compare_pixels(env: GarmentEnv, ours: see.Picture, theirs: see.Picture) -> dict[str, float]:
    ids = env.segments
    named = [ids.garment, *ids.robot, *ids.objects.values()]
    first, second = (np.where(np.isin(p.segments, named), p.segments, 0) for p in (ours, theirs))
    is_same = first == second
    distance = np.linalg.norm(ours.points - theirs.points, axis=2)[is_same & (first > 0)]
    return {
        "colour, mean difference [of 255]": float(
            np.abs(ours.rgb - theirs.rgb.astype(float)).mean()
        ),
        "share of pixels of another segment": float(1.0 - is_same.mean()),
        "places, 99 % [mm]": float(1000 * np.nanquantile(distance, 0.99)),
    }


def _compare_garments(setup: Setup, ours: see.Picture, theirs: see.Picture) -> dict[str, float]:
    env = setup.env
    seen = [see.get_garment_points(picture, env.segments) for picture in (ours, theirs)]
    verdicts = [env.task.success(_see(env, points)) for points in seen]
    values, passed = [v.value for v in verdicts], [v.success for v in verdicts]
    clouds = [
        see.get_garment_cloud(picture, env.segments, seed=seed)
        for picture, seed in ((ours, 0), (theirs, 0), (theirs, 1))
    ]
    matches = []
    for cloud in clouds:
        finder = PointFinder(setup.demonstration, setup.demo_cloud)
        finder.look(cloud, setup.find_matcher(env))
        matches.append(np.array(list(finder.points.values())))
    return {
        "garment cloud to garment cloud, mean [mm]": 1000
        * float(cKDTree(clouds[1]).query(clouds[0])[0].mean()),
        "GAM, both pictures, mean [mm]": 1000
        * float(np.linalg.norm(matches[0] - matches[1], axis=1).mean()),
        "GAM, two draws from SAPIEN's, mean [mm]": 1000
        * float(np.linalg.norm(matches[2] - matches[1], axis=1).mean()),
        "value of the rule": abs(values[0] - values[1]),
        "another verdict": float(passed[0] != passed[1]),
        "success": float(passed[1]),
    }


def _see(env: GarmentEnv, points: np.ndarray) -> SimpleNamespace:
    """Give the scene as it is, but for what is seen of the garment from above [m], shape (N, 3)."""
    view = env.view
    return SimpleNamespace(
        top=points,
        surface=points,
        landmarks=view.landmarks,
        flat_area=view.flat_area,
        frames=view.frames,
    )


def main(count: int = 50, path: Path | None = None) -> dict[str, dict[str, float]]:
    """Compare scenes of all tasks in turn.

    Returns:
        Median and largest of each measure, by its name.
    """
    rows = []
    for k, task in enumerate(task_ids()):
        setup = make_setup(task, render_backend="cpu", matcher="gam")
        rows += [compare(setup, number) for number in range(k, count, len(task_ids()))]
        setup.env.close()
    names = list(rows[0])
    table = {
        name: {
            "median": float(np.median([row[name] for row in rows])),
            "mean": float(np.mean([row[name] for row in rows])),
            "largest": float(np.max([row[name] for row in rows])),
        }
        for name in names
    }
    print(f"| {len(rows)} scenes | median | mean | largest | tolerance |")
    print("|---|--:|--:|--:|--:|")
    for name, values in table.items():
        limit = next((t for key, t in TOLERANCES.items() if name.startswith(key)), None)
        figures = " | ".join(f"{values[key]:.4g}" for key in ("median", "mean", "largest"))
        print(f"| {name} | {figures} | {'' if limit is None else limit} |")
    if path is not None:
        path.write_text(json.dumps(table, indent=2))
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=50)
    parser.add_argument("--json", type=Path, default=None)
    arguments = parser.parse_args()
    main(arguments.scenes, arguments.json)
