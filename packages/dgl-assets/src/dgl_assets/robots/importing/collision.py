"""Collision shapes of an imported link: fitted capsules, convex pieces, or those of the file."""

import io
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from dgl_assets.robots._frames import quaternion_from_rotation
from dgl_assets.robots.collision import CollisionShape
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.capsules import Capsule, fit_capsules
from dgl_assets.robots.importing.meshes import load_geometry
from dgl_assets.robots.importing.options import CollisionMethod
from dgl_assets.robots.importing.raw import RawLink, RawShape

MOST_PIECES = 8
"""Largest number of convex pieces of one mesh."""


def build_collision(
    link: RawLink, method: CollisionMethod
) -> tuple[list[CollisionShape], dict[str, bytes]]:
    """Make the collision shapes of a link.

    Boxes, spheres and capsules stay as they are. A cylinder becomes a capsule of its length where
    it is long enough, unless the file's shapes are kept. A link without collision elements takes
    its visual ones.

    Args:
        link: The link.
        method: "capsules": at most four around each mesh; "coacd": each mesh in at most eight
            convex pieces; "keep": each mesh as its convex hull, which is what PhysX makes of it.

    Returns:
        The shapes, and the content of the mesh files that they name.
    """
    shapes: list[CollisionShape] = []
    files: dict[str, bytes] = {}
    for number, shape in enumerate(link.collisions or link.visuals):
        if shape.kind != "mesh":
            shapes.append(convert_primitive(link.name, shape, is_kept=method == "keep"))
            continue
        if method == "capsules":
            assert shape.path is not None
            T = shape.shape_to_link
            for capsule in _fit_file(shape.path, shape.scale, shape.path.stat().st_mtime_ns):
                shapes.append(_to_shape(link.name, capsule, T))
            continue
        mesh = trimesh.util.concatenate(load_geometry(shape))
        assert isinstance(mesh, trimesh.Trimesh)
        parts = _decompose(mesh) if method == "coacd" else [mesh]
        for k, part in enumerate(parts):
            name = f"{link.name}_hull_{number}_{k}.stl"
            files[name] = _encode_hull(part, link.name)
            shapes.append(CollisionShape(link=link.name, kind="mesh", mesh=name))
    return shapes, files


def mirror_hull(data: bytes) -> bytes:
    """Reflect an STL of a hull in x."""
    hull = trimesh.load_mesh(io.BytesIO(data), file_type="stl")
    return _write_stl(
        trimesh.Trimesh(hull.vertices * (-1, 1, 1), hull.faces[:, ::-1], process=False)
    )


@lru_cache(maxsize=64)
def _fit_file(path: Path, scale: tuple[float, float, float], _modified: int) -> tuple[Capsule, ...]:
    """Fit capsules in the frame of a mesh; fingers often share one."""
    shape = RawShape(kind="mesh", shape_to_link=np.eye(4), path=path, scale=scale)
    mesh = trimesh.util.concatenate(load_geometry(shape))
    assert isinstance(mesh, trimesh.Trimesh)
    return tuple(fit_capsules(mesh.vertices, mesh.faces))


def _to_shape(link: str, capsule: Capsule, mesh_to_link: np.ndarray) -> CollisionShape:
    z = mesh_to_link[:3, :3] @ capsule.axis
    x = np.cross(np.eye(3)[np.abs(z).argmin()], z)
    x /= np.linalg.norm(x)
    R = np.column_stack([x, np.cross(z, x), z])
    return CollisionShape(
        link=link,
        kind="capsule",
        radius=capsule.radius,
        half_length=capsule.half_length,
        xyz=_three(mesh_to_link[:3, :3] @ capsule.centre + mesh_to_link[:3, 3]),
        wxyz=_four(quaternion_from_rotation(R)),
    )


def convert_primitive(link: str, shape: RawShape, *, is_kept: bool) -> CollisionShape:
    """Convert a box, sphere, capsule or cylinder; a long cylinder is kept, or becomes a capsule."""
    T = shape.shape_to_link
    pose = {
        "link": link,
        "xyz": _three(T[:3, 3]),
        "wxyz": _four(quaternion_from_rotation(T[:3, :3])),
    }
    if shape.kind == "box":
        return CollisionShape(kind="box", half_size=_three(np.array(shape.size) / 2), **pose)
    if shape.kind == "sphere":
        return CollisionShape(kind="sphere", radius=shape.size[0], **pose)
    radius, half_length = shape.size[0], shape.size[1] / 2
    if shape.kind == "capsule":
        return CollisionShape(kind="capsule", radius=radius, half_length=half_length, **pose)
    if is_kept or half_length < 1.2 * radius:
        return CollisionShape(kind="cylinder", radius=radius, half_length=half_length, **pose)
    return CollisionShape(kind="capsule", radius=radius, half_length=half_length - radius, **pose)


def _decompose(mesh: trimesh.Trimesh) -> list[trimesh.Trimesh]:
    import coacd

    coacd.set_log_level("error")
    parts = coacd.run_coacd(
        coacd.Mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)),
        threshold=0.05,
        max_convex_hull=MOST_PIECES,
        preprocess_resolution=30,
        mcts_iterations=60,
        seed=0,
    )
    return [trimesh.Trimesh(vertices, faces) for vertices, faces in parts]


def _encode_hull(mesh: trimesh.Trimesh, link: str) -> bytes:
    try:
        hull = mesh.convex_hull
    except Exception as err:  # Qhull raises its own kinds for flat meshes
        raise RobotImportError(
            f"link {link}: a collision mesh has no convex hull (is it flat?); try --collision "
            "capsules"
        ) from err
    return _write_stl(hull)


def _write_stl(mesh: trimesh.Trimesh) -> bytes:
    data = mesh.export(file_type="stl")
    assert isinstance(data, bytes)
    return data


def _three(v: np.ndarray) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])


def _four(v: np.ndarray) -> tuple[float, float, float, float]:
    return float(v[0]), float(v[1]), float(v[2]), float(v[3])
