"""Measure a Ray cluster of this machine: against local workers, and the load that one driver bears.

`attempts`: real attempts by two local workers, then by two nodes of one processor each; the files
must be equal. `driver`: many stand-in attempts that sleep and bring back 12 MB each; the rate, and
the memory of the driver.

Example: python cluster_throughput.py attempts --task FoldTops-v1 --attempts 8
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

os.environ["RAY_USAGE_STATS_ENABLED"] = "0"

from random_kills import StandIn

from dgl_collect import (
    AttemptRequest,
    AttemptResult,
    CollectConfig,
    Progress,
    Workers,
    collect,
)

FRAMES = 13
"""Of a stand-in's episode, 1 MB each."""


class Courier(StandIn):
    """Sleeps, and writes the files of its first attempt again: many of them fit on one machine."""

    def __init__(self, seconds: float) -> None:
        """Sleep for so many seconds."""
        super().__init__(0.0, FRAMES, succeeds=True)
        self._pause = seconds
        self._kept: dict[str, bytes] = {}

    def run(self, request: AttemptRequest, out_dir: Path) -> AttemptResult:
        """Make one attempt."""
        names = {"video": ".mp4", "picture": ".png", "episode": ".h5"}
        files = {kind: request.episode_id + suffix for kind, suffix in names.items()}
        if not self._kept:
            super().run(request, out_dir)
            self._kept = {kind: (out_dir / name).read_bytes() for kind, name in files.items()}
        time.sleep(self._pause)
        for kind, name in files.items():
            (out_dir / name).write_bytes(self._kept[kind])
        return AttemptResult(
            index=request.index,
            seed=request.seed,
            success=True,
            value=0.5,
            garment_id="stand-in",
            frames=FRAMES,
            files=files,
        )


def make_courier(task: str, options: dict) -> Courier:
    """Build stand-ins; see `dgl_collect.CollectConfig.attempt_factory`."""
    return Courier(options["seconds"])


class Stopwatch:
    """Notes when workers were ready and when attempts ended, and the memory of this process."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self.began = self.ended = time.monotonic()
        self.ready: float | None = None
        self.memory: list[float] = []
        """At each change [GiB]."""

    def note(self, progress: Progress) -> None:
        """Take note of progress."""
        now = time.monotonic()
        if self.ready is None and progress.workers_ready == self._workers:
            self.ready = now
        self.ended = now
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        self.memory.append(pages * os.sysconf("SC_PAGE_SIZE") / 2**30)


def start_cluster(nodes: int, cpus: int):
    """Start a cluster of a head without processors and some nodes."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    for _ in range(nodes):
        cluster.add_node(num_cpus=cpus)
    return cluster


def read(folder: Path) -> dict[str, bytes]:
    """Read the files of a run's attempts by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for part in ("episodes", "failed")
        for path in (folder / part).glob("*")
    }


def run(folder: Path, workers: Workers, **settings: object) -> Stopwatch:
    """Collect, and time it."""
    watch = Stopwatch(workers.count)
    config = CollectConfig(out=folder, workers=workers, **settings)
    collect(config, on_progress=watch.note)
    return watch


def compare_attempts(options: argparse.Namespace, folder: Path) -> int:
    """Compare two nodes with two local workers."""
    settings = {"task": options.task, "episodes": options.attempts, "seed": options.seed}
    local = run(folder / "local", Workers(count=2), **settings)
    cluster = start_cluster(2, 1)
    workers = Workers(count=2, engine="ray", address=cluster.address)
    remote = run(folder / "ray", workers, **settings)
    cluster.shutdown()
    seconds = [watch.ended - (watch.ready or watch.began) for watch in (local, remote)]
    whole = [watch.ended - watch.began for watch in (local, remote)]
    same = read(folder / "local") == read(folder / "ray")
    print(
        f"two local workers: {seconds[0]:.1f} s from when they were ready, {whole[0]:.1f} s in all"
    )
    print(f"two nodes: {seconds[1]:.1f} s, {whole[1]:.1f} s")
    print(
        f"throughput of the nodes: {seconds[0] / seconds[1]:.3f}, with starts "
        f"{whole[0] / whole[1]:.3f}"
    )
    print(f"files: {'equal' if same else 'NOT EQUAL'}")
    return 0 if same else 1


def load_driver(options: argparse.Namespace, folder: Path) -> int:
    """Bring many large results to one driver."""
    cluster = start_cluster(1, options.workers)
    watch = run(
        folder / "driver",
        Workers(count=options.workers, engine="ray", address=cluster.address),
        task="FoldTops-v1",
        episodes=options.attempts,
        attempt_factory="cluster_throughput:make_courier",
        options={"seconds": options.seconds},
    )
    cluster.shutdown()
    seconds = watch.ended - (watch.ready or watch.began)
    size = sum(len(content) for content in read(folder / "driver").values())
    print(
        f"{options.attempts} attempts of {size / options.attempts / 1e6:.1f} MB by "
        f"{options.workers} workers"
    )
    print(f"{options.attempts / seconds:.1f} attempts a second for {seconds:.0f} s")
    half, last = watch.memory[len(watch.memory) // 2], watch.memory[-1]
    print(f"memory of the driver: {half:.2f} GiB after half of them, {last:.2f} GiB at the end")
    return 0


def main() -> int:
    """Measure what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("attempts", "driver"))
    parser.add_argument("--task", default="FoldTops-v1")
    parser.add_argument("--attempts", type=int, default=8)
    parser.add_argument("--workers", type=int, default=40)
    parser.add_argument("--seconds", type=float, default=6.0, help="that a stand-in takes")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="dgl-cluster-"))
    try:
        measure = compare_attempts if options.what == "attempts" else load_driver
        return measure(options, folder)
    finally:
        shutil.rmtree(folder)


if __name__ == "__main__":
    sys.exit(main())
