"""The garment environment: a declaration as a ManiSkill environment."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
import sapien
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.spaces import Box
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.structs.types import SimConfig

from dgl_assets.garments.catalogue import Split
from dgl_assets.importing import AnyGarment
from dgl_assets.materials import FabricMaterial, sample_fabric_material
from dgl_assets.robots import DEFAULT_ROBOT, SIDES, Robot, Side
from dgl_assets.robots.importing import load_robot
from dgl_files.fields import check_value, show
from dgl_physics import SolverConfig
from dgl_physics.drawing.mesh import Mesh
from dgl_physics.drawing.rasteriser import Picture, Rasteriser
from dgl_physics.sapien_bridge import SapienCloth, find_colliders
from dgl_tasks.appearance import Appearance
from dgl_tasks.cameras import WRIST_CAMERAS, build_wrist_camera, place_wrist_camera
from dgl_tasks.control import interpolate_action
from dgl_tasks.coverage import sample_visible_surface
from dgl_tasks.declaration import Task
from dgl_tasks.env_state import read_cloth, read_state, split_state, write_cloth
from dgl_tasks.errors import EnvironmentClosedError, RenderingUnavailableError
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.inputs import (
    ActionBounds,
    ControlMode,
    check_cameras,
    check_reset_options,
    check_settings,
    read_action,
    read_seed,
)
from dgl_tasks.objects import PlacedObject, measure_touch
from dgl_tasks.observation import CONTROL_FREQUENCY, STEPS_PER_ACTION
from dgl_tasks.perception import CloudKind, Segments, get_environment_cloud, get_garment_cloud
from dgl_tasks.rendering import explain_rendering
from dgl_tasks.reward import RewardTerms, compute_reward_terms
from dgl_tasks.rim_grip import RimGrip
from dgl_tasks.robot import BimanualUR10eShadow, let_robot_pass, make_agent_class
from dgl_tasks.scene_check import check_scene
from dgl_tasks.sensing import SENSOR_CAMERAS
from dgl_tasks.soft_body import add_soft_body
from dgl_tasks.studio import (
    build_floor,
    light_scene,
    sample_floor_look,
    sample_studio_fabric,
)
from dgl_tasks.success import Criterion, Verdict, compute_covered_area, get_frame
from dgl_tasks.task_garment import find_task_garment, list_task_garments, name_garment
from dgl_tasks.tasks import load_task, task_ids
from dgl_tasks.views import TrueView

LookName = Literal["studio", "random"]
"""Looks: a plain floor with fabrics that stand out, or any floor and fabric."""

STEEPER = float(np.radians(5))
"""Increase of the slope of a garment that has fallen too flat [rad]."""
STILL_SPEED = 0.05
"""RMS speed of the particles below which a garment counts as at rest [m/s]."""


class GarmentEnv(BaseEnv):
    """One garment, two arms with dexterous hands, and the task's cameras and success rule.

    Make it with `gymnasium.make("FoldTops-v1", ...)` after `import dgl_tasks`. The option "garment"
    of `reset` is a catalogue id, the folder of an imported garment, or a garment of `dgl_assets`;
    by default a garment is drawn from the training split. All draws depend on the seed alone.

    With `obs_mode="pointcloud"` an observation also has "garment_cloud", shape (1, 2048, 3), and
    "workspace_cloud", shape (1, 2048, 6). Rewards are those of `dgl_tasks.reward`.

    An action of `step` is clipped to the action space, which is logged once. It takes five control
    steps of 1/60 s: joint targets (`pd_joint_pos`, and `pd_hand_poses` with fewer numbers) are
    reached in a straight line within them, those of `pd_ee_pose` hold from the first on. `judge`
    and `evaluate` use the particles.

    Limitations: one environment, PhysX on the CPU; run several processes for more. Reset it before
    anything else: until then the garment hangs in the air.
    """

    agent: BimanualUR10eShadow  # pyright: ignore[reportIncompatibleVariableOverride] - ours alone
    _spec: EnvSpec | None = None
    _is_built = False

    def __init__(
        self,
        *args: Any,
        task: str | Task,
        robot: Robot | str = DEFAULT_ROBOT,
        robots: str | Path | None = None,
        num_envs: int = 1,
        garment_split: Split = "train",
        look: LookName = "studio",
        cloud: CloudKind = "segmented",
        cameras: Sequence[str] = SENSOR_CAMERAS,
        **kwargs: Any,
    ) -> None:
        """Build the environment.

        Args:
            args: ManiSkill's.
            task: Environment id, a declaration, or a file or module of one; see `load_task`.
            robot: Arms and hands, or their name, such as "ur10e+allegro".
            robots: Folder of imported robots, for names that are not built in.
            num_envs: One.
            garment_split: Garments to draw from, "train" or "test".
            look: "studio" draws a fabric that stands out from the studio's plain floor; "random"
                draws floor, mat and fabric among all. Only pictures depend on the look.
            cloud: Content of environment clouds: garment and objects, or the whole scene.
            cameras: Cameras whose pictures ManiSkill's observations have: those of the task and
                `WRIST_CAMERAS`.
            kwargs: ManiSkill's, except for `robot_uids`. `reconfiguration_freq` is 1 by default:
                every episode begins in a new scene, so that it can be repeated exactly.
        """
        if num_envs != 1:
            raise ValueError(
                f"num_envs must be 1 (one process an environment) in this version; got {num_envs}"
            )
        check_value("look", look, LookName)
        check_value("cloud", cloud, CloudKind)
        check_settings(kwargs)
        has_renderer = kwargs.get("render_backend", "gpu") not in ("none", None)
        if kwargs.get("render_mode") == "human" and not has_renderer:
            raise RenderingUnavailableError(
                'render_mode "human" needs a renderer: give render_backend="cpu" or "gpu"; '
                'got "none"'
            )
        if "robot_uids" in kwargs:
            raise ValueError('robot="ARM+HAND" names arms and hands here; got robot_uids')
        if isinstance(robot, str):
            robot = load_robot(robot, robots)
        if not isinstance(robot, Robot):
            raise ValueError(
                f'robot must be a name, such as "ur10e+shadow", or a `Robot`; got {show(robot)}'
            )
        self._task: Task = task if isinstance(task, Task) else load_task(task)
        check_scene(self._task)
        check_cameras(cameras, self._task)
        self._cameras = tuple(cameras)
        self._look: LookName = look
        self.cloud: CloudKind = cloud
        self._garment_ids = list_task_garments(self.task, garment_split)
        self._appearance: Appearance
        self._start_view: TrueView
        self._start_verdict: Verdict
        self._target: np.ndarray
        self.cloth: SapienCloth
        self.garment: AnyGarment
        self.fabric: FabricMaterial
        self._rim_grip: RimGrip | None = None
        self.objects: dict[str, PlacedObject] = {}
        self.draws: dict[str, float | str] = {}
        self._bounds: dict[str, ActionBounds] = {}
        agent: Any = make_agent_class(
            robot=robot, left_base=self.task.left_base, right_base=self.task.right_base
        )
        kwargs.setdefault("reward_mode", "sparse")
        # PhysX's order of contacts depends on the scene's past: in a used scene, arms that touch
        # would move differently from the same seed and commands.
        kwargs.setdefault("reconfiguration_freq", 1)
        with explain_rendering():
            super().__init__(*args, robot_uids=agent, num_envs=num_envs, **kwargs)
        self._is_built = True

    # Gymnasium sets a plain attribute, which pyright does not take for a property.
    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's specification, with an id that names this package.

        ManiSkill writes it into recordings; `gymnasium.make` imports the part before the colon.
        """
        return self._spec

    @spec.setter
    def spec(self, made: EnvSpec | None) -> None:  # pyright: ignore[reportIncompatibleVariableOverride]
        package = __name__.partition(".")[0]
        if made is not None and made.id in task_ids():
            made = replace(made, id=f"{package}:{made.id}")
        self._spec = made

    @property
    def task(self) -> Task:
        """The declaration."""
        return self._task

    def reset(self, seed: Any = None, options: dict | None = None) -> Any:
        """Begin an episode; the class lists the options, ManiSkill its own.

        Args:
            seed: Integer in [0, 2^32), or a list of one; drawn when None.
            options: By name.

        Raises:
            ValueError: If the seed or an option is of another form, or an option is unknown.
            EnvironmentClosedError: After `close`.
        """
        self._check_open("reset")
        check_reset_options(options)
        with explain_rendering():
            return super().reset(seed=read_seed(seed), options=options)

    def _check_open(self, verb: str) -> None:
        if self._is_built and self.scene is None:
            raise EnvironmentClosedError(
                f"{verb} needs an open environment; this one was closed, make another"
            )

    # Scene ---------------------------------------------------------------------------------

    @property
    def _default_sim_config(self) -> SimConfig:
        return SimConfig(
            sim_freq=4 * CONTROL_FREQUENCY, control_freq=CONTROL_FREQUENCY // STEPS_PER_ACTION
        )

    @property
    def _default_sensor_configs(self) -> list:
        links = self.agent.robot.links_map
        return [
            build_wrist_camera(name, self.agent.model, links[f"{WRIST_CAMERAS[name]}_ee"])
            if name in WRIST_CAMERAS
            else self.task.cameras[name].build()
            for name in self._cameras
        ]

    @property
    def _default_human_render_camera_configs(self) -> list:
        return [self.task.cameras["video_camera"].build()]

    def _load_scene(self, options: dict) -> None:
        self.ground = build_floor(self.scene)
        let_robot_pass(self.ground)
        start = self.task.start
        rng = np.random.default_rng([int(self._episode_seed[0]), 9])
        self.objects = {
            item.name: PlacedObject(self.scene, item, rng) for item in self.task.objects
        }
        self._appearance = Appearance(
            self.scene,
            self.ground,
            mat_centre=(float(np.mean(start.x_range)), float(np.mean(start.y_range))),
            pedestals=[base[:3] for base in (self.task.left_base, self.task.right_base)],
        )

    def _load_lighting(self, options: dict) -> None:
        light_scene(self.scene)

    def _initialize_episode(self, env_idx: torch.Tensor, options: dict) -> None:
        seed = int(self._episode_seed[0])
        rng = np.random.default_rng(seed)
        # All draws are made whatever the options, so that an option changes only what it names.
        drawn = self._garment_ids[rng.integers(len(self._garment_ids))]
        declared = self.task.start
        x, y = rng.uniform(*declared.x_range), rng.uniform(*declared.y_range)
        garment = find_task_garment(options.get("garment", drawn), self.task)
        roll = rng.uniform(*declared.roll_range)
        sample_fabric = sample_studio_fabric if self._look == "studio" else sample_fabric_material
        self.fabric = sample_fabric([seed, 7])
        self.draws = {
            "garment": name_garment(options.get("garment", drawn)),
            "x": float(x),
            "y": float(y),
            "roll": float(roll),
            "fabric": self.fabric.name,
        }
        for item in self.objects.values():
            self.draws |= item.draw(rng)
        if self._look == "random":
            look = sample_floor_look([seed, 8])
            self.draws["floor"] = look.material.name if look.material is not None else "studio"
            self._appearance.lay_floor(look)
        start = self.agent.model.compute_start("open")
        self.agent.set_joint_state(start)
        self.agent.set_action(torch.as_tensor(self.agent.make_action(start))[None])
        self._target = np.asarray(start, dtype=np.float64)
        limit, steepest = declared.value_below, np.pi / 2
        self._drop(garment, float(x), float(y), float(roll))
        while (
            self._is_built
            and limit is not None
            and self._start_verdict.value >= limit
            and roll < steepest
        ):
            roll = min(roll + STEEPER, steepest)
            self._drop(garment, float(x), float(y), float(roll))
        self.draws["roll"] = float(roll)

    def _drop(self, garment: AnyGarment, x: float, y: float, roll: float) -> None:
        """Let the garment fall and settle, and keep the state before it is touched.

        It stays in the air in ManiSkill's first reset, which only shows the observations' shapes.
        """
        self._load_garment(garment, x, y, roll)
        for _ in range(self.task.start.settle_frames if self._is_built else 0):
            self.cloth.step()
        particles = self.get_particles()
        places = {name: garment.landmarks[name] for name in self.task.success.landmarks}
        flat = sample_visible_surface(garment.vertices, garment.faces)
        self._start_view = TrueView(
            particles=particles,
            faces=garment.faces,
            upright=garment.vertices,
            landmarks={name: particles[place] for name, place in places.items()},
            marks={name: garment.landmarks[name] for name in self.task.success.marks},
            flat_area=compute_covered_area(flat),
            frames=self.get_frames(),
        )
        self._start_verdict = self.apply_rule()

    def _load_garment(self, garment: AnyGarment, x: float, y: float, roll: float) -> None:
        self.garment, task, start = garment, self.task, self.task.start
        c, s = np.cos(start.yaw), np.sin(start.yaw)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        c, s = np.cos(roll), np.sin(roll)
        tilt = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        vertices = self.garment.vertices @ (turn @ tilt).T
        heights = vertices[:, 2]
        level = heights.min() if start.level is None else heights[garment.landmarks[start.level]]
        vertices += [x, y, start.height - level]
        if start.on is not None:
            vertices += get_frame(self.get_frames(), start.on)
        scene = self.scene.sub_scenes[0]
        self.cloth = SapienCloth(
            [scene],
            colliders=[find_colliders(scene)],
            friction=self._get_friction,
            config=SolverConfig(dt=1.0 / CONTROL_FREQUENCY),
        )
        add_soft_body(self.cloth, garment, vertices, task.material, task.stiffness, task.shrinkage)
        self.cloth.build()
        sides = [self.agent.hand_links.get(body.entity.name) for body in self.cloth.bodies[0]]
        # rows of the hands' links among the forces, which are read at every control step
        self._hand_rows: dict[Side, list[int]] = {
            side: [k for k, its in enumerate(sides) if its == side] for side in SIDES
        }
        reach = self.task.rim_grip
        self._rim_grip = None
        if reach is not None:
            self._rim_grip = RimGrip(garment.faces, reach, self.agent.model)
        self._appearance.dress(garment, fabric=self.fabric, bodies=self.cloth.bodies[0])

    def _get_friction(self, component: sapien.physx.PhysxRigidBaseComponent) -> float | None:
        if isinstance(component, sapien.physx.PhysxArticulationLinkComponent):
            friction, thumb = self.task.hand_friction, self.agent.model.hand.thumb_links
            is_thumb = any(component.name.endswith(f"_{side}_{n}") for side in SIDES for n in thumb)
            return friction.thumb if is_thumb and friction.thumb is not None else friction.fingers
        objects = {item.entity.name: item.declared.friction for item in self.objects.values()}
        return objects.get(component.entity.name, self.task.ground_friction)

    # Stepping ------------------------------------------------------------------------------

    def _step_action(self, action: Any) -> torch.Tensor | None:
        """Make the control steps of one action; see the class."""
        self._check_open("step")
        if action is None:
            for _ in range(STEPS_PER_ACTION):
                self.advance(None)
            return None
        if isinstance(action, dict):
            if set(action) != {"control_mode", "action"}:
                raise ValueError(
                    'action must be numbers, or a dict of "control_mode" and "action"; '
                    f"got {show(action)}"
                )
            mode = action["control_mode"]
            check_value("control_mode", mode, ControlMode)
            if mode != self.agent.control_mode:
                self.agent.set_control_mode(mode)
                self.agent.controller.reset()
                self._target = self.agent.read_joints().astype(np.float64)
            action = action["action"]
        action = self._clip(self._read_action(action))
        if self.agent.control_mode == "pd_ee_pose":
            for _ in range(STEPS_PER_ACTION):
                self.advance(action)
        else:
            start = self.agent.make_action(self._target)
            for row in interpolate_action(start, action[0].numpy().astype(np.float32)):
                self.advance(row.astype(np.float32))
        return action

    def _clip(self, action: torch.Tensor) -> torch.Tensor:
        mode, space = self.agent.control_mode, self.agent.single_action_space
        if mode not in self._bounds:
            assert isinstance(space, Box)
            self._bounds[mode] = ActionBounds(space.low, space.high)
        return torch.from_numpy(self._bounds[mode].clip(action.numpy()))

    def _read_action(self, action: Any) -> torch.Tensor:
        shape = self.agent.single_action_space.shape
        assert shape is not None
        return read_action(action, shape)

    def advance(self, action: np.ndarray | torch.Tensor | None) -> None:
        """Make one control step of 1/60 s without observation, reward and evaluation.

        Args:
            action: Of the control mode, such as joint targets [rad], shape (D,) or (1, D), which
                hold from now on; None keeps the present ones. It is not clipped.

        Raises:
            ValueError: If the action is of another shape, or not finite.
            EnvironmentClosedError: After `close`.
        """
        self._check_open("advance")
        if action is not None:
            action = self._read_action(action)
            self.agent.set_action(action)
            if self.agent.control_mode != "pd_ee_pose":
                self._target = self.agent.read_targets(action[0].numpy().astype(np.float64))
        for _ in range(self._sim_steps_per_control // STEPS_PER_ACTION):
            self.agent.before_simulation_step()
            self.cloth.apply_forces()
            self.scene.step()
        if self._rim_grip is not None:
            self._rim_grip.update(self.cloth, self.agent.read_hands(), self._target)
        self.cloth.step()
        self._appearance.mark_moved()

    def get_particles(self) -> np.ndarray:
        """Positions of the garment's vertices [m], shape (V, 3), world frame."""
        return self.cloth.state.get_positions()[0][: len(self.garment.vertices)]

    @property
    def view(self) -> TrueView:
        """Ground-truth view of the scene."""
        return replace(self._start_view, particles=self.get_particles(), frames=self.get_frames())

    def get_frames(self) -> dict[str, dict[str, np.ndarray]]:
        """Present frames of the objects, by object and name [m], shape (3,), world frame."""
        return {name: item.get_frames() for name, item in self.objects.items()}

    def apply_rule(self) -> Verdict:
        """Apply the task's rule to the ground truth."""
        # Pyright takes no cached property for a property of a protocol.
        return self.task.success(self.view)  # pyright: ignore[reportArgumentType]

    def judge(self) -> Verdict:
        """Judge the garment: the task's rule, that no hand touches it, and that it is at rest."""
        rule = self.apply_rule()
        released = Criterion(
            name="links of the robot that touch the garment",
            value=float(self.count_touching()),
            comparison="<=",
            threshold=0.0,
            failure="not released",
        )
        still = Criterion(
            name="speed of the garment",
            value=self.measure_speed(),
            comparison="<",
            threshold=STILL_SPEED,
            unit=" m/s",
            failure="still moving",
        )
        return Verdict(criteria=(*rule.criteria, released, still), box=rule.box)

    def evaluate(self) -> dict:
        """Judge the garment; "criteria" has the measured value of each criterion."""
        verdict = self.judge()
        *_, released, still = verdict.criteria
        told = {
            "success": verdict.success,
            "success_value": verdict.value,
            "is_released": released.is_met,
            "is_still": still.is_met,
        }
        content: dict = {name: torch.tensor([value]) for name, value in told.items()}
        content["criteria"] = {c.name: torch.tensor([c.value]) for c in verdict.criteria}
        return content

    def measure_touch(self) -> dict[str, float]:
        """Measure the robot's force on each object that it is to avoid [N], by object."""
        return measure_touch(self.scene.sub_scenes[0], self.objects.values())

    def measure_speed(self) -> float:
        """Measure the RMS speed of the garment's particles [m/s]."""
        velocities = self.cloth.state.get_velocities()[0]
        return float(np.sqrt((velocities**2).sum(axis=1).mean()))

    def compute_reward_terms(self) -> RewardTerms:
        """Compute the terms of the dense reward, `dgl_tasks.reward`."""
        particles = self.get_particles()
        distances = []
        for side, pose in zip(SIDES, self.agent.read_hands(), strict=True):
            point = wrist_to_grasp(pose[:3], pose[3:], side, robot=self.agent.model)
            distances.append(np.linalg.norm(particles - point, axis=1).min())
        return compute_reward_terms(
            self.apply_rule(),
            start=self._start_verdict,
            distances=np.array(distances),
            is_released=self.count_touching() == 0,
            speed=self.measure_speed(),
        )

    def compute_sparse_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        """Reward of 1 where the task is done, else 0, shape (1,)."""
        return info["success"].float()

    def compute_dense_reward(self, obs: Any, action: torch.Tensor, info: dict) -> torch.Tensor:
        """Reward in [0, 4], shape (1,)."""
        return torch.tensor([self.compute_reward_terms().dense])

    def compute_normalized_dense_reward(
        self, obs: Any, action: torch.Tensor, info: dict
    ) -> torch.Tensor:
        """Reward in [0, 1], shape (1,)."""
        return torch.tensor([self.compute_reward_terms().normalized])

    def measure_pulls(self) -> dict[Side, np.ndarray]:
        """Measure the force of the garment on each hand [N], shape (3,), world frame."""
        forces = self.cloth.get_forces()[0, :, :3].astype(np.float64)
        return {side: forces[rows].sum(axis=0) for side, rows in self._hand_rows.items()}

    def count_touching(self) -> int:
        """Count the links of the robot that touch the garment."""
        forces = self.cloth.get_forces()[0]
        return sum(
            isinstance(body, sapien.physx.PhysxArticulationLinkComponent)
            and bool(np.abs(force[:3]).max() > 0)
            for body, force in zip(self.cloth.bodies[0], forces, strict=True)
        )

    def _get_obs_agent(self) -> dict:
        return {
            "joint_positions": torch.from_numpy(self.agent.read_joints())[None],
            "joint_velocities": torch.from_numpy(self.agent.read_velocities())[None],
        }

    def _get_obs_extra(self, info: dict) -> dict:
        return {"ee_poses": torch.from_numpy(self.agent.read_hands()).reshape(1, -1)}

    def _get_obs_with_sensor_data(
        self,
        info: dict,
        apply_texture_transforms: bool = True,  # noqa: FBT001, FBT002 - ManiSkill's signature
    ) -> dict:
        observation = super()._get_obs_with_sensor_data(info, apply_texture_transforms)
        if self.obs_mode == "pointcloud":
            # One seed a step: equal states of one episode give equal clouds.
            keys = [int(self._episode_seed[0]), int(self.elapsed_steps[0])]
            seed = int(np.random.SeedSequence(keys).generate_state(1)[0])
            ids, workspace = self.segments, self.task.workspace
            above, ahead = map(self.take_picture, ("garment_camera", "environment_camera"))
            garment = get_garment_cloud(above, ids, seed=seed)
            around = get_environment_cloud(ahead, ids, workspace, kind=self.cloud, seed=seed)
            observation["garment_cloud"] = torch.from_numpy(garment)[None]
            observation["workspace_cloud"] = torch.from_numpy(around)[None]
        return observation

    # State ---------------------------------------------------------------------------------

    # ManiSkill's is inferred to return a tensor.
    def get_state_dict(self) -> dict:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return ManiSkill's state with particles, contact forces and present joint targets."""
        self._check_open("get_state_dict")
        state = cast("dict", super().get_state_dict())
        state["targets"] = {"joints": torch.from_numpy(self._target.astype(np.float32))[None]}
        state["garment"] = read_cloth(self.cloth)
        if self._rim_grip is not None:
            state["garment"]["rim_grip"] = torch.from_numpy(self._rim_grip.read_state())[None]
        return state

    def set_state_dict(self, state: dict, env_idx: torch.Tensor | None = None) -> None:
        """Restore a state that was taken with the same garment.

        Args:
            state: As of `get_state_dict`; tensors or arrays, shape (1, D) or, in recordings, (D,).
            env_idx: ManiSkill's.

        Raises:
            ValueError: If a part is missing, not finite, or of another garment.
            EnvironmentClosedError: After `close`.
        """
        self._check_open("set_state_dict")
        state = read_state(state, self.get_state_dict())
        rigid = {k: value for k, value in state.items() if k not in ("garment", "targets")}
        # ManiSkill's default is None, too.
        super().set_state_dict(rigid, env_idx)  # pyright: ignore[reportArgumentType]
        write_cloth(self.cloth, state["garment"])
        if self._rim_grip is not None:
            self._rim_grip.write_state(state["garment"]["rim_grip"].numpy())
        self._target = state["targets"]["joints"][0].numpy().astype(np.float64)
        self._appearance.mark_moved()

    # ManiSkill's takes arrays, too.
    def set_state(  # pyright: ignore[reportIncompatibleMethodOverride]
        self, state: torch.Tensor, env_idx: torch.Tensor | None = None
    ) -> None:
        """Restore a state from `get_state`'s flat vector, shape (1, D)."""
        self.set_state_dict(split_state(state, self.get_state_dict()))

    # Pictures ------------------------------------------------------------------------------

    def draw_garment(self) -> None:
        """Update the garment in SAPIEN's pictures to its present shape."""
        self._check_open("drawing")
        self._appearance.draw_garment(self.get_particles())

    def take_picture(self, camera: str) -> Picture:
        """Draw a picture of one of the task's cameras, or of `WRIST_CAMERAS`.

        Raises:
            ValueError: If there is no such camera.
        """
        check_cameras((camera,), self.task)
        if camera in WRIST_CAMERAS:
            side = WRIST_CAMERAS[camera]
            pose = self.agent.read_hands()[SIDES.index(side)]
            placed = place_wrist_camera(side, pose, self.agent.model)
            return self._get_rasteriser().draw_picture(placed, moves=True)
        return self._get_rasteriser().draw_picture(self.task.cameras[camera])

    def film(self) -> np.ndarray:
        """Draw a picture of the camera for people, shape (H, W, 3), uint8."""
        return self._get_rasteriser().draw(self.task.cameras["video_camera"])

    def list_rigid_meshes(self) -> list[Mesh]:
        """List the meshes of the ground and of all bodies, to draw them elsewhere.

        `get_body_poses` gives the pose of each body; the garment has `garment.faces` and
        `get_particles`.
        """
        self._check_open("drawing")
        return self._appearance.list_rigid_meshes()

    def get_body_poses(self) -> np.ndarray:
        """Give the present poses of the bodies of `list_rigid_meshes`, shape (B, 7), world frame.

        xyz [m] and wxyz.
        """
        return self._appearance.get_body_poses()

    def _get_rasteriser(self) -> Rasteriser:
        self._check_open("drawing")
        return self._appearance.get_rasteriser(self.get_particles())

    @property
    def segments(self) -> Segments:
        """Segmentation ids in pictures."""
        return Segments(
            garment=self._appearance.garment_segment,
            robot=tuple(int(link.per_scene_id[0]) for link in self.agent.robot.get_links()),
            objects={name: item.entity.per_scene_id for name, item in self.objects.items()},
        )

    def _get_obs_sensor_data(
        self,
        apply_texture_transforms: bool = True,  # noqa: FBT001, FBT002 - ManiSkill's signature
    ) -> dict:
        self.draw_garment()
        return super()._get_obs_sensor_data(apply_texture_transforms)

    def render_rgb_array(self, camera_name: str | None = None) -> Any:
        """Render the video camera, as ManiSkill does."""
        self.draw_garment()
        # ManiSkill's default is None, too.
        return super().render_rgb_array(camera_name)  # pyright: ignore[reportArgumentType]

    def render_all(self) -> Any:
        """Render all cameras, as ManiSkill does."""
        self.draw_garment()
        return super().render_all()

    def render_human(self) -> Any:
        """Show the viewer, as ManiSkill does."""
        with explain_rendering():
            self.draw_garment()
            return super().render_human()
