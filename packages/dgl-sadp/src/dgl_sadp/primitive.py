"""Task-parameterised movement primitives: ways of the hands, learnt from a few recordings.

Displacements of each hand are affine functions of *anchors*: points on the garment, frames of
objects, extents of the cloud, the world's origin. Level weights are the same for x and y, so that
the way turns, moves and grows with the anchors, unless weights of its own predict x or y of
left-out recordings better: robots and objects often stand along the axes. Heights follow from
heights, and from level distances where these help. All hands share their inputs: hands that all
recordings keep at one height stay at one height.

Source:
    Calinon, "A tutorial on task-parameterized movement learning and retrieval", 2016; the
    regression instead of a mixture as in Paraschos et al., "Probabilistic movement primitives",
    2013.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
    """Affine functions for one of H hands at K knots, of A anchors, the world's origin last."""

    mean: np.ndarray
    """Mean displacement [m], shape (K, 3)."""
    level: np.ndarray
    """Weights of the anchors' vectors and a constant, for x and for y, shape (2, A + 1, K)."""
    height: np.ndarray
    """Weights of the numbers of `_lay_out_height`, shape (2 A + H + 1, K)."""
    turns: np.ndarray
    """Mean rotation vector [rad], shape (K, 3)."""
    poses: np.ndarray
    """Mean coordinates of the hand's pose, shape (K, P)."""
    leverage: np.ndarray
    """Inverse of the normal matrices of `level`, shape (2, A + 1, A + 1)."""
    noise: np.ndarray
    """Standard deviation of displacements, from recordings left out [m], shape (K,)."""

    def compute_way(self, vectors: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Compute the displacements [m], shape (K, 3).

        Args:
            vectors: From the hand's start to the anchors [m], shape (A, 3).
            heights: As of `_lay_out_height`.
        """
        xy = np.einsum("ri,rik->rk", _lay_out_level(vectors), self.level)
        return np.stack([*xy, heights @ self.height], axis=1)

    def compute_spread(self, vectors: np.ndarray) -> float:
        """Compute the standard deviation of the last displacement [m]."""
        level = _lay_out_level(vectors)
        share = np.einsum("ri,rij,rj->r", level, self.leverage, level).mean()
        return float(self.noise[-1] * np.sqrt(1 + share))

    def expect(self, vectors: np.ndarray, heights: np.ndarray) -> np.ndarray:
        """Compute displacements, turns and poses, shape (K, 6 + P); see `compute_way`."""
        return np.concatenate([self.compute_way(vectors, heights), self.turns, self.poses], axis=1)


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
        if is_blind:
            ways, spreads = {side: model.mean for side, model in self.hands.items()}, [0.0]
        else:
            vectors = {
                side: _find_vectors(self.anchors, anchors, np.asarray(start, float))
                for side, start in starts.items()
            }
            heights = _lay_out_height(vectors)
            ways = {s: model.compute_way(vectors[s], heights) for s, model in self.hands.items()}
            spreads = [model.compute_spread(vectors[s]) for s, model in self.hands.items()]
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
        return Way(hands=hands, spread=float(np.sqrt(np.mean(np.square(spreads)))))

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
    course, with the penalty that predicts recordings best that are left out. In the same way it is
    chosen if x or y has weights of its own, which must halve its squared error, and if heights
    depend on level distances: a few recordings would fit them by chance. Recordings are aligned in
    time with one of them first, then with the ways that the regression expects.

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
    vectors = [
        {s: _find_vectors(names, r.anchors, r.points[s][0]) for s in sides} for r in recordings
    ]

    order = np.argsort([len(table[sides[0]]) for table in tables], kind="stable")
    reference = int(order[(len(order) - 1) // 2])
    sized = [
        _weigh(t, np.mean(extents) / extent) for t, extent in zip(tables, extents, strict=True)
    ]
    frames = [align(sized[reference], course) for course in sized]
    for _ in range(_ALIGNMENTS):
        models = _fit_hands(vectors, {s: _sample(tables, s, frames) for s in sides})
        for k, table in enumerate(tables):
            heights = _lay_out_height(vectors[k])
            expected = {s: models[s].expect(vectors[k][s], heights) for s in sides}
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
        hands=_fit_hands(vectors, {s: sample[:, knots] for s, sample in samples.items()}),
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


def _fit_hands(
    vectors: Sequence[Mapping[str, np.ndarray]], samples: Mapping[str, np.ndarray]
) -> dict[str, HandModel]:
    """Fit hands to vectors (A, 3) of n recordings and aligned recordings (n, K, 6 + P) of each."""
    heights = np.stack([_lay_out_height(v) for v in vectors])[:, None]  # (n, 1, 2 A + H + 1)
    without_distances = heights.copy()
    anchors = len(next(iter(vectors[0].values())))
    without_distances[..., -1 - anchors : -1] = 0.0
    z = np.concatenate([sample[:, None, :, 2] for sample in samples.values()], axis=2)  # (n, 1, HK)
    few, all_heights = (_regress(d, z, constants=1) for d in (without_distances, heights))
    (fit_z,) = _choose([few], [all_heights], worth=1.0)
    shared, own = [], []  # of each hand: the fits of x and y
    for side, sample in samples.items():
        level = np.stack([_lay_out_level(v[side]) for v in vectors])  # (n, 2, A + 1)
        wanted = np.moveaxis(sample[..., :2], 2, 1)
        shared.append(_regress_both(level, wanted))
        own.append([_regress(level[:, [r]], wanted[:, [r]], constants=1) for r in range(2)])
    chosen = [
        _choose([fits[r] for fits in shared], [fits[r] for fits in own], worth=2.0)
        for r in range(2)
    ]
    models = {}
    for k, (side, sample) in enumerate(samples.items()):
        fits, count = [chosen[r][k] for r in range(2)], sample.shape[1]
        errors = [fit.left_out for fit in fits] + [fit_z.left_out[..., k * count : (k + 1) * count]]
        squares = (np.concatenate(errors, axis=1) ** 2).sum(axis=1).mean(axis=0)
        models[side] = HandModel(
            mean=sample[..., :3].mean(axis=0),
            level=np.stack([fit.weights for fit in fits]),
            height=fit_z.weights[:, k * count : (k + 1) * count],
            turns=sample[..., 3:6].mean(axis=0),
            poses=sample[..., 6:].mean(axis=0),
            leverage=np.stack([fit.inverse for fit in fits]),
            noise=np.sqrt(squares / (1 + np.mean([fit.share for fit in fits]))),
        )
    return models


class _Fit(NamedTuple):
    """Result of a regression."""

    weights: np.ndarray
    """Shape (F, K)."""
    inverse: np.ndarray
    """Of the normal matrix, shape (F, F)."""
    left_out: np.ndarray
    """Errors of recordings left out, shape (n, r, K)."""
    share: float
    """Mean leverage of a recording that is left out."""

    @property
    def score(self) -> float:
        """Logarithm of the squared errors of recordings left out."""
        return float(np.log((self.left_out**2).sum() + 1e-12))


def _choose(simple: Sequence[_Fit], rich: Sequence[_Fit], *, worth: float) -> Sequence[_Fit]:
    """Choose the rich fits of all hands if they divide the squared errors by `worth`."""
    gain = sum(fit.score for fit in simple) - sum(fit.score for fit in rich)
    return rich if gain > len(simple) * np.log(worth) else simple


def _regress_both(level: np.ndarray, wanted: np.ndarray) -> list[_Fit]:
    """Regress x and y, both (n, K) in (n, 2, K), with the same weights; return the fit of each."""
    vectors, none = level[..., :-1], np.zeros_like(level[:, :1, -1])
    ones = none + 1.0
    constants = np.stack([np.c_[ones, none], np.c_[none, ones]], axis=1)
    fit = _regress(np.concatenate([vectors, constants], axis=2), wanted, constants=2)
    anchors = np.arange(vectors.shape[2])
    fits = []
    for r in range(2):
        used = np.r_[anchors, len(anchors) + r]
        inverse = fit.inverse[np.ix_(used, used)]
        fits.append(_Fit(fit.weights[used], inverse, fit.left_out[:, [r]], fit.share))
    return fits


def _regress(design: np.ndarray, wanted: np.ndarray, *, constants: int) -> _Fit:
    """Regress with the penalty that predicts recordings best that are left out.

    Args:
        design: Rows of each recording, shape (n, r, F); the last columns are constants.
        wanted: Shape (n, r, K).
        constants: Number of these columns, which have no penalty.
    """
    free = np.arange(design.shape[2]) < design.shape[2] - constants

    def solve(x: np.ndarray, y: np.ndarray, penalty: float) -> tuple[np.ndarray, np.ndarray]:
        x, y = x.reshape(-1, x.shape[2]), y.reshape(-1, y.shape[2])
        inverse = np.linalg.inv(x.T @ x + np.diag(penalty * len(x) * free + 1e-9))
        return inverse @ x.T @ y, inverse

    fits = []
    for penalty in _PENALTIES:
        errors, shares = [], []
        for k in range(len(design)):
            rest = np.arange(len(design)) != k
            weights, inverse = solve(design[rest], wanted[rest], penalty)
            errors.append(wanted[k] - design[k] @ weights)
            shares.append(np.einsum("ri,ij,rj->r", design[k], inverse, design[k]).mean())
        whole = solve(design, wanted, penalty)
        fits.append(_Fit(*whole, np.stack(errors), float(np.mean(shares))))
    return min(fits, key=lambda fit: fit.score)


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
    """Lay out the rows of x and y, shape (2, A + 1)."""
    return np.concatenate([vectors[:, :2].T, np.ones((2, 1))], axis=1)


def _lay_out_height(vectors: Mapping[str, np.ndarray]) -> np.ndarray:
    """Lay out the row of z of all hands, shape (2 A + H + 1,), for vectors (A, 3) of each.

    Heights of the anchors above the hands' mean, those of the mean above the hands, mean level
    distances of the anchors from the hands, and a constant.
    """
    each = np.stack([vectors[side] for side in sorted(vectors)])  # (H, A, 3)
    mean = each[..., 2].mean(axis=0)
    distances = np.linalg.norm(each[..., :2], axis=2).mean(axis=0)
    return np.concatenate([mean, each[:, -1, 2] - mean[-1], distances, [1.0]])


def _measure_steps(ways: Mapping[str, np.ndarray]) -> np.ndarray:
    """Measure the distance that the faster hand covers between neighbouring knots [m], (K - 1,)."""
    return np.max([np.linalg.norm(np.diff(w, axis=0), axis=1) for w in ways.values()], axis=0)


def _interpolate(at: np.ndarray, times: np.ndarray, values: np.ndarray) -> np.ndarray:
    return np.stack([np.interp(at, times, column) for column in values.T], axis=1)
