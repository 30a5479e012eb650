"""Dense rewards for reinforcement learning: pure functions of the state after a step."""

from dataclasses import dataclass

import numpy as np

from dgl_tasks.success import Criterion, Verdict

REACH_SCALE = 0.5
"""Distance at which `reach` has fallen to a quarter [m]."""
CALM_SPEED = 0.05
"""RMS speed of the garment at which `rest` has fallen by a factor of e [m/s]."""
_LARGEST = 4.0


@dataclass(frozen=True, kw_only=True)
class RewardTerms:
    """Terms of the reward of a step, each in [0, 1]."""

    reach: float
    """Nearness of the hands to the garment; 1 once the rule is met, so that they may retreat."""
    progress: float
    """Mean share of the way from each criterion's value at the start to its threshold."""
    rest: float
    """Calmness of a garment that meets the rule and is released."""

    @property
    def dense(self) -> float:
        """The weighted sum, in [0, 4]; more than 3 only where the rule is met."""
        return self.reach + 2.0 * self.progress + self.rest

    @property
    def normalized(self) -> float:
        """The dense reward, scaled to [0, 1]."""
        return self.dense / _LARGEST


def compute_reward_terms(
    verdict: Verdict,
    *,
    start: Verdict,
    distances: np.ndarray,
    is_released: bool,
    speed: float,
) -> RewardTerms:
    """Compute the terms of the dense reward.

    Args:
        verdict: Present result of the task's rule.
        start: Its result before the robots touched the garment.
        distances: From each hand's grasp point to the nearest of the garment [m], shape (2,).
        is_released: No hand touches the garment.
        speed: RMS speed of the garment's particles [m/s].

    Raises:
        ValueError: If a number is negative or not finite.
    """
    distances = np.asarray(distances, dtype=float)
    values = [(c.value, s.value) for c, s in zip(verdict.criteria, start.criteria, strict=True)]
    numbers = np.array([*distances, speed, *np.ravel(values)])
    if not np.isfinite(numbers).all() or (distances < 0).any() or speed < 0:
        raise ValueError(
            "distances and speed must be finite and not negative, values finite; "
            f"got {distances}, {speed}, {values}"
        )
    progress = float(
        np.mean([_measure_progress(*p) for p in zip(verdict.criteria, start.criteria, strict=True)])
    )
    near = float(np.mean(1.0 - np.tanh(distances / REACH_SCALE)))
    is_met = verdict.success
    rest = float(np.exp(-speed / CALM_SPEED)) if is_met and is_released else 0.0
    return RewardTerms(reach=1.0 if is_met else near, progress=progress, rest=rest)


def _measure_progress(now: Criterion, start: Criterion) -> float:
    """Compute the share of the way from the value at the start to the threshold, in [0, 1]."""
    sign = 1.0 if now.comparison in (">", ">=") else -1.0
    way = max(sign * (now.threshold - start.value), 1e-6)
    return 1.0 if now.is_met else float(np.clip(sign * (now.value - start.value) / way, 0, 1))
