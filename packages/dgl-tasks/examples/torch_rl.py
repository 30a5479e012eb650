"""Collect random steps of a task as TensorDicts, with TorchRL.

pip install dgl-tasks torchrl
python torch_rl.py --task HangTops-v1 --steps 100
"""

import argparse

import gymnasium
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from torchrl.envs import GymWrapper

import dgl_tasks  # noqa: F401 - registers the environments


class Single(gymnasium.Wrapper):
    """Hides the batch of ManiSkill's environment, which TorchRL looks for in `unwrapped`."""

    @property
    def unwrapped(self) -> gymnasium.Env:
        """This wrapper."""
        return self


def make_env(task: str) -> GymWrapper:
    """Make an environment whose steps are TensorDicts."""
    env = gymnasium.make(
        task, obs_mode="state", control_mode="pd_hand_poses", render_backend="none"
    )
    return GymWrapper(Single(CPUGymWrapper(env)), device="cpu")


def main() -> None:
    """Print what a rollout holds."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", default="HangTops-v1")
    parser.add_argument("--steps", type=int, default=100)
    options = parser.parse_args()
    env = make_env(options.task)
    env.set_seed(0)
    print(env.rollout(max_steps=options.steps))
    env.close()


if __name__ == "__main__":
    main()
