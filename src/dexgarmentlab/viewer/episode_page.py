"""Page of an episode: a time line over its replay, with clouds, affordance and criteria."""

import threading
import time
from typing import TYPE_CHECKING

import numpy as np

from dexgarmentlab.viewer.scene import SceneView
from dexgarmentlab.viewer.shots import Shots
from dgl_tasks.observation import CONTROL_FREQUENCY, STEPS_PER_ACTION

if TYPE_CHECKING:
    from viser import ViserServer

    from dgl_collect.episodes import Episode, StageRecord

__all__ = ["EpisodePage"]

SIDE_COLOURS = np.array([[0.1, 0.45, 0.9], [0.95, 0.45, 0.1]])
"""Affordance of the left and of the right hand."""
PALE = 0.85
LIFT = np.array([0.0, 0.0, 0.01])
"""Of a cloud above the cloth that it would be hidden in [m]."""


class EpisodePage:
    """Lets one scrub through an episode."""

    def __init__(
        self, server: "ViserServer", view: SceneView, episode: "Episode", shots: Shots
    ) -> None:
        """Add the controls, and show the beginning."""
        self._view, self._episode, self._shots = view, episode, shots
        self._lock = threading.RLock()  # controls come in threads of their own
        gui = server.gui
        last = len(shots.particles) - 1
        gui.add_markdown(
            f"**{episode.task}**, seed {episode.seed}, {episode.garment_id}: "
            f"{'success' if episode.success else 'failure'}, {episode.success_value:.3f}"
        )
        self.slider = gui.add_slider("frame", 0, last, 1, 0)
        self.playing = gui.add_checkbox("play", initial_value=False)
        self.cloud = gui.add_checkbox("cloud that policies see", initial_value=False)
        self.affordance = gui.add_checkbox("affordance", initial_value=False)
        self.told = gui.add_markdown("")
        for control in (self.slider, self.cloud, self.affordance):
            control.on_update(lambda _: self.show())
        self.show()
        threading.Thread(target=self._play, daemon=True).start()

    def find_stage(self, frame: int) -> "tuple[StageRecord, int] | None":
        """Find the recorded stage of a frame, and the number of the frame in its record."""
        step = frame * STEPS_PER_ACTION
        for stage in self._episode.stages:
            first = stage.first_step
            if first is not None and 0 <= step - first < stage.frame_count * STEPS_PER_ACTION:
                return stage, (step - first) // STEPS_PER_ACTION
        return None

    def show(self) -> None:
        """Show the frame of the slider."""
        with self._lock:
            self._show()

    def _show(self) -> None:
        frame, shots = int(self.slider.value), self._shots
        self._view.show(shots.particles[frame], shots.poses[frame])
        found = self.find_stage(frame)
        none = np.zeros((0, 3))
        points = colours = spots = heat = none
        if found is not None and self.cloud.value:
            stage, number = found
            points, colours = np.split(stage.env_point_cloud[number], 2, axis=1)
        if found is not None and self.affordance.value:
            stage, _ = found
            spots = stage.garment_point_cloud + LIFT
            share = stage.points_affordance_feature[..., None]  # (N, 2, 1)
            heat = PALE + (share * (SIDE_COLOURS - PALE)).sum(axis=1)
        self._view.show_points("cloud", points, colours)
        self._view.show_points("affordance", spots, np.clip(heat, 0, 1))
        seconds = frame * STEPS_PER_ACTION / CONTROL_FREQUENCY
        name = found[0].name if found is not None else "between stages"
        rows = [
            f"| {n} | {v:.3f} |" for n, v in zip(shots.names, shots.criteria[frame], strict=True)
        ]
        self.told.content = "\n".join(
            [f"{seconds:.1f} s, {name}", "", "| criterion | value |", "|---|--:|", *rows]
        )

    def _play(self) -> None:
        while True:
            time.sleep(STEPS_PER_ACTION / CONTROL_FREQUENCY)
            if self.playing.value:
                last = len(self._shots.particles) - 1
                self.slider.value = 0 if self.slider.value >= last else self.slider.value + 1
