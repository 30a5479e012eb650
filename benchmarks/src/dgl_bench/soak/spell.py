"""One episode of random actions, and what it did to the process."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dgl_assets.robots import SIDES
from dgl_bench.process_memory import measure_process_memory
from dgl_physics import ContactOverflowError, PhysicsError
from dgl_tasks import load_task
from dgl_tasks.env import GarmentEnv
from dgl_tasks.robot import BimanualUR10eShadow

__all__ = ["Spell", "SpellRequest", "Spells"]

HOLD = 6
"""Actions for which a goal of the joints holds: hands get somewhere."""
ABOVE = 0.25
"""Largest height above the garment of a hand's target [m]."""


@dataclass(frozen=True, kw_only=True)
class SpellRequest:
    """One episode."""

    task: str
    """Environment id."""
    number: int
    """Among all episodes."""
    seed: int
    """Of the start and of the actions."""
    steps: int
    """Actions, each of five control steps."""


@dataclass(frozen=True, kw_only=True)
class Spell:
    """Outcome of one episode of random actions."""

    request: SpellRequest
    steps: int = 0
    """Actions made before it ended."""
    touching: int = 0
    """Of them, those after which a hand touched the garment."""
    not_finite: int = 0
    """Of them, those after which a number of particles, joints or the reward was not finite."""
    overflows: int = 0
    """Contact lists that could not grow any more."""
    error: str = ""
    """Error that ended it early; empty if none did."""
    process: int = 0
    """Id of its worker's process."""
    memory: int = 0
    """Resident memory of the process at its end [bytes]."""


class Spells:
    """Runs episodes of random actions as jobs of a worker; see `dgl_collect.workers.JobRunner`."""

    def __init__(self) -> None:
        """Keep one environment at a time."""
        self._env: GarmentEnv | None = None

    def run(self, request: SpellRequest, out_dir: Path) -> Spell:
        """Run one episode."""
        del out_dir
        env = self._get_env(request.task)
        rng = np.random.default_rng(request.seed)
        made = touching = not_finite = overflows = 0
        error = ""
        try:
            env.reset(seed=request.seed)
            wanderer = Wanderer(env, rng)
            for _ in range(request.steps):
                _, reward, *_ = env.step(wanderer.act())
                made += 1
                touching += env.count_touching() > 0
                values = (
                    env.get_particles(),
                    get_robot(env).read_joints(),
                    float(reward),
                )
                not_finite += not all(np.isfinite(value).all() for value in values)
        except ContactOverflowError as err:
            overflows, error = 1, str(err)
        except (PhysicsError, ValueError, RuntimeError, ArithmeticError) as err:
            error = f"{type(err).__name__}: {err}"
        return Spell(
            request=request,
            steps=made,
            touching=touching,
            not_finite=not_finite,
            overflows=overflows,
            error=error,
            process=os.getpid(),
            memory=measure_process_memory(),
        )

    def close(self) -> None:
        """Release the environment."""
        if self._env is not None:
            self._env.close()
        self._env = None

    def _get_env(self, task: str) -> GarmentEnv:
        declared = load_task(task)
        if self._env is None or self._env.task.id != declared.id:
            self.close()
            self._env = GarmentEnv(
                task=declared,
                obs_mode="none",
                reward_mode="normalized_dense",
                sim_backend="physx_cpu",
                render_backend="cpu",
            )
        return self._env


class Wanderer:
    """Source of random actions: hands are sent to the garment, or joints anywhere, by turns.

    Goals of the arms hold for `HOLD` actions; fingers are drawn anew at every one.
    """

    def __init__(self, env: GarmentEnv, rng: np.random.Generator) -> None:
        self._env, self._rng = env, rng
        robot = get_robot(env)
        names, joints = robot.model.joint_names, robot.robot.active_joints_map
        self._limits = np.array([joints[n].limits[0].cpu().numpy().reshape(2) for n in names])
        mapping = robot.controller.action_mapping  # pyright: ignore[reportAttributeAccessIssue] - of all parts together
        self._arms = [slice(*mapping[f"{side}_arm"]) for side in SIDES]
        self._step = 0
        self._goals: list[np.ndarray] = []

    def act(self) -> dict:
        """Draw the next action."""
        mode = ("pd_joint_pos", "pd_ee_pose")[self._step // HOLD % 2]
        if self._step % HOLD == 0:
            self._goals = [self._draw_goal(arm, mode) for arm in self._arms]
        self._step += 1
        action = self._rng.uniform(*self._limits.T)
        for arm, goal in zip(self._arms, self._goals, strict=True):
            action[arm] = goal
        return {"control_mode": mode, "action": action.astype(np.float32)}

    def _draw_goal(self, arm: slice, mode: str) -> np.ndarray:
        if mode == "pd_joint_pos":
            now = get_robot(self._env).read_joints()[arm]
            return np.clip(now + self._rng.uniform(-1, 1, now.shape), *self._limits[arm].T)
        place = self._rng.choice(self._env.get_particles())
        place = place + np.array([0.0, 0.0, self._rng.uniform(0.0, ABOVE)])
        return np.concatenate([place, self._rng.uniform(-np.pi, np.pi, 3)])


def get_robot(env: GarmentEnv) -> BimanualUR10eShadow:
    """Give the robot of an environment."""
    assert isinstance(env.agent, BimanualUR10eShadow)
    return env.agent
