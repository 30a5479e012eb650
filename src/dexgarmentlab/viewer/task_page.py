"""Page of a task: reset by seed, and the expert or a primitive carried out live."""

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING

from dexgarmentlab.viewer.scene import SceneView
from dgl_collect.actors import Expert
from dgl_collect.skill import follow_recordings, load_skill
from dgl_physics import PhysicsError
from dgl_tasks import TaskError
from dgl_tasks.evaluation import run_episode
from dgl_tasks.messages import Command, Mark, StageBegins
from dgl_tasks.observation import STEPS_PER_ACTION

if TYPE_CHECKING:
    from viser import ViserServer

    from dgl_collect.setup import Setup
    from dgl_tasks.policy import Method
    from dgl_tasks.sensing import Sensed

__all__ = ["TaskPage"]


class _StoppedError(Exception):
    """The attempt is given up."""


class TaskPage:
    """Resets a task, and lets a method act while one watches; a listener of its episodes."""

    def __init__(
        self, server: "ViserServer", setup: "Setup", *, colour: tuple[int, int, int], seed: int
    ) -> None:
        """Add the controls, and reset the task."""
        self._server, self._setup, self._colour = server, setup, colour
        self._view: SceneView | None = None
        self._thread: threading.Thread | None = None
        self._may_step, self._stops = threading.Event(), False
        self._is_single = False
        gui = server.gui
        gui.add_markdown(f"**{setup.env.task.title}**: {setup.env.task.success_text}")
        self.seed = gui.add_number("seed", seed, min=0, step=1)
        self.method = gui.add_dropdown("method", ("expert", "primitive"))
        self.reset_button = gui.add_button("reset")
        self.run_button = gui.add_button("run")
        self.pause_button = gui.add_button("pause")
        self.step_button = gui.add_button("step")
        self.told = gui.add_markdown("")
        self._lock = threading.Lock()  # clicks arrive in threads of their own
        self.reset()
        self.reset_button.on_click(lambda _: self.reset())
        self.run_button.on_click(lambda _: self.run())
        self.pause_button.on_click(lambda _: self.pause())
        self.step_button.on_click(lambda _: self.step())

    def reset(self) -> None:
        """Give up the attempt, and reset the task by the seed."""
        with self._lock:
            self._stop()
            self._setup.env.reset(seed=int(self.seed.value))
            self._view = SceneView(self._server, self._setup.env, colour=self._colour)
        self.told.content = f"reset: {self._setup.env.draws['garment']}"

    def run(self) -> None:
        """Begin an attempt, or go on with it."""
        self._is_single = False
        self._may_step.set()
        with self._lock:
            if self._thread is None or not self._thread.is_alive():
                self._stops = False
                self._thread = threading.Thread(target=self._attempt, daemon=True)
                self._thread.start()

    def pause(self) -> None:
        """Let the attempt wait."""
        self._may_step.clear()

    def step(self) -> None:
        """Make one action of a waiting attempt."""
        self._is_single = True
        self._may_step.set()

    def join(self, seconds: float) -> bool:
        """Wait for the end of the attempt; say whether it has ended."""
        if self._thread is not None:
            self._thread.join(seconds)
        return self._thread is None or not self._thread.is_alive()

    def before_step(self, command: Command, look: "Callable[..., Sensed]") -> None:
        """Show the scene at every fifth control step, and wait while paused."""
        del command
        step = look().step
        if step % STEPS_PER_ACTION == 0:
            self._show()
            if self._is_single and step:
                self._may_step.clear()
        self._may_step.wait()
        if self._stops:
            raise _StoppedError

    def note(self, mark: Mark, sensed: "Sensed") -> None:
        """Tell the stage."""
        del sensed
        if isinstance(mark, StageBegins):
            self.told.content = f"stage {mark.name}"

    def _show(self) -> None:
        env = self._setup.env
        if self._view is None:
            self._view = SceneView(self._server, env, colour=self._colour)
        self._view.show(env.get_particles(), env.get_body_poses())

    def _attempt(self) -> None:
        setup = self._setup
        try:
            method = self._make_method()
            self._view = None  # the reset makes a new scene
            ended = run_episode(
                setup.env, setup.motion, method, seed=int(self.seed.value), listener=self
            )
        except _StoppedError:
            return
        except (TaskError, PhysicsError, ValueError) as err:
            self.told.content = f"**{err}**"
            return
        self._show()
        words = "success" if ended.success else f"failure: {ended.detail}"
        self.told.content = f"**{words}**, value {ended.verdict.value:.3f}"

    def _make_method(self) -> "Method":
        setup = self._setup
        if self.method.value == "expert":
            return setup.make_runner(Expert())
        skill = load_skill(setup.env.task, setup.demonstration, setup.options)
        following = follow_recordings(setup.demonstration)
        return setup.make_runner(Expert(follows_steps=False), demonstration=following, skill=skill)

    def _stop(self) -> None:
        if self._thread is not None and self._thread.is_alive():
            self._stops = True
            self._may_step.set()
            self._thread.join()
