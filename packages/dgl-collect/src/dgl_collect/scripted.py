"""Methods without learning, to be evaluated beside policies: the expert, and one that must never succeed."""

from dataclasses import dataclass

import numpy as np

from dgl_assets.robots import Side
from dgl_collect.execution import Execution, Setup
from dgl_tasks.approach import RELEASE_FRAMES, plan_approach
from dgl_tasks.driver import Driver

LIFT_HEIGHT = 0.3
"""How high the garment is lifted before it is dropped [m]."""


@dataclass(frozen=True, kw_only=True)
class Expert:
    """Carries the demonstration over to the garment, as collection does; implements `EpisodePolicy`."""

    setup: Setup

    def run(self, driver: Driver) -> None:
        """Run all stages, without recording them."""
        execution = Execution(self.setup, driver.seed, driver=driver, recorded="nothing")
        execution.look()
        execution.perform()


@dataclass(frozen=True, kw_only=True)
class LiftAndDrop:
    """Takes the first stage's grasp points, lifts them straight up, and lets go.

    It handles the garment and does nothing of the task: what a success rule must not accept.
    Implements `EpisodePolicy`.
    """

    setup: Setup

    def run(self, driver: Driver) -> None:
        """Grasp, lift, let go and park.

        Raises:
            TaskError: If a hand cannot go there, or the camera sees no garment.
        """
        motion, stage = driver.motion, driver.env.task.stages[0]
        execution = Execution(self.setup, driver.seed, driver=driver, recorded="nothing")
        grasp, _ = execution.find_grasps(stage, driver.see_garment())
        up = np.array([0.0, 0.0, LIFT_HEIGHT])
        lifted: dict[Side, np.ndarray] = {side: point + up for side, point in grasp.items()}

        def rehearse(side: Side, orientation: np.ndarray) -> None:
            plan_approach(motion, {side: grasp[side]}, {side: orientation})
            motion.move({side: lifted[side]}, {side: orientation})

        orientations = driver.approach(stage, grasp, [rehearse])
        demonstrated = self.setup.demonstration.get_stage(stage.name)
        driver.send(motion.set_hands(dict.fromkeys(grasp, demonstrated.grasp_pose)))
        driver.send(motion.move(lifted, orientations))
        driver.send(motion.set_hands(dict.fromkeys(grasp, demonstrated.release_pose)))
        driver.send(motion.hold(RELEASE_FRAMES))
        driver.send(motion.park())
