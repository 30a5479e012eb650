"""Regression of scores on parameter values, with the effect of each start taken out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["LEAST_TRIALS", "Response", "fit_response"]

_PENALTY = 5.0
"""Of weights, for parameters in units of a tenth of their range."""
_START_PENALTY = 1e-2
_UNIT = 0.1
LEAST_TRIALS = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """Score as a sum of one quadratic function of each parameter."""

    reference: np.ndarray
    """Values from which gains are counted, as shares of the range, shape (P,)."""
    slopes: np.ndarray
    """Linear weights for a tenth of the range, at the reference, shape (P,)."""
    curvatures: np.ndarray
    """Quadratic weights, shape (P,)."""
    t_values: np.ndarray
    """Slopes of the linear fit as multiples of their standard errors, shape (P,)."""
    best: np.ndarray
    """Values of the highest score among those that were tried, as shares of the range, (P,)."""
    gains: np.ndarray
    """Expected gain of the score by each of them, shape (P,)."""

    def predict(self, values: np.ndarray) -> float:
        """Predict the gain of the score by values, as shares of the ranges, shape (P,)."""
        offsets = (values - self.reference) / _UNIT
        return float(self.slopes @ offsets + self.curvatures @ offsets**2)


def fit_response(
    values: np.ndarray, starts: Sequence[int], scores: np.ndarray, *, reference: np.ndarray
) -> Response:
    """Fit scores by ridge regression.

    Args:
        values: Parameters as shares of their ranges, shape (N, P).
        starts: Number of each trial's start; every start has an effect of its own, shape (N,).
        scores: Shape (N,).
        reference: Values from which gains are counted, shape (P,).

    Raises:
        ValueError: If there are fewer than 20 trials.
    """
    if len(scores) < LEAST_TRIALS:
        raise ValueError(f"a regression needs {LEAST_TRIALS} trials or more; got {len(scores)}")
    offsets = (np.asarray(values, dtype=float) - reference) / _UNIT
    different, row = np.unique(np.asarray(starts), return_inverse=True)
    effects = np.eye(len(different))[row]
    count = offsets.shape[1]
    linear, errors = _regress(effects, offsets, np.asarray(scores, dtype=float))
    weights, _ = _regress(effects, np.concatenate([offsets, offsets**2], axis=1), scores)
    best, gains = np.empty(count), np.empty(count)
    for k in range(count):
        low, high = np.quantile(offsets[:, k], [0.05, 0.95])
        grid = np.linspace(min(low, 0.0), max(high, 0.0), 201)
        curve = weights[k] * grid + weights[count + k] * grid**2
        best[k] = reference[k] + _UNIT * grid[curve.argmax()]
        gains[k] = curve.max()
    return Response(
        reference=np.asarray(reference, dtype=float),
        slopes=weights[:count],
        curvatures=weights[count:],
        t_values=linear / np.maximum(errors, 1e-12),
        best=best,
        gains=gains,
    )


def _regress(
    effects: np.ndarray, features: np.ndarray, scores: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fit weights of the features beside effects of the starts; give their standard errors."""
    design = np.concatenate([effects, features], axis=1)
    penalty = [_START_PENALTY] * effects.shape[1] + [_PENALTY] * features.shape[1]
    inverse = np.linalg.inv(design.T @ design + np.diag(penalty))
    weights = inverse @ design.T @ scores
    spread = float(np.std(scores - design @ weights))
    errors = spread * np.sqrt(np.diag(inverse))
    first = effects.shape[1]
    return weights[first:], errors[first:]
