"""Dense rewards: pure functions of what is known after a step, for reinforcement learning."""

from dataclasses import dataclass

import numpy as np

from dgl_tasks.success import Verdict

REACH_SCALE = 0.5
"""Distance at which `reach` has fallen to a quarter [m]."""
CALM_SPEED = 0.05
"""RMS speed of the garment at which `rest` has fallen by a factor of e [m/s]."""
_LARGEST = 4.0


@dataclass(frozen=True, kw_only=True)
class RewardTerms:
    """What a step is worth, in parts that each lie in [0, 1]."""

    reach: float
    """How near the hands are to the garment; 1 once the rule is met, so that they may leave."""
    progress: float
    """How far the rule's value has come from where it was at the start towards its threshold."""
    rest: float
    """Of a garment for which the rule is met: whether the hands have let go of it, and how calm it lies."""

    @property
    def dense(self) -> float:
        """The weighted sum, in [0, 4]; more than 3 only where the rule is met."""
        return self.reach + 2.0 * self.progress + self.rest

    @property
    def normalized(self) -> float:
        """The same in [0, 1]."""
        return self.dense / _LARGEST


def compute_reward_terms(
    verdict: Verdict,
    *,
    start: float,
    distances: np.ndarray,
    is_released: bool,
    speed: float,
) -> RewardTerms:
    """Compute the terms of the dense reward.

    Args:
        verdict: What the task's rule says now.
        start: The rule's value before the robots touched the garment.
        distances: From each hand's grasp point to the nearest of the garment [m], shape (2,).
        is_released: Whether no hand touches the garment.
        speed: RMS speed of the garment's particles [m/s].

    Raises:
        ValueError: If a number is negative or not finite.
    """
    distances = np.asarray(distances, dtype=float)
    main = verdict.criteria[0]
    numbers = np.array([*distances, speed, main.value, start])
    if not np.isfinite(numbers).all() or (distances < 0).any() or speed < 0:
        raise ValueError(
            "distances and speed must be finite and not negative, values finite; "
            f"got {distances}, {speed}, {main.value}, {start}"
        )
    sign = 1.0 if main.comparison in (">", ">=") else -1.0
    way = max(sign * (main.threshold - start), 1e-6)
    progress = 1.0 if main.is_met else float(np.clip(sign * (main.value - start) / way, 0, 1))
    near = float(np.mean(1.0 - np.tanh(distances / REACH_SCALE)))
    is_met = verdict.success
    rest = float(np.exp(-speed / CALM_SPEED)) if is_met and is_released else 0.0
    return RewardTerms(reach=1.0 if is_met else near, progress=progress, rest=rest)
