"""A person: skin, skeleton, landmarks, frames and capsules in any pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from dgl_assets.people.body_plan import BodyPlan, make_plan
from dgl_assets.people.measures import PEOPLE, PersonMeasures
from dgl_assets.people.skeleton import FINGERS, Skeleton
from dgl_assets.people.skin import compute_weights, make_skin
from dgl_assets.people.solids import Cone, Ellipsoid

POSES: dict[str, dict[str, float]] = {
    "rest": {},
    "standing": {
        **{f"{side}_shoulder_abduction": 0.13 for side in ("left", "right")},
        **{f"{side}_elbow_flexion": 0.22 for side in ("left", "right")},
        **{
            f"{side}_{finger}{k}_flexion": 0.22
            for side in ("left", "right")
            for finger in ("index", "middle", "ring", "little")
            for k in (1, 2, 3)
        },
    },
    "seated": {
        f"{side}_{motion}": angle
        for side in ("left", "right")
        for motion, angle in {
            "shoulder_abduction": 0.13,
            "shoulder_flexion": 0.20,
            "elbow_flexion": 1.05,
            "elbow_pronation": 0.9,
            "hip_flexion": 1.45,
            "hip_abduction": 0.12,
            "knee_flexion": 1.45,
        }.items()
    },
    "t_pose": {f"{side}_shoulder_abduction": 1.55 for side in ("left", "right")},
    "offer_right": {
        "left_shoulder_abduction": 0.13,
        "left_elbow_flexion": 0.22,
        "right_shoulder_abduction": 1.2,
        "right_shoulder_rotation": 1.22,
        "right_elbow_flexion": 1.2,
        "right_elbow_pronation": -1.45,
        "right_wrist_deviation": -0.3,
        "right_thumb1_spread": -0.34,
        **{
            f"right_{finger}{k}_flexion": 0.05
            for finger in ("index", "middle", "ring", "little")
            for k in (1, 2, 3)
        },
    },
    "reach_right": {
        "left_shoulder_abduction": 0.13,
        "left_elbow_flexion": 0.22,
        "right_shoulder_abduction": 0.0,
        "right_shoulder_flexion": 1.45,
        "right_elbow_flexion": 0.08,
        "right_elbow_pronation": 1.45,
    },
}
"""Angles [rad] of named poses. "standing" and "seated" are for hats and scarves; "offer_right"
lets the right hand hang beside the body, fingers down and palm inward, for a glove; "reach_right"
holds it out, palm down."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Person:
    """A person with a skin that follows a skeleton.

    Person frame: standing on z = 0, z up, facing -y; the person's own left is +x.
    """

    vertices: np.ndarray
    """Skin in the rest pose [m], shape (V, 3), float32."""
    faces: np.ndarray
    """Triangles, counter-clockwise from outside, shape (F, 3), int32: a closed manifold."""
    weights: np.ndarray
    """Weight of each bone for each vertex, shape (V, J), float32; rows sum to 1."""
    skeleton: Skeleton
    landmarks: dict[str, int]
    """Vertex id of each named point."""
    frames: dict[str, tuple[int, np.ndarray]]
    """Frames in the rest pose: index of the bone and transform_frame_to_person, shape (4, 4).

    "head_top", "brow", "neck", "left_shoulder", "right_shoulder": z up, -y to the front. "hand",
    the middle of the palm, "wrist", and tips of fingers such as "thumb_tip", after "left_" or
    "right_": x along the fingers, y out of the palm, z = x cross y, as the robots' hands.
    """
    capsules: tuple[tuple[int, np.ndarray, float], ...]
    """In the rest pose: index of the bone, both ends [m], shape (2, 3), and the radius [m]."""

    def __post_init__(self) -> None:
        count, joints = len(self.vertices), len(self.skeleton.joints)
        if self.weights.shape != (count, joints):
            raise ValueError(
                f"weights must have shape ({count}, {joints}); got {self.weights.shape}"
            )
        error = float(np.abs(self.weights.sum(axis=1) - 1).max())
        if error > 1e-4 or self.weights.min() < 0:
            raise ValueError(
                f"rows of weights must be >= 0 and sum to 1; got a sum off by {error:.2g} and a "
                f"smallest weight of {self.weights.min():.2g}"
            )

    def pose(self, angles: Mapping[str, float] | str = "rest") -> np.ndarray:
        """Move the skin (linear blend skinning).

        Args:
            angles: Angle [rad] of motions by "<joint>_<motion>", or the name of a pose in `POSES`.

        Returns:
            Vertices [m], shape (V, 3), float32.

        Raises:
            ValueError: If a pose or motion does not exist, or an angle is out of its limits.

        Limitations:
            Volume shrinks a little inside of sharply bent joints, and where a bone twists.
        """
        transforms = self.skeleton.compute_transforms(_get_angles(angles))
        moved = np.zeros((len(self.vertices), 3))
        for k in range(len(transforms)):
            rows = np.flatnonzero(self.weights[:, k])
            turned = self.vertices[rows] @ transforms[k, :3, :3].T + transforms[k, :3, 3]
            moved[rows] += self.weights[rows, k, None] * turned
        return moved.astype(np.float32)

    def compute_frames(
        self, angles: Mapping[str, float] | str = "rest"
    ) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Compute the named frames in a pose.

        Args:
            angles: As for `pose`.

        Returns:
            By name: position [m], shape (3,), and quaternion wxyz, shape (4,), person frame.
        """
        transforms = self.skeleton.compute_transforms(_get_angles(angles))
        result = {}
        for name, (bone, rest) in self.frames.items():
            now = transforms[bone] @ rest
            xyzw = Rotation.from_matrix(now[:3, :3]).as_quat(canonical=True)
            result[name] = (now[:3, 3].copy(), np.roll(xyzw, 1))
        return result

    def compute_capsules(
        self, angles: Mapping[str, float] | str = "rest"
    ) -> tuple[np.ndarray, np.ndarray]:
        """Compute capsules that fill the body, for collisions.

        Args:
            angles: As for `pose`.

        Returns:
            Ends [m], shape (C, 2, 3), and radii [m], shape (C,), person frame.
        """
        transforms = self.skeleton.compute_transforms(_get_angles(angles))
        ends = [
            line @ transforms[b, :3, :3].T + transforms[b, :3, 3] for b, line, _ in self.capsules
        ]
        return np.stack(ends), np.array([radius for _, _, radius in self.capsules])

    def get_landmark_positions(
        self, names: tuple[str, ...], angles: Mapping[str, float] | str = "rest"
    ) -> np.ndarray:
        """Positions of named points [m], shape (K, 3), in a pose.

        Raises:
            KeyError: If a name is unknown; the message lists the valid ones.
        """
        unknown = [name for name in names if name not in self.landmarks]
        if unknown:
            raise KeyError(
                f"unknown landmarks {unknown}; expected some of {sorted(self.landmarks)}"
            )
        return self.pose(angles)[[self.landmarks[name] for name in names]]


def make_person(measures: PersonMeasures | str = "man", *, scale: float = 1.0) -> Person:
    """Make a person.

    Args:
        measures: Measures, or the name of one of `PEOPLE`.
        scale: Factor of all lengths, 0.3 to 1.5. Garments of this package are made for 0.85.

    Returns:
        The person in the rest pose.

    Raises:
        ValueError: If the name does not exist, or scale is out of range.
        MeshingError: If these measures give no closed skin.
    """
    if not 0.3 <= scale <= 1.5:
        raise ValueError(f"scale must be in [0.3, 1.5]; got {scale}")
    if isinstance(measures, str):
        if measures not in PEOPLE:
            raise ValueError(f"measures must be one of {sorted(PEOPLE)}; got {measures!r}")
        measures = PEOPLE[measures]
    plan = make_plan(measures)
    vertices, faces = make_skin(plan)
    weights = compute_weights(plan, vertices, faces)
    _, nearest = KDTree(vertices).query(np.stack(list(plan.points.values())))
    return Person(
        vertices=(scale * vertices).astype(np.float32),
        faces=faces,
        weights=weights.astype(np.float32),
        skeleton=replace(plan.skeleton, positions=scale * plan.skeleton.positions),
        landmarks={
            name: int(k) for name, k in zip(plan.points, np.atleast_1d(nearest), strict=True)
        },
        frames=_make_frames(plan, vertices, scale),
        capsules=_make_capsules(plan, scale),
    )


def _get_angles(angles: Mapping[str, float] | str) -> Mapping[str, float]:
    if isinstance(angles, str):
        if angles not in POSES:
            raise ValueError(f"pose must be one of {sorted(POSES)}; got {angles!r}")
        return POSES[angles]
    return angles


def _make_frames(
    plan: BodyPlan, vertices: np.ndarray, scale: float
) -> dict[str, tuple[int, np.ndarray]]:
    names, points = plan.skeleton.names, plan.points
    frames = {}

    def add(name: str, bone: str, origin: np.ndarray, axes: np.ndarray) -> None:
        transform = np.eye(4)
        transform[:3, :3], transform[:3, 3] = axes, scale * origin
        frames[name] = (names.index(bone), transform)

    top = vertices[np.argmax(vertices[:, 2])]
    brow = 0.25 * sum(points[k] for k in ("brow", "occiput", "left_temple", "right_temple"))
    neck = 0.25 * sum(points[f"neck_{k}"] for k in ("front", "back", "left", "right"))
    add("head_top", "head", np.array([0.0, top[1], top[2]]), np.eye(3))
    add("brow", "head", np.asarray(brow), np.eye(3))
    add("neck", "neck", np.asarray(neck), np.eye(3))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        turn = plan.arm_frames[side]
        along, out = turn @ np.array([0.0, 0.0, -1.0]), turn @ np.array([-sign, 0.0, 0.0])
        axes = np.column_stack([along, out, np.cross(along, out)])
        add(f"{side}_shoulder", f"{side}_clavicle", points[f"{side}_acromion"], np.eye(3))
        origin = 0.5 * (points[f"{side}_palm_centre"] + points[f"{side}_hand_back"])
        add(f"{side}_hand", f"{side}_wrist", origin, axes)
        wrist = plan.skeleton.positions[names.index(f"{side}_wrist")]
        add(f"{side}_wrist", f"{side}_wrist", wrist, axes)
        for finger in FINGERS:
            add(f"{side}_{finger}_tip", f"{side}_{finger}3", points[f"{side}_{finger}_tip"], axes)
    return frames


def _make_capsules(plan: BodyPlan, scale: float) -> tuple[tuple[int, np.ndarray, float], ...]:
    """Make one capsule a cone and ellipsoid; the trunk's sections as capsules from side to side."""
    capsules = []

    def add(bone: str, start: np.ndarray, end: np.ndarray, radius: float) -> None:
        line = scale * np.stack([start, end])
        capsules.append((plan.skeleton.names.index(bone), line, scale * radius))

    for solid in plan.body.list_solids():
        if isinstance(solid, Cone):
            radius = float(np.mean(solid.radii)) * (1 - 0.5 * solid.flatness)
            add(solid.bone, solid.start, solid.end, radius)
        elif isinstance(solid, Ellipsoid):
            radius = float(np.sort(solid.radii)[1])
            longest = np.eye(3)[int(np.argmax(solid.radii))]
            reach = (float(solid.radii.max()) - radius) * longest
            add(solid.bone, solid.centre - reach, solid.centre + reach, radius)
        else:
            for level in np.linspace(0.08, 0.92, 9):
                z = solid.heights[0] + level * (solid.heights[-1] - solid.heights[0])
                a = float(np.interp(z, solid.heights, solid.half_widths))
                b = float(np.interp(z, solid.heights, solid.half_depths))
                centre = np.array([0, float(np.interp(z, solid.heights, solid.centres)), z])
                reach = np.array([max(a - b, 0.0), 0, 0])
                bone = solid.bones[int(np.searchsorted(np.array(solid.borders), z))]
                add(bone, centre - reach, centre + reach, min(a, b))
    return tuple(capsules)
