"""Made-up episodes and attempts, in a module that worker processes can import."""

import contextlib
import errno
import gc
import os
import signal
import sys
import time
from pathlib import Path

import numpy as np

from dgl_collect import (
    AttemptResult,
    Criterion,
    Episode,
    EpisodeRecorder,
    StageRecord,
    save_png,
    write_episode,
)
from dgl_collect.episodes import FINAL_PARTICLES
from dgl_collect.workers.engine import Lost, Worker
from dgl_collect.workers.inside import Workbench
from dgl_tasks.driver import Driver
from dgl_tasks.errors import PolicyError
from dgl_tasks.handling import Handling
from dgl_tasks.messages import StageBegins, StageEnds
from dgl_tasks.sensing import SENSOR_CAMERAS

FACTORY = "dgl_collect_fakes:make_runner"


def make_stage(seed=0, *, frames=2, name="left_sleeve", **changes):
    rng = np.random.default_rng(seed)

    def draw(*shape):
        return rng.random(shape, dtype=np.float32)

    ee_pose = np.zeros((frames, 2, 7), np.float32)
    ee_pose[..., :3], ee_pose[..., 3] = draw(frames, 2, 3), 1.0
    arrays = {
        "joint_state": draw(frames, 60),
        "action": draw(frames, 60),
        "ee_pose": ee_pose,
        "image": np.full((frames, 480, 640, 3), seed % 256, np.uint8),
        "env_point_cloud": draw(frames, 2048, 6),
        "garment_point_cloud": draw(2048, 3),
        "points_affordance_feature": draw(2048, 2),
    }
    points = {"left cuff": {"xyz": [-0.4, 0.7, 0.02], "uv": [200.0, 260.5]}}
    return StageRecord(**({"name": name, "points": points} | arrays | changes))


def make_episode(seed=0, **changes):
    content = {
        "task": "FoldTops-v1",
        "seed": seed,
        "garment_id": "tops_long_sleeve/0007",
        "success": True,
        "success_value": 0.91,
        "stages": (make_stage(seed), make_stage(seed + 1, name="right_sleeve", frames=3)),
        "randomisation": {"position": [0.03, 0.8, 0.2]},
        "measurements": {"largest stretch": 0.08},
        "package_versions": {"dgl-collect": "0.1.0"},
    }
    return Episode(**(content | changes))


def close_and_open(hands):
    """The course of a short attempt: the left hand closes where it is, and opens again."""
    yield from hands.park()
    sensed = yield from hands.look(*SENSOR_CAMERAS)
    begins = StageBegins(
        name="left_sleeve",
        garment_point_cloud=sensed.see_garment(),
        points_affordance_feature=np.zeros((2048, 2), np.float32),
        object_point_cloud=sensed.see_objects(),
        points={"left_cuff": np.array([-0.4, 0.7, 0.01])},
        seen_at=sensed.step,
    )
    yield from hands.send(hands.motion.hold(3))
    yield from hands.mark(begins)
    yield from hands.send(hands.motion.hold(10), recorded="approach")
    yield from hands.send(hands.motion.set_hands({"left": "close"})[:17], recorded="stage")
    yield from hands.mark(StageEnds(name="left_sleeve", counts=True))
    yield from hands.send(hands.motion.hold(2))


def perform(attempts, *, seed):
    """A short attempt, recorded."""
    env = attempts.env
    recorder = EpisodeRecorder(env, with_approach=True)
    driver = Driver(env, seed=seed, listener=recorder)
    driver.drive(close_and_open(Handling(attempts._setup.motion, driver.reset())))
    (stage,) = recorder.records.values()
    assert (stage.frame_count, stage.approach_frames) == (6, 2)
    verdict = env.judge()
    return make_episode(
        task=env.task.id,
        seed=seed,
        garment_id=env.garment.name,
        stages=(stage,),
        success=verdict.success,
        success_value=verdict.value,
        randomisation=dict(env.draws),
        commands=np.stack(driver.commands),
        extra={FINAL_PARTICLES: env.get_particles().astype(np.float32)},
    )


end_worker = os._exit
"""Ends the process of a worker; tests replace it where workers have none."""


def hang():
    """Never come back; tests replace it where workers have no process."""
    time.sleep(60)


class FakeRunner:
    """Succeeds for even seeds, without a retry for every second one; fails as its options say."""

    def __init__(self, options):
        self.options = options

    def run(self, request, out_dir):
        attempt_index, seed, episode_id = request.index, request.seed, request.episode_id
        sys.stdout.write(f"attempt {attempt_index} speaks\n")
        save_png(out_dir / f"{episode_id}.png", np.full((8, 8, 3), attempt_index, np.uint8))
        (out_dir / f"{episode_id}.mp4").write_bytes(
            b"film" + bytes(self.options.get("film_bytes", 0))
        )
        if self.options.get("tell_garbage"):
            many = gc.get_freeze_count() > 100_000
            sys.stdout.write(f"collects {gc.isenabled()}, passes over many {many}\n")
        time.sleep(self.options.get("seconds", 0.0))
        if attempt_index in self.options.get("hang_at", ()):
            hang()
        if attempt_index in self.options.get("raise_at", ()):
            raise RuntimeError("the cloth exploded")
        if attempt_index in self.options.get("give_wrong_actions_at", ()):
            raise PolicyError("actions must have shape (N, 60); got (1, 59)")
        if attempt_index in self.options.get("exit_at", ()):
            end_worker(3)
        if self._is_first("die_once_at", attempt_index):
            os.kill(os.getpid(), signal.SIGKILL)
        if self._is_first("fill_disk_once_at", attempt_index):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(out_dir / "film"))
        if self._is_first("use_up_memory_once_at", attempt_index):
            raise MemoryError
        draws = {"x": float(np.random.default_rng(seed).uniform(-0.1, 0.1))}
        measurements = {"max_strain_mean": 0.1}
        files = {"video": f"{episode_id}.mp4", "picture": f"{episode_id}.png"}
        if attempt_index not in self.options.get("forget_file_at", ()):
            stages = (make_stage(seed, frames=1),)
            episode = make_episode(
                seed,
                stages=stages,
                garment_id=f"tops/{seed % 5:04d}",
                success=seed % 2 == 0,
                success_value=0.9 if seed % 2 == 0 else 0.5,
                randomisation=draws,
                measurements=measurements,
            )
            write_episode(out_dir / f"{episode_id}.h5", episode)
            files["episode"] = f"{episode_id}.h5"
        success = seed % 2 == 0
        value = 0.9 if success else 0.5
        return AttemptResult(
            index=attempt_index,
            seed=seed,
            success=success,
            first_try=seed % 4 == 0,
            value=value,
            reason=None if success else "too little inside the box",
            criteria=(Criterion(name="inside", value=value, comparison=">=", threshold=0.8),),
            garment_id=f"tops/{seed % 5:04d}",
            frames=1,
            stage_seconds={"left_sleeve": 0.1},
            files=files,
            randomisation=draws,
            measurements=measurements,
            beliefs={"value": 0.7},
        )

    def _is_first(self, option, attempt_index):
        """True if an option names the attempt and it is made for the first time."""
        if attempt_index not in self.options.get(option, ()):
            return False
        sys.stdout.flush()
        try:
            (Path(self.options["marks"]) / f"mark-{attempt_index}").touch(exist_ok=False)
        except FileExistsError:
            return False
        return True

    def close(self):
        sys.stdout.write("closed\n")


def make_runner(task, options):
    options = options if isinstance(options, dict) else {}  # without any, those of a real task
    if options.get("exit_when_built"):
        end_worker(4)
    if options.get("fail_when_built"):
        raise RuntimeError("no Vulkan device")
    return FakeRunner(options)


class Silence(BaseException):
    """An attempt that never ends."""


def be_silent():
    raise Silence


class InProcessWorker(Worker):
    """A worker without a process: `SystemExit` is its end, `Silence` its hanging."""

    def __init__(self, number, work, log_path):
        super().__init__(number)
        self.since, self._log_path = time.monotonic(), log_path
        self._bench, self._task = Workbench(work), None
        self.is_busy = True  # building

    def _send(self, job, out_dir):
        self._task, self.is_busy = (job, out_dir), True

    def receive(self):
        self.is_busy = False
        with self._writing_to_log():
            try:
                return self._bench.do(*self._task) if self._task else self._bench.build()
            except SystemExit as end:
                return Lost(how=f"exit status {end.code}")
            except Silence:
                return None

    def release(self):
        with self._writing_to_log():
            self._bench.close()

    @contextlib.contextmanager
    def _writing_to_log(self):
        with self._log_path.open("a") as log, contextlib.redirect_stdout(log):
            yield

    def kill(self):
        self.is_busy = False


class InProcessEngine:
    """Does the jobs of workers one after the other, when it is heard."""

    def start(self, number, work, log_path):
        return InProcessWorker(number, work, log_path)

    def hear(self, workers, seconds):
        busy = [worker for worker in workers if worker.is_busy]
        heard = [(worker, worker.receive()) for worker in busy[:1]]
        return [(worker, message) for worker, message in heard if message is not None]

    def close(self):
        pass


def work_here(patch):
    """Let the workers of a collection be in this process, and not cost a second each.

    Args:
        patch: pytest's monkeypatch.
    """
    patch.setattr("dgl_collect.workers.dispatch._start_engine", lambda workers: InProcessEngine())
    patch.setattr(sys.modules[__name__], "end_worker", sys.exit)
    patch.setattr(sys.modules[__name__], "hang", be_silent)


if __name__ == "__main__":  # a run for the tests that interrupt one
    from dgl_collect import CollectConfig, WorkerError, Workers, collect

    def tell(progress):
        sys.stdout.write(f"{len(progress.results)}\n")
        sys.stdout.flush()

    address = sys.argv[2] if len(sys.argv) > 2 else None
    episodes = int(sys.argv[3]) if len(sys.argv) > 3 else 200
    try:
        summary = collect(
            CollectConfig(
                task="FoldTops-v1",
                episodes=episodes,
                workers=Workers(count=2, engine="ray" if address else "local", address=address),
                out=Path(sys.argv[1]),
                attempt_factory=FACTORY,
                options={"seconds": 0.5 if address else 0.05},
            ),
            on_progress=tell,
        )
    except WorkerError as err:
        sys.stderr.write(f"{err}\n")
        sys.stderr.flush()
        sys.exit(1)
    sys.exit(130 if summary.status == "interrupted" else 0)
