"""People from SMPL-X, where the user has its model.

The model files are licensed by the Max Planck Institute for non-commercial research, and so is the library `smplx`: neither
comes with this package nor is downloaded by it.
"""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dgl_assets.errors import AssetError, AssetNotFoundError
from dgl_assets.people.person import Person
from dgl_assets.people.skeleton import Joint, Motion, Skeleton

_TO_PERSON = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])  # from y up, facing +z
_VERTEX_NAMES = {
    "nose": "nose_tip",
    "lear": "left_ear",
    "rear": "right_ear",
    **{
        f"{side[0]}{theirs}": f"{side}_{ours}_tip"
        for side in ("left", "right")
        for theirs, ours in (
            ("thumb", "thumb"),
            ("index", "index"),
            ("middle", "middle"),
            ("ring", "ring"),
            ("pinky", "little"),
        )
    },
    "LBigToe": "left_toe_tip",
    "RBigToe": "right_toe_tip",
    "LHeel": "left_heel",
    "RHeel": "right_heel",
}
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_NECK_BAND = 0.015  # half height of the ring in which the neck's landmarks are found [m]


def load_smplx(
    model_path: str | Path,
    *,
    gender: Literal["neutral", "female", "male"] = "neutral",
    betas: np.ndarray | None = None,
) -> Person:
    """Load a person from an SMPL-X model on disk.

    Args:
        model_path: The file SMPLX_<GENDER>.npz, or the folder that holds `smplx/SMPLX_<GENDER>.npz`.
        gender: Which of the models.
        betas: Coefficients of shape, shape (S,), S at most what the model has; the mean shape by default.

    Returns:
        A person in SMPL-X's rest pose (arms straight to the sides), standing on z = 0 and facing -y. Its motions are
        "<joint>_x", "_y", "_z" about the axes of the person frame, without limits.

    Raises:
        AssetError: If the library `smplx` is not installed, or is not as expected.
        AssetNotFoundError: If the model is not there.
        ValueError: If `betas` has another shape.

    Limitations:
        Pose correctives and expressions are left out: the skin follows by linear blend skinning alone.
    """
    path = Path(model_path)
    wanted = path if path.suffix else path / "smplx" / f"SMPLX_{gender.upper()}.npz"
    if not wanted.is_file():
        raise AssetNotFoundError(
            f"no SMPL-X model at {wanted}; register at https://smpl-x.is.tue.mpg.de, download the models, and give "
            "their folder"
        )
    try:
        smplx, joint_names, vertex_ids = (
            importlib.import_module(name)
            for name in ("smplx", "smplx.joint_names", "smplx.vertex_ids")
        )
    except ImportError as error:
        raise AssetError(
            "loading SMPL-X needs the library smplx, which is licensed for non-commercial research: install it with "
            f"`pip install smplx` if that suits you ({error})"
        ) from error
    model = smplx.create(
        str(path), model_type="smplx", gender=gender, use_pca=False, ext="npz", flat_hand_mean=True
    )
    return _build_person(
        model, tuple(joint_names.JOINT_NAMES), dict(vertex_ids.vertex_ids["smplx"]), betas
    )


def _build_person(
    model: Any, names: tuple[str, ...], vertex_ids: dict[str, int], betas: np.ndarray | None
) -> Person:
    template = _to_array(model.v_template)
    if betas is not None:
        directions = _to_array(model.shapedirs)
        betas = np.asarray(betas, dtype=np.float64)
        if betas.ndim != 1 or len(betas) > directions.shape[2]:
            raise ValueError(
                f"betas must have shape (S,) with S <= {directions.shape[2]}; got {betas.shape}"
            )
        template = template + directions[:, :, : len(betas)] @ betas
    places = _to_array(model.J_regressor) @ template
    parents = _to_array(model.parents).astype(int)
    vertices = template @ _TO_PERSON.T
    floor = np.array([0.0, 0.0, vertices[:, 2].min()])
    vertices, places = vertices - floor, places @ _TO_PERSON.T - floor
    weights = _to_array(model.lbs_weights)
    weights = weights / weights.sum(axis=1, keepdims=True)
    names = names[: len(parents)]
    skeleton = Skeleton(
        joints=tuple(
            Joint(
                name=name,
                parent=None if parent < 0 else names[parent],
                motions=tuple(
                    Motion(name=axis, axis=unit, low=-math.pi, high=math.pi)
                    for axis, unit in _AXES.items()
                ),
            )
            for name, parent in zip(names, parents, strict=True)
        ),
        positions=places,
        frames=np.broadcast_to(np.eye(3), (len(names), 3, 3)),
    )
    return Person(
        vertices=vertices.astype(np.float32),
        faces=np.asarray(model.faces).astype(np.int32),
        weights=weights.astype(np.float32),
        skeleton=skeleton,
        landmarks=_find_landmarks(vertices, weights, names, places, vertex_ids),
        frames=_find_frames(vertices, names, places),
        capsules=_fit_capsules(vertices, weights, parents, places),
    )


def _to_array(value: Any) -> np.ndarray:
    """A tensor or array as float64."""
    if hasattr(value, "detach"):
        value = value.detach().cpu().numpy()
    return np.asarray(value, dtype=np.float64)


def _find_landmarks(
    vertices: np.ndarray,
    weights: np.ndarray,
    names: tuple[str, ...],
    places: np.ndarray,
    vertex_ids: dict[str, int],
) -> dict[str, int]:
    found = {
        ours: vertex_ids[theirs] for theirs, ours in _VERTEX_NAMES.items() if theirs in vertex_ids
    }
    found["head_top"] = int(np.argmax(vertices[:, 2]))
    neck, head = names.index("neck"), names.index("head")
    level = 0.5 * (places[neck, 2] + places[head, 2])
    ring = np.flatnonzero(
        (np.abs(vertices[:, 2] - level) < _NECK_BAND) & (weights[:, [neck, head]].sum(axis=1) > 0.4)
    )
    if len(ring):
        for name, direction in (
            ("front", (0, -1)),
            ("back", (0, 1)),
            ("left", (1, 0)),
            ("right", (-1, 0)),
        ):
            found[f"neck_{name}"] = int(ring[np.argmax(vertices[ring, :2] @ np.array(direction))])
    return {name: int(vertex) for name, vertex in found.items()}


def _find_frames(
    vertices: np.ndarray, names: tuple[str, ...], places: np.ndarray
) -> dict[str, tuple[int, np.ndarray]]:
    top = vertices[np.argmax(vertices[:, 2])]
    neck, head = names.index("neck"), names.index("head")
    frames = {}
    for name, bone, origin in (
        ("head_top", head, top),
        ("neck", neck, 0.5 * (places[neck] + places[head])),
    ):
        frames[name] = (bone, np.eye(4))
        frames[name][1][:3, 3] = origin
    for side in ("left", "right"):
        wrist = names.index(f"{side}_wrist")
        knuckle = places[names.index(f"{side}_middle1")]
        along = (knuckle - places[wrist]) / np.linalg.norm(knuckle - places[wrist])
        out = np.array([0.0, 0.0, -1.0]) + along[2] * along  # palms are down
        out /= np.linalg.norm(out)
        transform = np.eye(4)
        transform[:3, :3] = np.column_stack([along, out, np.cross(along, out)])
        transform[:3, 3] = 0.5 * (knuckle + places[wrist])
        frames[f"{side}_hand"] = (wrist, transform)
    return frames


def _fit_capsules(
    vertices: np.ndarray, weights: np.ndarray, parents: np.ndarray, places: np.ndarray
) -> tuple[tuple[int, np.ndarray, float], ...]:
    """A capsule from each joint to each of its children, as thick as its skin is on average."""
    strongest = np.argmax(weights, axis=1)
    capsules = []
    for child, parent in enumerate(parents):
        own = vertices[strongest == parent] if parent >= 0 else vertices[:0]
        if not len(own):
            continue
        line = np.stack([places[parent], places[child]])
        along = line[1] - line[0]
        share = np.clip((own - line[0]) @ along / max(float(along @ along), 1e-12), 0, 1)
        distance = np.linalg.norm(own - line[0] - share[:, None] * along, axis=1)
        capsules.append((int(parent), line, float(np.median(distance))))
    return tuple(capsules)
