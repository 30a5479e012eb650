"""A person as a prop: one who stands still while garments are put on."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from functools import lru_cache

import numpy as np

from dgl_assets.people import PEOPLE, POSES, make_person
from dgl_assets.props.meshes import assemble
from dgl_assets.props.prop import Finish, Prop, PropPart
from dgl_assets.props.shapes import PropShape
from dgl_assets.ranges import check_ranges

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
    person = make_person(parameters.measures, scale=parameters.scale)
    vertices = person.pose(parameters.pose)
    frames = {name: place for name, (place, _) in person.compute_frames(parameters.pose).items()}
    moved = np.array([*frames["head_top"][:2], 0.0])
    vertices = (vertices - moved).astype(np.float32)
    body = PropPart(
        name="body",
        vertices=vertices,
        faces=person.faces,
        normals=_compute_normals(vertices, person.faces),
        uvs=vertices[:, :2].copy(),
        finish=SKIN,
    )
    places = {name: tuple(float(v) for v in place - moved) for name, place in frames.items()}
    return assemble(
        "person",
        [body],
        [PropShape(kind="mesh", points=vertices, faces=person.faces)],
        {"target": places["head_top"], **places},  # pyright: ignore[reportArgumentType]
        asdict(parameters),
    )


def _compute_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(normals, faces[:, k], across)
    return (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32)
