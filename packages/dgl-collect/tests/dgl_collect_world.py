"""A world without a simulator: arms that are where they are told, and a garment that lies still."""

import functools
from collections import Counter

import numpy as np

from dgl_assets.robots import SIDES
from dgl_tasks import get_task
from dgl_tasks.errors import PerceptionError
from dgl_tasks.grasps import wrist_to_grasp
from dgl_tasks.handling import Handling
from dgl_tasks.hanging import Hanging
from dgl_tasks.messages import Command, StageBegins, TakePictures
from dgl_tasks.motion import BimanualMotion
from dgl_tasks.observation import Observation

TOP = ((-0.4, 0.7, 0.01), (0.0, 0.8, 0.0), (0.4, 0.7, 0.01))
"""Three points of a garment, from its left to its right [m]."""


@functools.cache
def _make_motion(task_id):
    return BimanualMotion(get_task(task_id))


class World:
    """The senses of a robot, without ground truth; implements `dgl_tasks.sensing.Sensed`.

    A closed hand that is up is seen to hold the garment, unless `loses` says that it does not.
    """

    def __init__(self, motion, cloud):
        self.motion = motion
        self.cloud = np.asarray(cloud, np.float32)
        self.target = motion.robot.compute_start("open")
        self.seed = 3
        self.commands, self.marks = [], []
        self.frames, self.obstacles = {}, []
        self.image = np.zeros((4, 4, 3), np.uint8)
        self.listener = None  # of commands and marks, as a driver has one
        self.looks = []  # whether the arms were out of the way, look after look at the garment
        self.loses = lambda stage, number, side: False
        self.hanging = lambda span: Hanging(sag=0.0, length=0.6)
        self._begun = Counter()
        self._stage = None
        self.hands = Handling(motion, self)

    # What is sensed --------------------------------------------------------------------------

    @property
    def step(self):
        return len(self.commands)

    @property
    def joint_state(self):
        return self.target.astype(np.float32)

    @property
    def ee_pose(self):
        with self.motion.rehearsal():
            self.motion.reset(self.target)
            poses = self.motion.compute_poses()
        return np.stack([poses[side] for side in SIDES])

    def get_grasp_point(self, side):
        pose = self.ee_pose[SIDES.index(side)]
        return wrist_to_grasp(pose[:3], pose[3:], side, robot=self.motion.robot)

    def observe(self):
        return Observation(
            joint_state=self.joint_state,
            ee_pose=self.ee_pose.astype(np.float32),
            image=self.image,
            env_point_cloud=np.zeros((2048, 6), np.float32),
        )

    def see_garment(self):
        self.looks.append(self.is_parked)
        return self._see(self.cloud)

    def see_points(self, camera="environment_camera"):
        hanging = [
            self.get_grasp_point(side) - (0, 0, 0.05)
            for side in SIDES
            if not self.is_open(side)
            and not self.loses(self._stage, self._begun[self._stage], side)
        ]
        return self._see(np.concatenate([self.cloud, *(point[None] for point in hanging)]))

    def see_mask(self):
        return np.ones((4, 4), bool)

    def see_objects(self):
        return np.zeros((2048, 3), np.float32)

    def see_hanging(self):
        left, right = self.get_grasp_point("left"), self.get_grasp_point("right")
        return self.hanging(float(np.linalg.norm(right - left)))

    def _see(self, points):
        if len(points) == 0:
            raise PerceptionError("the camera sees nothing of the garment")
        return points

    # What has been done ----------------------------------------------------------------------

    @property
    def is_parked(self):
        robot = self.motion.robot
        return all(
            np.allclose(self.target[robot.joint_slice(s, "arm")], robot.arm.parked[s], atol=1e-6)
            for s in SIDES
        )

    def is_open(self, side):
        robot = self.motion.robot
        hand = self.target[robot.joint_slice(side, "hand")]
        return np.allclose(hand, robot.get_hand_pose("open"), atol=1e-6)

    def get_marks(self, kind):
        return [mark for mark in self.marks if isinstance(mark, kind)]

    def play(self, part, *, parked=False):
        """Step through a part of an attempt, from parked arms if `parked`; return its result."""
        if parked:
            self.play(self.hands.park())
        try:
            item = next(part)
            while True:
                if isinstance(item, Command):
                    if self.listener is not None:
                        self.listener.before_step(item, lambda *cameras: self)
                    self.target = np.array(item.target)
                    self.commands.append(item)
                elif not isinstance(item, TakePictures):
                    if self.listener is not None:
                        self.listener.note(item, self)
                    self.marks.append(item)
                    if isinstance(item, StageBegins):
                        self._stage = item.name
                        self._begun[item.name] += 1
                item = part.send(self)
        except StopIteration as end:
            return end.value

    def run(self, method):
        """Let a method act from the parked arms on."""
        return self.play(method.run(self.hands), parked=True)


def make_world(task_id="FoldTops-v1", cloud=TOP):
    """Make a world of a task and the points that are seen of a garment [m], shape (N, 3)."""
    return World(_make_motion(task_id), cloud)
