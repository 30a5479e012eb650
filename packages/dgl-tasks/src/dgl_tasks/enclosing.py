"""Rule of gloves: a garment encloses a hand, whose fingers are in tubes of their own."""

from dataclasses import dataclass

import numpy as np

from dgl_assets.importing.topology import find_loops
from dgl_physics.lattice import is_inside
from dgl_tasks.success import AtFrame, Criterion, SceneView, Share, Verdict, get_frame

__all__ = ["EnclosesHand", "is_enclosed"]

SAMPLES = 20
"""Points along the line from the wrist to a fingertip."""
BASES = {
    "thumb": ("thumb_heel", "thumb_crotch"),
    "index": ("index_knuckle", "index_middle_crotch"),
    "middle": ("index_middle_crotch", "middle_ring_crotch"),
    "ring": ("middle_ring_crotch", "ring_little_crotch"),
    "little": ("ring_little_crotch", "little_knuckle"),
}
"""Landmarks of a glove at the two sides of a tube's base, by digit."""


@dataclass(frozen=True, kw_only=True)
class EnclosesHand(AtFrame):
    """A glove is put on: it encloses most of a hand, and the fingers are in their own tubes.

    The hand is measured by the lines from the wrist to the five fingertips. A fingertip is in its
    own tube if the glove encloses it, and of the lines from each tube's base to its end, that of
    its own tube is the nearest, and the fingertip is beyond its base.
    """

    hand: str
    """Object and side of the hand, such as "person.right"."""
    share: Share = 0.8
    """Least share of the hand that is inside."""
    fingers: int = 3
    """Least number of the four fingers that are in their own tubes; the thumb is told."""

    @property
    def frames(self) -> tuple[str, ...]:
        """The frame, the wrist and the fingertips."""
        tips = (f"{self.hand}_{digit}_tip" for digit in BASES)
        return (self.frame, f"{self.hand}_wrist", *tips)

    @property
    def marks(self) -> tuple[str, ...]:
        """Ends of the tubes, and landmarks at their bases."""
        bases = (name for sides in BASES.values() for name in sides)
        return tuple(dict.fromkeys((*(f"{digit}_tip" for digit in BASES), *bases)))

    def __call__(self, view: SceneView) -> Verdict:
        """Measure the share of the hand inside the glove, and count fingers in their tubes."""
        wrist = get_frame(view.frames, f"{self.hand}_wrist")
        tips = np.stack([get_frame(view.frames, f"{self.hand}_{d}_tip") for d in BASES])
        along = np.linspace(0.0, 1.0, SAMPLES + 1)[1:, None]
        lines = wrist + along * (tips - wrist)[:, None]
        inside = view.enclose(lines.reshape(-1, 3)).reshape(len(tips), -1)
        own = {
            digit: bool(inside[k, -1]) and self._is_own(view, digit, tips[k])
            for k, digit in enumerate(BASES)
        }
        share = Criterion(
            name="share of the hand inside the glove",
            value=float(inside.mean()),
            comparison=">=",
            threshold=self.share,
            failure="not put on",
        )
        fingers = Criterion(
            name="fingers in their own tubes",
            value=float(sum(own.values()) - own["thumb"]),
            comparison=">=",
            threshold=float(self.fingers),
            failure="fingers in wrong tubes",
        )
        thumb = Criterion(
            name="thumb in its own tube", value=float(own["thumb"]), comparison=">=", threshold=0.0
        )
        return Verdict(criteria=(share, fingers, thumb))

    @staticmethod
    def _is_own(view: SceneView, digit: str, tip: np.ndarray) -> bool:
        distances, depths = {}, {}
        for name, sides in BASES.items():
            base = np.mean([view.places[side] for side in sides], axis=0)
            along = view.places[f"{name}_tip"] - base
            depths[name] = (tip - base) @ along / max(along @ along, np.finfo(float).tiny)
            nearest = base + np.clip(depths[name], 0.0, 1.0) * along
            distances[name] = np.linalg.norm(tip - nearest)
        return bool(distances[digit] == min(distances.values()) and depths[digit] > 0)


def is_enclosed(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Tell if a surface encloses points, where a fan of triangles closes each opening.

    Args:
        points: [m], shape (N, 3).
        vertices: [m], shape (V, 3).
        faces: Counter-clockwise seen from outside, shape (F, 3).

    Returns:
        Shape (N,), bool.
    """
    corners, fans = [np.asarray(vertices, dtype=np.float64)], [faces]
    for loop in find_loops(faces):
        middle = sum(map(len, corners))
        corners.append(corners[0][loop].mean(axis=0, keepdims=True))
        fans.append(np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), middle)]))
    return is_inside(np.asarray(points), np.concatenate(corners), np.concatenate(fans))
