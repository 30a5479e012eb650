"""Configuration of the environments, as LeRobot's command line reads it."""

from dataclasses import dataclass, field
from functools import partial

import gymnasium
from gymnasium.envs.registration import register
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_ENV_STATE, OBS_IMAGES, OBS_STATE

from dgl_assets.robots import DEFAULT_ROBOT
from dgl_collect.exporting.frames import list_place_names
from dgl_collect.exporting.writers import FPS
from dgl_tasks import get_task, task_ids
from dgl_tasks.hand_span import HandPoseActions

__all__ = ["DexGarmentLabEnv"]

PACKAGE = "gym_dexgarmentlab"


@EnvConfig.register_subclass("dexgarmentlab")
@dataclass
class DexGarmentLabEnv(EnvConfig):
    """Environment of one task, from the parked arms to the verdict."""

    task: str | None = "FoldTops-v1"
    """Environment id of dexgarmentlab."""
    fps: int = FPS
    episode_length: int = 400
    """Most actions; then hands retreat, the garment comes to rest, and the rule is applied."""
    control_mode: str = "pd_joint_pos"
    """Actions: `pd_joint_pos`, 60 joint targets, or `pd_hand_poses`, 22 numbers."""
    cameras: str = "environment_camera"
    """Names of cameras, separated by commas; empty for none."""
    width: int = 320
    """Of the pictures [pixels]."""
    height: int = 240
    """Of the pictures [pixels]."""
    garment_split: str = "test"
    """Split that garments are drawn from, `train` or `test`."""
    matcher: str = "gam"
    """Finds the places in the environment state: `gam` in clouds, or `exact`."""
    look: str = "studio"
    """`studio`, or `random` floors and fabrics."""
    start: str = "parked"
    """`parked` arms, or `grasped`: hands at the matched grasp points of the first stage."""
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        numbers = DEFAULT_ROBOT.dof
        if self.control_mode == "pd_hand_poses":
            numbers = len(HandPoseActions(DEFAULT_ROBOT).names)
        places = len(list_place_names(get_task(str(self.task))))
        self.features = {
            ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(numbers,)),
            "agent_pos": PolicyFeature(type=FeatureType.STATE, shape=(numbers,)),
        }
        self.features_map = {ACTION: ACTION, "agent_pos": OBS_STATE}
        if places:
            self.features["environment_state"] = PolicyFeature(
                type=FeatureType.ENV, shape=(places,)
            )
            self.features_map["environment_state"] = OBS_ENV_STATE
        for camera in self.camera_names:
            shape = (self.height, self.width, 3)
            key = f"pixels/{camera}"
            self.features[key] = PolicyFeature(type=FeatureType.VISUAL, shape=shape)
            self.features_map[key] = f"{OBS_IMAGES}.{camera}"

    @property
    def camera_names(self) -> tuple[str, ...]:
        """Names of the cameras."""
        return tuple(name.strip() for name in self.cameras.split(",") if name.strip())

    @property
    def package_name(self) -> str:
        """Package that registers the environments."""
        return __name__.partition(".")[0]

    @property
    def gym_id(self) -> str:
        """Id of the environment."""
        return f"{PACKAGE}/{self.task}"

    @property
    def gym_kwargs(self) -> dict:
        """Settings of the environment."""
        return {
            "episode_length": self.episode_length,
            "control_mode": self.control_mode,
            "cameras": self.camera_names,
            "size": (self.width, self.height),
            "garment_split": self.garment_split,
            "matcher": self.matcher,
            "look": self.look,
            "start": self.start,
        }

    def create_envs(
        self,
        n_envs: int,
        use_async_envs: bool = False,  # noqa: FBT001, FBT002 - LeRobot's signature
    ) -> dict[str, dict[int, gymnasium.vector.VectorEnv]]:
        """Make the environments, which LeRobot from 0.5 on asks the configuration for."""
        name = f"{self.package_name}:{self.gym_id}"  # a worker imports the package
        make = partial(gymnasium.make, name, disable_env_checker=True, **self.gym_kwargs)
        mode = gymnasium.vector.AutoresetMode.SAME_STEP  # else LeRobot sees no success
        if use_async_envs and n_envs > 1:
            vector = gymnasium.vector.AsyncVectorEnv(
                [make] * n_envs, autoreset_mode=mode, context="forkserver"
            )
        else:
            vector = gymnasium.vector.SyncVectorEnv([make] * n_envs, autoreset_mode=mode)
        return {"dexgarmentlab": {0: vector}}


for _task in task_ids():
    register(
        f"{PACKAGE}/{_task}",
        entry_point="lerobot_env_dexgarmentlab.env:GarmentLeRobotEnv",
        kwargs={"task": _task},
    )
