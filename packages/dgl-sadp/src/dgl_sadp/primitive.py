"""Task-parameterised movement primitives: ways of the hands, learnt from a few recordings.

Displacements of each hand are affine functions of *anchors*: points on the garment, frames of
objects, extents of the cloud, the world's origin. Level weights are the same for x and y, so that
the way turns, moves and grows with the anchors. Heights follow from heights and level distances.

Source:
    Calinon, "A tutorial on task-parameterized movement learning and retrieval", 2016; the
    regression instead of a mixture as in Paraschos et al., "Probabilistic movement primitives",
    2013.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dgl_sadp._alignment import align, choose_knots
from dgl_sadp.errors import PrimitiveError

__all__ = ["HandWay", "Primitive", "Recording", "Way", "fit_primitive"]

FRAMES_PER_SECOND = 12
"""Of recordings and of ways."""
LEAST_RECORDINGS = 3
WORLD = "world"
"""Anchor at the world's origin; every primitive has it."""
_KNOTS_WITHIN = 0.004
"""Largest distance of a mean way from the lines between its knots [m]."""
_POSE_SCALE, _TURN_SCALE = 0.05, 0.1
"""Lengths that a change of a hand from one pose to another, and a turn by 1 rad, count for [m]."""
_ALIGNMENTS = 3
"""Alignments with expected ways."""
_PENALTIES = tuple(10.0**k for k in range(-6, 2))
_STILL = 0.01
"""Movement between two knots below which their time does not depend on the distance [m]."""
_STRETCH = 3.0
"""Largest factor by which a movement takes longer or shorter than in the recordings."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Recording:
    """One recorded stage, from the moment that the hands are at their grasp points."""

    anchors: Mapping[str, np.ndarray]
    """Positions by name [m], shape (3,), world frame."""
    points: Mapping[str, np.ndarray]
    """Grasp point of each hand by name [m], shape (T, 3), world frame, 12 frames a second."""
    turns: Mapping[str, np.ndarray]
    """Rotation vector from the first orientation to each, in the hand's frame [rad], (T, 3)."""
    hands: Mapping[str, np.ndarray]
    """Coordinates of each hand's pose, shape (T, P): weights of the robot's named poses."""

    def __post_init__(self) -> None:
        if not self.points:
            raise PrimitiveError("a recording must have the way of a hand; got none")
        lengths = set()
        for name in ("points", "turns", "hands"):
            ways = getattr(self, name)
            if set(ways) != set(self.points):
                raise PrimitiveError(f"{name} must be of {sorted(self.points)}; got {sorted(ways)}")
            for side, way in ways.items():
                if way.ndim != 2 or (name != "hands" and way.shape[1] != 3):
                    raise PrimitiveError(
                        f"{name} of {side} must have shape (T, 3); got {way.shape}"
                    )
                if not np.isfinite(way).all():
                    raise PrimitiveError(f"{name} of {side} must be finite; got some that are not")
                lengths.add(len(way))
        if len(lengths) > 1 or min(lengths) < 2:
            raise PrimitiveError(f"recordings must have 2 frames or more, alike; got {lengths}")
        for name, place in self.anchors.items():
            if np.shape(place) != (3,) or not np.isfinite(place).all():
                raise PrimitiveError(f"anchor {name} must be 3 finite numbers; got {place}")

    def tabulate(self) -> dict[str, np.ndarray]:
        """Give displacements, turns and poses of each hand in one table, shape (T, 6 + P)."""
        return {
            side: np.concatenate([way - way[0], self.turns[side], self.hands[side]], axis=1)
            for side, way in self.points.items()
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class HandWay:
    """Way of one hand."""

    points: np.ndarray
    """Grasp point [m], shape (N, 3), world frame."""
    turns: np.ndarray
    """Rotation vector from the first orientation, in the hand's frame [rad], shape (N, 3)."""
    poses: np.ndarray
    """Coordinates of the hand's pose, shape (N, P)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """Ways of all working hands, the start left out."""

    hands: Mapping[str, HandWay]
    spread: float
    """Standard deviation of the way's end, as expected from the recordings [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HandModel:
    """Affine functions for one hand at K knots, of A anchors, the world's origin last."""

    mean: np.ndarray
    """Mean displacement [m], shape (K, 3)."""
    level: np.ndarray
    """Weights of the anchors' level vectors, and constants for x and y, shape (A + 2, K)."""
    height: np.ndarray
    """Weights of their heights and level distances, and a constant, shape (2 A + 1, K)."""
    turns: np.ndarray
    """Mean rotation vector [rad], shape (K, 3)."""
    poses: np.ndarray
    """Mean coordinates of the hand's pose, shape (K, P)."""
    leverage: np.ndarray
    """Inverse of the level normal matrix, shape (A + 2, A + 2)."""
    noise: np.ndarray
    """Standard deviation of displacements, from recordings left out [m], shape (K,)."""

    def compute_way(self, vectors: np.ndarray) -> np.ndarray:
        """Compute the displacements [m], shape (K, 3), for vectors to the anchors (A, 3)."""
        xy = _lay_out_level(vectors) @ self.level
        return np.stack([*xy, _lay_out_height(vectors) @ self.height], axis=1)

    def compute_spread(self, vectors: np.ndarray) -> float:
        """Compute the standard deviation of the last displacement [m]."""
        level = _lay_out_level(vectors)
        share = np.einsum("ri,ij,rj->r", level, self.leverage, level).mean()
        return float(self.noise[-1] * np.sqrt(1 + share))

    def expect(self, vectors: np.ndarray) -> np.ndarray:
        """Compute displacements, turns and poses, shape (K, 6 + P)."""
        return np.concatenate([self.compute_way(vectors), self.turns, self.poses], axis=1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Primitive:
    """The way of the hands in one stage."""

    anchors: tuple[str, ...]
    """Names of the anchors that it needs, without the world's origin."""
    durations: np.ndarray
    """Mean time between neighbouring knots [frames], shape (K - 1,)."""
    distances: np.ndarray
    """Mean distance that the faster hand covers meanwhile [m], shape (K - 1,)."""
    hands: Mapping[str, HandModel]

    @property
    def error(self) -> float:
        """Root mean square error of the way's end for recordings left out [m]."""
        return float(np.sqrt(np.mean([model.noise[-1] ** 2 for model in self.hands.values()])))

    def plan(
        self,
        starts: Mapping[str, np.ndarray],
        anchors: Mapping[str, np.ndarray],
        *,
        frames_per_second: float = FRAMES_PER_SECOND,
        is_blind: bool = False,
    ) -> Way:
        """Plan the way from the hands' grasp points.

        Args:
            starts: Grasp point of each working hand [m], shape (3,), world frame.
            anchors: Positions by name [m], shape (3,); more than needed may be there.
            frames_per_second: Rate of the way.
            is_blind: Take the mean displacements of the recordings whatever the anchors are.

        Raises:
            PrimitiveError: If a start or an anchor is missing.
        """
        if set(starts) != set(self.hands):
            raise PrimitiveError(f"starts must be of {sorted(self.hands)}; got {sorted(starts)}")
        ways, spreads = {}, []
        for side, model in self.hands.items():
            if is_blind:
                ways[side] = model.mean
                continue
            vectors = _find_vectors(self.anchors, anchors, np.asarray(starts[side], float))
            ways[side] = model.compute_way(vectors)
            spreads.append(model.compute_spread(vectors))
        at = self._time(ways) * (frames_per_second / FRAMES_PER_SECOND)
        count = max(1, int(np.ceil(at[-1] - 1e-9)))
        frames = at[-1] * np.arange(1, count + 1) / count
        hands = {
            side: HandWay(
                points=np.asarray(starts[side], float) + _interpolate(frames, at, ways[side]),
                turns=_interpolate(frames, at, model.turns),
                poses=_interpolate(frames, at, model.poses),
            )
            for side, model in self.hands.items()
        }
        return Way(
            hands=hands, spread=float(np.sqrt(np.mean(np.square(spreads)))) if spreads else 0.0
        )

    def _time(self, ways: Mapping[str, np.ndarray]) -> np.ndarray:
        """Give each knot its time [frames], shape (K,), at the recordings' speeds."""
        distances = _measure_steps(ways)
        moving = self.distances > _STILL
        stretch = np.ones(len(distances))
        stretch[moving] = (distances[moving] / self.distances[moving]).clip(1 / _STRETCH, _STRETCH)
        return np.concatenate([[0.0], np.cumsum(self.durations * stretch)])


def fit_primitive(recordings: Sequence[Recording]) -> Primitive:
    """Learn the way of the hands in one stage.

    Displacements are regressed on the anchors by ridge regression, at each time of the common
    course, with the penalty that predicts recordings best that are left out. Recordings are aligned
    in time with one of them first, then with the ways that the regression expects.

    Args:
        recordings: With the same hands and coordinates; anchors that some lack are left out.

    Raises:
        PrimitiveError: If there are too few, they are of different hands, or none moves.
    """
    if len(recordings) < LEAST_RECORDINGS:
        raise PrimitiveError(
            f"a primitive needs {LEAST_RECORDINGS} recordings or more; got {len(recordings)}"
        )
    kinds = {tuple(sorted((s, h.shape[1]) for s, h in r.hands.items())) for r in recordings}
    if len(kinds) > 1:
        raise PrimitiveError(f"recordings must be of the same hands; got {sorted(kinds)}")
    tables = [r.tabulate() for r in recordings]
    extents = [max(np.abs(t[:, :3]).max() for t in table.values()) for table in tables]
    if min(extents) < _STILL:
        raise PrimitiveError(f"a hand must move in every recording; got {min(extents):.3f} m")
    sides = sorted(recordings[0].points)
    names = tuple(sorted(set.intersection(*(set(r.anchors) for r in recordings)) - {WORLD}))
    vectors = {
        s: np.stack([_find_vectors(names, r.anchors, r.points[s][0]) for r in recordings])
        for s in sides
    }

    order = np.argsort([len(table[sides[0]]) for table in tables], kind="stable")
    reference = int(order[(len(order) - 1) // 2])
    sized = [
        _weigh(t, np.mean(extents) / extent) for t, extent in zip(tables, extents, strict=True)
    ]
    frames = [align(sized[reference], course) for course in sized]
    for _ in range(_ALIGNMENTS):
        models = {s: _fit_hand(vectors[s], _sample(tables, s, frames)) for s in sides}
        for k, table in enumerate(tables):
            expected = {s: models[s].expect(vectors[s][k]) for s in sides}
            frames[k] = align(_weigh(expected), _weigh(table))
    samples = {s: _sample(tables, s, frames) for s in sides}
    knots = choose_knots(
        _weigh({s: sample.mean(axis=0) for s, sample in samples.items()}), within=_KNOTS_WITHIN
    )
    distances = [
        _measure_steps({s: samples[s][k][knots, :3] for s in sides}) for k in range(len(tables))
    ]
    return Primitive(
        anchors=names,
        durations=np.diff(np.stack(frames)[:, knots], axis=1).mean(axis=0),
        distances=np.mean(distances, axis=0),
        hands={s: _fit_hand(vectors[s], samples[s][:, knots]) for s in sides},
    )


def _weigh(tables: Mapping[str, np.ndarray], size: float = 1.0) -> np.ndarray:
    """Join the hands' tables, each quantity as a length [m], displacements times `size`."""
    weights = [size] * 3 + [_TURN_SCALE] * 3
    return np.concatenate(
        [
            table * np.array(weights + [_POSE_SCALE] * (table.shape[1] - len(weights)))
            for _, table in sorted(tables.items())
        ],
        axis=1,
    )


def _sample(
    tables: Sequence[Mapping[str, np.ndarray]], side: str, frames: Sequence[np.ndarray]
) -> np.ndarray:
    """Read the recordings of one hand at aligned frames, shape (n, T, 6 + P)."""
    return np.stack(
        [
            _interpolate(at, np.arange(len(table[side])), table[side])
            for at, table in zip(frames, tables, strict=True)
        ]
    )


def _fit_hand(vectors: np.ndarray, sample: np.ndarray) -> HandModel:
    """Fit one hand to vectors (n, A, 3) and aligned recordings (n, K, 6 + P)."""
    way = sample[..., :3]
    level = np.stack([_lay_out_level(v) for v in vectors])  # (n, 2, A + 2)
    height = np.stack([_lay_out_height(v) for v in vectors])[:, None]  # (n, 1, 2 A + 1)
    xy = np.moveaxis(way[..., :2], 2, 1)  # (n, 2, K)
    weights, left_out, leverage, share = _regress(level, xy, constants=2)
    heights, left_out_z, _, _ = _regress(height, way[..., 2][:, None], constants=1)
    squares = (left_out**2).sum(axis=1) + (left_out_z**2).sum(axis=1)  # (n, K)
    return HandModel(
        mean=way.mean(axis=0),
        level=weights,
        height=heights,
        turns=sample[..., 3:6].mean(axis=0),
        poses=sample[..., 6:].mean(axis=0),
        leverage=leverage,
        noise=np.sqrt(squares.mean(axis=0) / (1 + share)),
    )


def _regress(
    design: np.ndarray, wanted: np.ndarray, *, constants: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Regress with the penalty that predicts recordings best that are left out.

    Args:
        design: Rows of each recording, shape (n, r, F); the last columns are constants.
        wanted: Shape (n, r, K).
        constants: Number of these columns, which have no penalty.

    Returns:
        Weights (F, K), errors of recordings left out (n, r, K), the inverse of the normal matrix
        (F, F), and the mean leverage of a recording that is left out.
    """
    free = np.ones(design.shape[2])
    free[-constants:] = 0.0

    def solve(x: np.ndarray, y: np.ndarray, penalty: float) -> tuple[np.ndarray, np.ndarray]:
        x, y = x.reshape(-1, x.shape[2]), y.reshape(-1, y.shape[2])
        inverse = np.linalg.inv(x.T @ x + np.diag(penalty * len(x) * free + 1e-9))
        return inverse @ x.T @ y, inverse

    best = None
    for penalty in _PENALTIES:
        errors, shares = [], []
        for k in range(len(design)):
            rest = np.arange(len(design)) != k
            weights, inverse = solve(design[rest], wanted[rest], penalty)
            errors.append(wanted[k] - design[k] @ weights)
            shares.append(np.einsum("ri,ij,rj->r", design[k], inverse, design[k]).mean())
        error = np.stack(errors)
        score = float((error**2).sum())
        if best is None or score < best[0]:
            best = score, penalty, error, float(np.mean(shares))
    assert best is not None
    _, penalty, error, share = best
    weights, inverse = solve(design, wanted, penalty)
    return weights, error, inverse, share


def _find_vectors(
    names: Sequence[str], anchors: Mapping[str, np.ndarray], start: np.ndarray
) -> np.ndarray:
    """Compute the vectors from a hand's start to the anchors and the origin [m], (A, 3)."""
    missing = [name for name in names if name not in anchors]
    if missing:
        raise PrimitiveError(f"anchors must have {', '.join(missing[:4])}; got {sorted(anchors)}")
    places = [np.asarray(anchors[name], dtype=float) for name in names]
    return np.stack([*places, np.zeros(3)]) - start


def _lay_out_level(vectors: np.ndarray) -> np.ndarray:
    """Lay out the rows of x and y, shape (2, A + 2)."""
    return np.concatenate([vectors[:, :2].T, np.eye(2)], axis=1)


def _lay_out_height(vectors: np.ndarray) -> np.ndarray:
    """Lay out the row of z, shape (2 A + 1,)."""
    distances = np.linalg.norm(vectors[:, :2], axis=1)
    return np.concatenate([vectors[:, 2], distances, [1.0]])


def _measure_steps(ways: Mapping[str, np.ndarray]) -> np.ndarray:
    """Measure the distance that the faster hand covers between neighbouring knots [m], (K - 1,)."""
    return np.max([np.linalg.norm(np.diff(w, axis=0), axis=1) for w in ways.values()], axis=0)


def _interpolate(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(at, times, column) for column in values.T], axis=1)
