"""Time limits of Gymnasium in the form that ManiSkill's wrappers expect."""

from typing import Any

import gymnasium
import torch
from gymnasium.utils import RecordConstructorArgs


class BatchedTimeLimit(gymnasium.Wrapper, RecordConstructorArgs):
    """Gives `truncated` as a tensor, shape (1,), where Gymnasium's `TimeLimit` gives a bool.

    It wraps the environment of `gymnasium.make(..., max_episode_steps=...)`: ManiSkill's wrappers
    need tensors of both `terminated` and `truncated`.
    """

    def __init__(self, env: gymnasium.Env) -> None:
        """Wrap an environment of this package."""
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)

    def step(self, action: Any) -> tuple:
        """Make a step; see `GarmentEnv`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        truncated = torch.as_tensor(truncated, device=terminated.device).reshape(1)  # pyright: ignore[reportAttributeAccessIssue]
        return observation, reward, terminated, truncated, info
