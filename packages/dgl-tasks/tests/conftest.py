"""Robots and environments that only look like ones: no simulator, no cameras."""

import functools
import re
from types import SimpleNamespace

import numpy as np
import pytest

import dgl_tasks
from dgl_assets.robots import DEFAULT_ROBOT, SIDES
from dgl_physics.drawing.rasteriser import Picture
from dgl_tasks.cameras import Workspace
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.handling import Handling
from dgl_tasks.messages import Command, TakePictures
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.observation import Observation
from dgl_tasks.perception import Segments
from dgl_tasks.success import Criterion, Verdict


def make_observation(joint_state):
    return Observation(
        joint_state=np.asarray(joint_state, np.float32),
        ee_pose=np.zeros((2, 7), np.float32),
        image=np.zeros((480, 640, 3), np.uint8),
        env_point_cloud=np.zeros((2048, 6), np.float32),
    )


class World:
    """Snapshot of arms that are at their targets, and of a garment that a test makes up."""

    def __init__(self, motion):
        self.motion = motion
        self.target = motion.robot.compute_start("open")
        self.seed = 0
        self.commands, self.marks, self.masks, self.obstacles = [], [], [], []
        self.points = np.array([[0.0, 0.8, 0.0]])  # far below whatever hands do
        self.hands = Handling(motion, self)

    @property
    def step(self):
        return len(self.commands)

    @property
    def joint_state(self):
        return self.target.astype(np.float32)

    def get_grasp_point(self, side):
        with self.motion.rehearsal():
            self.motion.reset(self.target)
            pose = self.motion.compute_poses()[side]
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=self.motion.robot)

    def observe(self):
        return make_observation(self.joint_state)

    def see_garment(self):
        return np.zeros((2048, 3), np.float32)

    def see_points(self, camera="environment_camera"):
        return self.points

    def see_mask(self):
        return self.masks.pop(0) if self.masks else np.ones((2, 2), bool)

    def play(self, part):
        """Follow a part of a course to its end; gives the commands."""
        before = self.step
        try:
            item = next(part)
            while True:
                if isinstance(item, Command):
                    self.target = np.array(item.target)
                    self.commands.append(item)
                elif not isinstance(item, TakePictures):
                    self.marks.append(item)
                item = part.send(self)
        except StopIteration:
            return self.commands[before:]


class JumpingMotion:
    """Plans jumps, without kinematics."""

    def __init__(self):
        self.robot = DEFAULT_ROBOT
        self.target = np.zeros(self.robot.dof)

    def reset(self, joint_state):
        self.target = np.array(joint_state, dtype=float)

    def hold(self, frames):
        return np.tile(self.target, (frames, 1))

    def park(self):
        for side in SIDES:
            self.target[self.robot.joint_slice(side, "arm")] = self.robot.arm.parked[side]
        return self.target[None].copy()


class FakeEnv:
    """Arms that go half way to each target; hands, cloth and verdict as a test sets them."""

    def __init__(self, *, value=0.9, grasp_points=((-0.4, 0.7, 0.4), (0.4, 0.7, 0.4))):
        self.task = SimpleNamespace(picture_camera="video_camera", workspace=Workspace())
        self.cloud = "segmented"
        self.agent = SimpleNamespace(
            model=DEFAULT_ROBOT,
            control_mode="pd_joint_pos",
            read_joints=lambda: np.array(self.joints),
            read_hands=self._compute_poses,
        )
        self.cloth = SimpleNamespace(
            measure_strain=lambda: np.linspace(0.0, self.strain, 1001),
            solver=SimpleNamespace(measure_penetration=lambda state: [0.001]),
            state=None,
        )
        self.joints = np.zeros(DEFAULT_ROBOT.dof, np.float32)
        self.grasp_points = dict(zip(SIDES, np.array(grasp_points, float), strict=True))
        self.particles = np.zeros((1, 3))
        self.value, self.strain = value, 0.0
        self.garment, self.objects = SimpleNamespace(name="tops/1"), {}
        self.segments = Segments(garment=7, robot=(), objects={})
        self.draws = {"garment": "tops/1", "x": 0.1}
        self.resets, self.sent, self.pictures = [], [], []

    def _compute_poses(self):
        turn = np.array([1.0, 0.0, 0.0, 0.0])
        poses = [
            [*(2 * point - wrist_to_grasp(point, turn, side)), *turn]
            for side, point in self.grasp_points.items()
        ]
        return np.array(poses)

    def reset(self, *, seed, options):
        self.resets.append((seed, options))

    def advance(self, target):
        self.sent.append(np.array(target))
        self.joints = (self.joints + target) / 2

    def get_particles(self):
        return self.particles

    def measure_pulls(self):
        return {side: np.zeros(3) for side in SIDES}

    def get_frames(self):
        return {}

    def measure_touch(self):
        """Press on a person ever less."""
        return {"person": 9.0 - len(self.sent)}

    def take_picture(self, camera):
        """Show the garment at one place in all pictures."""
        self.pictures.append(camera)
        shape = (4, 4)
        return Picture(
            rgb=np.full((*shape, 3), 9, np.uint8),
            points=np.zeros((*shape, 3)),
            segments=np.full(shape, 7),
        )

    def film(self):
        return len(self.sent)

    def judge(self):
        share = Criterion(name="share", value=self.value, comparison=">=", threshold=0.8)
        return Verdict(criteria=(share,))


@functools.cache
def _make_planner():
    return BimanualMotion(dgl_tasks.get_task("FoldTops-v1"))


def refuse(table):
    """Call each function of a table; gives the rows whose ValueError is not the expected line."""
    wrong = []
    for call, message in table:
        try:
            wrong.append((message, call()))
        except ValueError as err:
            if not re.search(message, str(err)) or "\n" in str(err) or len(str(err)) > 500:
                wrong.append((message, str(err)))
    return wrong


@pytest.fixture(scope="session", name="refuse")
def _refuse():
    return refuse


@pytest.fixture
def motion():
    """A planner of real arms at their start."""
    planner = _make_planner()
    planner.reset(planner.robot.compute_start("open"))
    return planner


@pytest.fixture
def world(motion):
    """A world with real kinematics, the arms at their start."""
    return World(motion)


@pytest.fixture
def jumping_world():
    """A world whose motions are jumps."""
    return World(JumpingMotion())


@pytest.fixture
def jumping_motion():
    return JumpingMotion()


@pytest.fixture
def make_env():
    """Makes environments that only look like ones."""
    return FakeEnv


@pytest.fixture
def observe_without_cameras(monkeypatch):
    """Let what is sensed of an environment that cannot render be its joints alone."""
    monkeypatch.setattr("dgl_tasks.env.GarmentEnv.take_picture", lambda self, camera: None)
    monkeypatch.setattr("dgl_tasks.env.GarmentEnv.segments", None)
    monkeypatch.setattr(
        "dgl_tasks.sensing.Sensed.observe", lambda self: make_observation(self.joint_state)
    )
    monkeypatch.setattr(
        "dgl_tasks.sensing.Sensed.see_garment", lambda self: np.zeros((2048, 3), np.float32)
    )
