"""A person as a prop, standing or seated, still while garments are put on."""

from __future__ import annotations

import hashlib
import json
import logging
import zipfile
from dataclasses import asdict, dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dgl_assets._archive import get_cache_folder, read_archive, write_archive
from dgl_assets.importing.holes import close_small_holes
from dgl_assets.people import PEOPLE, POSES, Person, make_person
from dgl_assets.people.skeleton import FINGERS
from dgl_assets.props.meshes import assemble, make_part, make_wood
from dgl_assets.props.prop import Finish, Prop, PropPart
from dgl_assets.props.shapes import PropShape, make_capsules
from dgl_assets.ranges import Measures, measure
from dgl_assets.robots._solids import cylinder

logger = logging.getLogger(__name__)

GENERATOR_VERSION = 4
"""Raised whenever the same parameters give another person than before."""
_DENSITY = 985.0  # of a human body [kg/m^3]
_STOOL = 0.45  # share of the depth of seat and thighs that sits on it
FINISHES: dict[str, Finish] = {
    name: Finish(name=name, colour=colour, roughness=roughness, density=_DENSITY)
    for name, colour, roughness in (
        ("skin", (0.42, 0.25, 0.18), 0.62),
        ("shirt", (0.62, 0.60, 0.55), 0.95),
        ("trousers", (0.045, 0.06, 0.10), 0.95),
        ("shoes", (0.03, 0.03, 0.03), 0.7),
    )
}
"""Finishes of skin and painted clothes."""
_OFFERED = {"offer_right": "right"}
"""The hand of a pose on which garments are put. It is solid by capsules: its fingers are thin
beside the cells in which cloth finds the distance to the mesh of a whole body."""
_FRAMES = (
    "head_top", "brow", "neck",
    *(
        f"{side}_{name}"
        for side in ("left", "right")
        for name in ("shoulder", "wrist", "hand", *(f"{finger}_tip" for finger in FINGERS))
    ),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class PersonParameters(Measures):
    """Size and pose of a person."""

    measures: str = "woman"
    """One of `dgl_assets.people.PEOPLE`."""
    scale: float = measure(0.3, 1.5, 0.85)
    """Factor of all lengths; garments of this package are made for 0.85."""
    pose: str = "standing"
    """One of `dgl_assets.people.POSES`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, value, known in (("measures", self.measures, PEOPLE), ("pose", self.pose, POSES)):
            if value not in known:
                raise ValueError(f"{name} must be one of {sorted(known)}; got {value!r}")


@lru_cache(maxsize=8)
def make_person_prop(parameters: PersonParameters) -> Prop:
    """Make a person on z = 0 who faces -y; the target is the top of the head.

    The other landmarks are those of `Person.frames`. Who is seated has a stool.
    """
    body = _load_body(parameters)
    vertices, faces = body.vertices, body.faces
    normals = _compute_normals(vertices, faces)
    parts = []
    for number, finish in enumerate(FINISHES.values()):
        used, index = np.unique(faces[body.regions == number], return_inverse=True)
        part = PropPart(
            name=finish.name,
            vertices=vertices[used],
            faces=index.reshape(-1, 3).astype(np.int32),
            normals=normals[used],
            uvs=vertices[used, :2],
            finish=finish,
        )
        parts.append(part)
    shapes = [_make_solid(vertices, faces[~body.is_offered])]
    for ends, radius in zip(body.capsules, body.radii, strict=True):
        shapes += make_capsules(ends, float(radius))
    if parameters.pose == "seated":
        part, shape = _make_stool(vertices, faces[body.regions == list(FINISHES).index("trousers")])
        parts.append(part)
        shapes.append(shape)
    landmarks = {name: tuple(map(float, origin)) for name, origin in body.frames.items()}
    return assemble(
        "person",
        parts,
        shapes,
        {"target": landmarks["head_top"], **landmarks},  # pyright: ignore[reportArgumentType]
        asdict(parameters),
    )


class _Body(NamedTuple):
    """A posed person whose head's top is above the origin."""

    vertices: np.ndarray  # [m], shape (V, 3), float32
    faces: np.ndarray
    regions: np.ndarray
    """Finish of each triangle, shape (F,)."""
    is_offered: np.ndarray
    """True for triangles of the hand that garments are put on, shape (F,)."""
    capsules: np.ndarray
    """Ends of the capsules of that hand [m], shape (C, 2, 3)."""
    radii: np.ndarray
    """Their radii [m], shape (C,)."""
    frames: dict[str, np.ndarray]
    """Origins of frames [m], shape (3,)."""


_ARRAYS = tuple(name for name in _Body._fields if name != "frames")


def _load_body(parameters: PersonParameters) -> _Body:
    """Load or make the body.

    Making it takes seconds, so it is kept on disk.
    """
    text = json.dumps([GENERATOR_VERSION, asdict(parameters)], sort_keys=True)
    path = get_cache_folder("people") / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
    if path.is_file():
        try:
            kept = read_archive(path, (*_ARRAYS, *_FRAMES))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as err:
            logger.warning("%s cannot be read (%s); it is made again", path, err)
        else:
            frames = {name: kept[name] for name in _FRAMES}
            return _Body(*(kept[name] for name in _ARRAYS), frames=frames)
    body = _pose_body(parameters)
    try:
        arrays = {name: getattr(body, name) for name in _ARRAYS}
        write_archive(path, arrays | body.frames)
    except OSError as err:
        logger.warning("a person cannot be kept in %s (%s)", path.parent, err)
    return body


def _pose_body(parameters: PersonParameters) -> _Body:
    pose = parameters.pose
    person = make_person(parameters.measures, scale=parameters.scale)
    frames = {name: origin for name, (origin, _) in person.compute_frames(pose).items()}
    posed = person.pose(pose)
    moved = np.array([*frames["head_top"][:2], posed[:, 2].min()])
    side = _OFFERED.get(pose)
    joints = ("wrist", *FINGERS)
    is_hand = np.array(
        [side is not None and n.startswith(tuple(f"{side}_{j}" for j in joints))
         for n in person.skeleton.names]
    )  # fmt: skip
    ends, radii = person.compute_capsules(pose)
    counted = is_hand[[bone for bone, _, _ in person.capsules]]
    return _Body(
        vertices=(posed - moved).astype(np.float32),
        faces=person.faces,
        regions=_find_regions(person),
        is_offered=is_hand[_find_bones(person)],
        capsules=ends[counted] - moved,
        radii=radii[counted],
        frames={name: frames[name] - moved for name in _FRAMES},
    )


def _make_solid(vertices: np.ndarray, faces: np.ndarray) -> PropShape:
    """Make a solid of triangles of the skin, and close the cut at a wrist."""
    if len(np.unique(faces)) < len(vertices):
        used, index = np.unique(faces, return_inverse=True)
        vertices, faces, _, _ = close_small_holes(
            vertices[used], index.reshape(-1, 3), None, largest=np.inf
        )
    return PropShape(kind="mesh", points=vertices.astype(np.float32), faces=faces.astype(np.int32))


def _make_stool(vertices: np.ndarray, trousers: np.ndarray) -> tuple[PropPart, PropShape]:
    """Make a round stool that ends where the trousers are lowest behind the knees.

    Args:
        vertices: Skin of somebody seated who faces -y [m], shape (V, 3).
        trousers: Triangles of the trousers, shape (F, 3).
    """
    worn = vertices[np.unique(trousers)]
    back = worn[:, 1].max()
    seat = worn[worn[:, 1] > back - _STOOL * np.ptp(worn[:, 1])]
    radius = 0.4 * float(np.ptp(seat[:, 0]))
    x, y, top = float(seat[:, 0].mean()), float(back - 1.1 * radius), float(seat[:, 2].min())
    solid = cylinder("wood", radius, 0.0, top, bevel=0.006, segments=48).shifted(x, y, 0.0)
    shape = PropShape(kind="cylinder", radius=radius, half_length=top / 2, xyz=(x, y, top / 2))
    return make_part("stool", solid, make_wood("oak", seed=6)), shape


def _find_regions(person: Person) -> np.ndarray:
    """Index into `FINISHES` of each triangle, shape (F,), int8, by the bone of largest weight."""
    names = list(FINISHES)
    of_bone = []
    for bone in person.skeleton.names:
        if bone.endswith(("pelvis", "hip", "knee")):
            finish = "trousers"
        elif bone.endswith(("spine", "chest", "clavicle", "shoulder")):
            finish = "shirt"
        else:
            finish = "shoes" if bone.endswith(("ankle", "toes")) else "skin"
        of_bone.append(names.index(finish))
    return np.array(of_bone, dtype=np.int8)[_find_bones(person)]


def _find_bones(person: Person) -> np.ndarray:
    """Index of the bone that each triangle follows most, shape (F,)."""
    return person.weights[person.faces].sum(axis=1).argmax(axis=1)


def _compute_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
