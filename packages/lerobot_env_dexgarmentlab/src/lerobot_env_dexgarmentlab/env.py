"""One task as LeRobot steps it: NumPy, no batch, actions at 12 Hz from the parked arms on."""

from typing import Any

import gymnasium
import numpy as np

from dgl_collect.attempt import draw_garment
from dgl_collect.exporting.frames import Starter, express_joints, list_place_names, resize
from dgl_collect.exporting.writers import FPS
from dgl_collect.options import RunOptions
from dgl_collect.setup import Setup, make_setup
from dgl_tasks import TaskError, get_task
from dgl_tasks.driver import Driver
from dgl_tasks.handling import Handling
from dgl_tasks.policy import read_actions

__all__ = ["GarmentLeRobotEnv"]


class GarmentLeRobotEnv(gymnasium.Env):
    """A task for LeRobot.

    An observation has "agent_pos", the joints in the form of an action, "environment_state", places
    of points on the garment at the start and of objects [m], and "pixels", pictures by camera. The
    episode ends with success, or after its length: then hands retreat, the garment comes to rest,
    and the rule is applied, as in `dgl eval`. The reward is success.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": FPS}  # noqa: RUF012 - Gymnasium's
    render_mode = "rgb_array"

    def __init__(
        self,
        *,
        task: str,
        episode_length: int = 400,
        control_mode: str = "pd_joint_pos",
        cameras: tuple[str, ...] = ("environment_camera",),
        size: tuple[int, int] = (320, 240),
        garment_split: str = "test",
        matcher: str = "gam",
        look: str = "studio",
        start: str = "parked",
    ) -> None:
        """Prepare the environment; it is built at the first reset, in the process that uses it.

        Args:
            task: Environment id.
            episode_length: Most actions.
            control_mode: "pd_joint_pos" or "pd_hand_poses".
            cameras: Names of cameras.
            size: Width and height of the pictures [pixels].
            garment_split: "train" or "test".
            matcher: "gam" or "exact".
            look: "studio" or "random".
            start: "parked" or "grasped".
        """
        if start not in ("parked", "grasped"):
            raise ValueError(f"start must be parked or grasped; got {start!r}")
        self.task, self.task_description = task, get_task(task).description
        self._max_episode_steps = episode_length
        self._is_grasped = start == "grasped"
        self._cameras, self._size, self._split = tuple(cameras), tuple(size), garment_split
        self._options = RunOptions(
            control_mode=control_mode,  # pyright: ignore[reportArgumentType] - checked there
            matcher=matcher,  # pyright: ignore[reportArgumentType]
            look=look,  # pyright: ignore[reportArgumentType]
        )
        self._setup: Setup | None = None
        self._driver: Driver
        self._hands: Handling
        self._places: np.ndarray
        self._steps = 0
        numbers = len(self._express(np.zeros(60)))
        spaces: dict[str, gymnasium.Space] = {
            "agent_pos": gymnasium.spaces.Box(-np.inf, np.inf, (numbers,), np.float32)
        }
        if places := len(list_place_names(get_task(task))):
            spaces["environment_state"] = gymnasium.spaces.Box(-np.inf, np.inf, (places,))
        if self._cameras:
            picture = gymnasium.spaces.Box(0, 255, (size[1], size[0], 3), np.uint8)
            spaces["pixels"] = gymnasium.spaces.Dict(dict.fromkeys(self._cameras, picture))
        self.observation_space = gymnasium.spaces.Dict(spaces)
        self.action_space = gymnasium.spaces.Box(-2 * np.pi, 2 * np.pi, (numbers,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple:
        """Begin an episode with parked arms, or with hands at the grasp points.

        Args:
            seed: Of all draws.
            options: "garment", an id of the catalogue, by default drawn from the split; LeRobot's
                own are ignored.
        """
        super().reset(seed=seed)
        if self._setup is None:
            self._setup = make_setup(self.task, self._options)
        if seed is None:
            seed = int(self.np_random.integers(2**31))
        garment = (options or {}).get("garment") or draw_garment(
            self._setup.env.task,
            self._split,  # pyright: ignore[reportArgumentType] - checked there
            seed,
        )
        starter = Starter(self._setup)
        self._driver = Driver(self._setup.env, seed=seed)
        self._hands = starter.begin(self._driver, garment)
        _, self._places = starter.find_places(self._driver)
        if self._is_grasped:
            starter.approach(self._driver, self._hands)
        self._steps = 0
        return self._observe(), {"is_success": False}

    def step(self, action: np.ndarray) -> tuple:
        """Carry out an action within five control steps."""
        assert self._setup is not None
        actions = np.asarray(action, dtype=np.float64)[None]
        robot, mode = self._setup.motion.robot, self._options.control_mode
        self._driver.drive(self._hands.execute(read_actions(actions, robot, mode)))
        self._steps += 1
        is_over = self._steps >= self._max_episode_steps
        verdict = self._setup.env.judge()
        if is_over and not verdict.success:
            self._end()
            verdict = self._setup.env.judge()
        told = {"is_success": verdict.success, "success_value": float(verdict.value)}
        return self._observe(), float(verdict.success), verdict.success, is_over, told

    def _end(self) -> None:
        """Let hands retreat, and the garment come to rest."""
        try:
            self._driver.drive(self._hands.retreat())
            self._driver.drive(self._hands.settle())
        except TaskError:
            pass  # hands that cannot leave are no success

    def render(self) -> np.ndarray:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Draw a picture for people, shape (H, W, 3), uint8."""
        assert self._setup is not None
        return self._setup.env.film()

    def close(self) -> None:
        """Release the simulation."""
        if self._setup is not None:
            self._setup.env.close()
            self._setup = None

    def _express(self, joints: np.ndarray) -> np.ndarray:
        from dgl_assets.robots import DEFAULT_ROBOT

        robot = DEFAULT_ROBOT if self._setup is None else self._setup.motion.robot
        return express_joints(joints, robot, self._options.control_mode)

    def _observe(self) -> dict[str, Any]:
        sensed = self._driver.sense(*self._cameras)
        seen: dict[str, Any] = {"agent_pos": self._express(sensed.joint_state)}
        if len(self._places):
            seen["environment_state"] = self._places
        if self._cameras:
            seen["pixels"] = {
                name: resize(sensed.pictures[name].rgb, self._size) for name in self._cameras
            }
        return seen
