"""Train SAC of Stable-Baselines3 on a task, from its state.

    pip install dgl-tasks stable-baselines3
    python stable_baselines.py --task HangTops-v1 --steps 20000

A few thousand steps show that it runs; they do not hang a garment.
"""

import argparse

import gymnasium
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from stable_baselines3 import SAC

import dgl_tasks  # noqa: F401 - registers the environments


def make_env(task: str, *, steps: int) -> gymnasium.Env:
    """Make an environment of arrays without a batch, which ends after some steps of 1/12 s."""
    env = gymnasium.make(
        task,
        obs_mode="state",
        control_mode="pd_hand_poses",  # 22 numbers instead of 60
        reward_mode="normalized_dense",
        render_backend="none",
        max_episode_steps=steps,
    )
    return CPUGymWrapper(env)


def main() -> None:
    """Train, and save the policy as sac.zip."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--task", default="HangTops-v1")
    parser.add_argument("--steps", type=int, default=20_000)
    parser.add_argument("--episode", type=int, default=200)
    parser.add_argument("--out", default="sac.zip")
    options = parser.parse_args()
    env = make_env(options.task, steps=options.episode)
    agent = SAC("MlpPolicy", env, seed=0, learning_starts=min(100, options.steps // 2), verbose=1)
    agent.learn(options.steps, log_interval=1)
    agent.save(options.out)
    env.close()


if __name__ == "__main__":
    main()
