"""A person as a prop: one who stands still while garments are put on."""

from __future__ import annotations

import hashlib
import json
import logging
import zipfile
from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np

from dgl_assets._archive import get_cache_folder, read_archive, write_archive
from dgl_assets.people import PEOPLE, POSES, make_person
from dgl_assets.props.meshes import assemble
from dgl_assets.props.prop import Finish, Prop, PropPart
from dgl_assets.props.shapes import PropShape
from dgl_assets.ranges import check_ranges

logger = logging.getLogger(__name__)

GENERATOR_VERSION = 1
"""Raised whenever the same parameters give another person than before."""
SKIN = Finish(name="skin", colour=(0.42, 0.25, 0.18), roughness=0.62, density=985.0)
"""A matt skin; the density is that of a human body."""


@dataclass(frozen=True, kw_only=True)
class PersonParameters:
    """Who stands there, and how."""

    measures: str = "woman"
    """One of `dgl_assets.people.PEOPLE`."""
    scale: float = 0.85
    """Factor of all lengths, in [0.3, 1.5]; garments of this package are made for 0.85."""
    pose: str = "standing"
    """One of `dgl_assets.people.POSES`."""

    def __post_init__(self) -> None:
        check_ranges({"scale": self.scale}, {"scale": (0.3, 1.5)})
        for name, value, known in (("measures", self.measures, PEOPLE), ("pose", self.pose, POSES)):
            if value not in known:
                raise ValueError(f"{name} must be one of {sorted(known)}; got {value!r}")


@lru_cache(maxsize=8)
def make_person_prop(parameters: PersonParameters) -> Prop:
    """Make a person who stands on z = 0 and faces -y; the target is the top of the head.

    The other landmarks are those of `Person.frames`.
    """
    vertices, faces, frames = _load_body(parameters)
    body = PropPart(
        name="body",
        vertices=vertices,
        faces=faces,
        normals=_compute_normals(vertices, faces),
        uvs=vertices[:, :2].copy(),
        finish=SKIN,
    )
    places = {name: tuple(float(v) for v in place) for name, place in frames.items()}
    return assemble(
        "person",
        [body],
        [PropShape(kind="mesh", points=vertices, faces=faces)],
        {"target": places["head_top"], **places},  # pyright: ignore[reportArgumentType]
        asdict(parameters),
    )


def _load_body(
    parameters: PersonParameters,
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Skin [m] and frames [m] of a posed person, the head's top above the origin; kept on disk, as making them takes seconds."""
    text = json.dumps([GENERATOR_VERSION, asdict(parameters)], sort_keys=True)
    path = get_cache_folder("people") / f"{hashlib.sha256(text.encode()).hexdigest()[:32]}.npz"
    names = ("head_top", "brow", "neck", "left_hand", "right_hand")
    if path.is_file():
        try:
            kept = read_archive(path, ("vertices", "faces", *names))
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as err:
            logger.warning("%s cannot be read (%s); it is made again", path, err)
        else:
            return kept["vertices"], kept["faces"], {name: kept[name] for name in names}
    person = make_person(parameters.measures, scale=parameters.scale)
    frames = {name: place for name, (place, _) in person.compute_frames(parameters.pose).items()}
    moved = np.array([*frames["head_top"][:2], 0.0])
    vertices = (person.pose(parameters.pose) - moved).astype(np.float32)
    frames = {name: frames[name] - moved for name in names}
    try:
        write_archive(path, {"vertices": vertices, "faces": person.faces, **frames})
    except OSError as err:
        logger.warning("a person cannot be kept in %s (%s)", path.parent, err)
    return vertices, person.faces, frames


def _compute_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
