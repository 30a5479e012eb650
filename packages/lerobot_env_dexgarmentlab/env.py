"""The tasks for LeRobot's EnvHub.

Put this file into a repository of the Hugging Face Hub, and LeRobot loads it by the repository's
name, once `lerobot_env_dexgarmentlab` is installed:

    from lerobot.envs.factory import make_env

    make_env("user/repository", n_envs=2, trust_remote_code=True)
"""

from gymnasium.vector import VectorEnv

from lerobot_env_dexgarmentlab import DexGarmentLabEnv

DEFAULT = DexGarmentLabEnv()
"""Change it for another task, action space, cameras, or garments."""


def make_env(
    n_envs: int = 1,
    use_async_envs: bool = False,  # noqa: FBT001, FBT002 - LeRobot's signature
    cfg: object | None = None,
) -> dict[str, dict[int, VectorEnv]]:
    """Make the environments of a configuration of ours, or else of `DEFAULT`."""
    config = cfg if isinstance(cfg, DexGarmentLabEnv) else DEFAULT
    return config.create_envs(n_envs, use_async_envs=use_async_envs)
