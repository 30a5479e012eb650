"""Kill workers, runs and nodes at random; check that nothing is corrupt, lost or there twice.

A collection is run undisturbed, and again while processes of it are killed and the run is
continued; then both must have the same files. Attempts are stand-ins that take a second and write a
real episode; with `--task` they are real.

Example: python random_kills.py --kills 100 --engine ray
"""

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

from dgl_collect import (
    AttemptRequest,
    AttemptResult,
    CollectConfig,
    Episode,
    StageRecord,
    Workers,
    collect,
    read_episode,
    save_png,
    write_episode,
)
from dgl_collect.results import ATTEMPTS_FILE, read_results
from dgl_collect.verify import verify_run

STAND_IN = "random_kills:make_stand_in"
QUIET_SECONDS = (0.3, 3.0)
"""Between two kills [s]."""


class StandIn:
    """Takes a while, and writes an episode, a film and a picture that follow from the seed."""

    def __init__(self, seconds: float, frames: int, *, succeeds: bool) -> None:
        """Take so many seconds, and write so many frames; two of three succeed, or all."""
        self._seconds, self._frames, self._succeeds = seconds, frames, succeeds

    def run(self, request: AttemptRequest, out_dir: Path) -> AttemptResult:
        """Make one attempt."""
        seed, stem = request.seed, request.episode_id
        rng = np.random.default_rng(seed)
        time.sleep(self._seconds)
        files = {"video": f"{stem}.mp4", "picture": f"{stem}.png"}
        (out_dir / files["video"]).write_bytes(rng.bytes(400_000))
        save_png(out_dir / files["picture"], rng.integers(0, 255, (48, 64, 3), dtype=np.uint8))
        success = self._succeeds or seed % 3 > 0
        if success:
            files["episode"] = f"{stem}.h5"
            write_episode(out_dir / files["episode"], make_episode(rng, seed, self._frames))
        return AttemptResult(
            index=request.index,
            seed=seed,
            success=success,
            value=0.5,
            reason=None if success else "by its seed",
            garment_id="stand-in",
            frames=self._frames if success else 0,
            files=files,
        )

    def close(self) -> None:
        """Nothing is to be released."""


def make_episode(rng: np.random.Generator, seed: int, frames: int) -> Episode:
    """Make an episode of noise, which does not compress: 1 MB a frame."""

    def draw(*shape: int) -> np.ndarray:
        return rng.random(shape, dtype=np.float32)

    ee_pose = np.zeros((frames, 2, 7), np.float32)
    ee_pose[..., :3], ee_pose[..., 3] = draw(frames, 2, 3), 1.0
    stage = StageRecord(
        name="stand_in",
        joint_state=draw(frames, 60),
        action=draw(frames, 60),
        ee_pose=ee_pose,
        image=rng.integers(0, 255, (frames, 480, 640, 3), dtype=np.uint8),
        env_point_cloud=draw(frames, 2048, 6),
        garment_point_cloud=draw(2048, 3),
        points_affordance_feature=draw(2048, 2),
    )
    return Episode(
        task="FoldTops-v1",
        seed=seed,
        garment_id="stand-in",
        success=True,
        success_value=0.5,
        stages=(stage,),
    )


def make_stand_in(task: str, options: dict) -> StandIn:
    """Build stand-ins; see `dgl_collect.CollectConfig.attempt_factory`."""
    return StandIn(
        options.get("seconds", 1.0), options.get("frames", 4), succeeds=options.get("all", False)
    )


def run_once(options: argparse.Namespace) -> int:
    """Collect, or continue; the process that is killed."""
    settings = {} if options.task else {"attempt_factory": STAND_IN}
    task = options.task or "FoldTops-v1"
    summary = collect(
        CollectConfig(
            task=task,
            episodes=options.attempts,
            out=options.out,
            workers=Workers(count=options.workers, engine=options.engine, address=options.address),
            resume=(options.out / "run.json").exists(),
            **settings,
        ),
    )
    return 0 if summary.status == "complete" else 1


def start(options: argparse.Namespace, out: Path, address: str | None) -> subprocess.Popen:
    """Start a run in a process of its own."""
    command = [sys.executable, __file__, "--run", "--out", str(out)]
    command += ["--attempts", str(options.attempts), "--workers", str(options.workers)]
    command += ["--task", options.task] if options.task else []
    if out.name != "undisturbed":
        command += ["--engine", options.engine]
        command += ["--address", address] if address else []
    log = (out.parent / f"{out.name}.log").open("ab")
    return subprocess.Popen(command, stdout=log, stderr=log)


def find_workers(run: subprocess.Popen, engine: str) -> list[int]:
    """Find the worker processes of a run."""
    if engine == "local":
        children = Path(f"/proc/{run.pid}/task/{run.pid}/children")
        pids = [int(pid) for pid in children.read_text().split()] if children.exists() else []
        return [pid for pid in pids if "spawn_main" in read_command(pid)]
    return [
        int(path.name)
        for path in Path("/proc").glob("[0-9]*")
        if read_command(int(path.name)).startswith("ray::RemoteWorker")
    ]


def read_command(pid: int) -> str:
    """Read the command line of a process; empty if it is gone."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return ""


def disturb(options: argparse.Namespace, out: Path) -> Counter:
    """Run to the end while killing, and count what was killed."""
    rng, killed = random.Random(options.seed), Counter()
    cluster = None
    if options.engine == "ray":
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"
        from ray.cluster_utils import Cluster

        cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
        for _ in range(options.workers):
            cluster.add_node(num_cpus=1)
    address = cluster.address if cluster else None
    run = start(options, out, address)
    while True:
        time.sleep(rng.uniform(*QUIET_SECONDS) * options.pace)
        code = run.poll()
        if code == 0:
            break
        if code is not None:
            killed["run ended by itself"] += 1
            run = start(options, out, address)
            continue
        made = sum(number for name, number in killed.items() if name != "run ended by itself")
        if made >= options.kills:
            continue
        kinds = ["worker", "worker", "run"] + (["node"] if cluster else [])
        kind = rng.choice(kinds)
        if kind == "run":
            run.kill()
            run.wait()
            run = start(options, out, address)
        elif kind == "node" and cluster is not None:
            cluster.remove_node(rng.choice(list(cluster.worker_nodes)), allow_graceful=False)
            cluster.add_node(num_cpus=1)
        elif workers := find_workers(run, options.engine):
            os.kill(rng.choice(workers), signal.SIGKILL)
        else:
            continue
        killed[kind] += 1
    if cluster is not None:
        cluster.shutdown()
    return killed


def compare(undisturbed: Path, disturbed: Path) -> dict[str, int]:
    """Count files and lines that are not as in the undisturbed run."""
    faults = [
        fault for _, fault in verify_run(disturbed) if fault and "mp4 cannot be read" not in fault
    ]
    for fault in faults:
        print(fault)
    whole, found = (read_results(folder / ATTEMPTS_FILE) for folder in (undisturbed, disturbed))

    def describe(result: AttemptResult) -> tuple:
        return result.index, result.seed, result.success, result.reason, tuple(result.files.items())

    def read(folder: Path) -> dict[str, bytes]:
        return {
            str(path.relative_to(folder)): path.read_bytes()
            for part in ("episodes", "failed")
            for path in (folder / part).glob("*")
        }

    ours, its = read(undisturbed), read(disturbed)
    for path in disturbed.glob("episodes/*.h5"):
        read_episode(path)
    lines = (disturbed / ATTEMPTS_FILE).read_text().splitlines()
    return {
        "attempts": len(found),
        "lost": len({r.index for r in whole} - {r.index for r in found}),
        "twice": len(lines) - len({json.loads(line)["index"] for line in lines}),
        "other outcome": len({describe(r) for r in whole} ^ {describe(r) for r in found}),
        "corrupt": len(faults),
        "other files": sum(ours.get(name) != its.get(name) for name in ours.keys() | its.keys()),
    }


def main() -> int:
    """Run undisturbed, then disturbed, and compare."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--attempts", type=int, default=100)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--engine", choices=("local", "ray"), default="local")
    parser.add_argument("--task", help="make real attempts at this task")
    parser.add_argument("--pace", type=float, default=1.0, help="factor on the time between kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--address")
    parser.add_argument("--run", action="store_true", help="what this script starts itself")
    options = parser.parse_args()
    if options.run:
        return run_once(options)
    folder = options.out or Path(tempfile.mkdtemp(prefix="dgl-kills-"))
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    began = time.monotonic()
    if start(options, folder / "undisturbed", None).wait() != 0:
        print((folder / "undisturbed.log").read_text()[-2000:])
        return 1
    between = time.monotonic()
    killed = disturb(options, folder / "disturbed")
    figures = compare(folder / "undisturbed", folder / "disturbed")
    print(f"undisturbed {between - began:.0f} s, disturbed {time.monotonic() - between:.0f} s")
    print("killed:", dict(killed))
    print(figures)
    return int(any(number for name, number in figures.items() if name != "attempts"))


if __name__ == "__main__":
    sys.exit(main())
