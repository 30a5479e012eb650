"""Workers as actors of a Ray cluster."""

import logging
import os
import shutil
import signal
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dgl_collect.errors import EngineError, WorkerError
from dgl_collect.workers.engine import Answer, Lost, Worker, Workers
from dgl_collect.workers.inside import ENVIRONMENT, Workbench, print_to
from dgl_collect.workers.jobs import Job, Work
from dgl_collect.workers.local import CLOSE_SECONDS
from dgl_files.whole import write_bytes

logger = logging.getLogger(__name__)

CONNECT_SECONDS = 10.0
"""Time for the head of a cluster to answer [s]."""
KNOCK_SECONDS = 5.0
"""Period of checks that the head still answers [s]."""
GONE_SECONDS = 20.0
"""Time without the head after which the run stops [s]. Ray itself would end this process after a
minute, silently."""


@dataclass(frozen=True, kw_only=True)
class Parcel:
    """An answer on its way from an actor."""

    answer: Answer
    files: Mapping[str, bytes]
    """Files of the job by name, unless they lie in the output folder already."""
    printed: bytes
    """Output of the worker since its last answer."""


class RemoteWorker:
    """The actor: a process on a node of the cluster."""

    def __init__(self, work: Work, search_path: Sequence[str]) -> None:
        # Unlike a process of this machine, an actor does not inherit the search path of modules.
        sys.path += [entry for entry in search_path if entry not in sys.path]
        self._folder = Path(tempfile.mkdtemp(prefix="dgl-worker-"))
        self._log, self._log_read = self._folder / "log", 0
        print_to(self._log)
        self._bench = Workbench(work)

    def place(self) -> str:
        """Return Ray's id of the node."""
        import ray

        return ray.get_runtime_context().get_node_id()

    def build(self) -> Parcel:
        """Make the job runner."""
        return self._pack(self._bench.build(), {})

    def do(self, job: Job, out_dir: Path | None) -> Parcel:
        """Do a job; its files go to a folder that every node sees, or travel back when None."""
        if out_dir is not None:
            return self._pack(self._bench.do(job, out_dir), {})
        own = self._folder / "job"
        try:
            answer = self._bench.do(job, own)
            files = {path.name: path.read_bytes() for path in own.glob("*") if path.is_file()}
            return self._pack(answer, files)
        finally:
            shutil.rmtree(own, ignore_errors=True)

    def close(self) -> None:
        """Release the job runner."""
        self._bench.close()
        shutil.rmtree(self._folder, ignore_errors=True)

    def _pack(self, answer: Answer, files: Mapping[str, bytes]) -> Parcel:
        with self._log.open("rb") as file:
            file.seek(self._log_read)
            printed = file.read()
        self._log_read += len(printed)
        return Parcel(answer=answer, files=files, printed=printed)


class RayWorker(Worker):
    """An actor, as the run sees it."""

    def __init__(self, number: int, engine: "RayEngine", actor: Any, log_path: Path) -> None:
        super().__init__(number)
        self.pending: Any = actor.place.remote()
        """Reference of the awaited answer, or None."""
        self.node = ""
        """Ray's id of the actor's node; empty until it runs."""
        self._engine, self._actor, self._log_path = engine, actor, log_path
        self._out_dir = Path()
        self._released: Any = None

    def _send(self, job: Job, out_dir: Path) -> None:
        self._out_dir = out_dir
        shared = out_dir.resolve() if self._engine.shared_out else None
        self.pending = self._actor.do.remote(job, shared)

    def take(self, sent: Any) -> Answer | None:
        """Take what the actor has sent: its node, or a parcel, whose files are written."""
        self.pending = None
        if not isinstance(sent, Parcel):
            self.node, self.since = sent, time.monotonic()
            self.pending = self._actor.build.remote()
            return None
        with self._log_path.open("ab") as file:
            file.write(sent.printed)
        for name, content in sent.files.items():
            write_bytes(self._out_dir / Path(name).name, content)
        return sent.answer

    def release(self) -> None:
        """Let an idle worker end."""
        self._released = self._actor.close.remote()

    def kill(self) -> None:
        """End the actor."""
        import ray

        if self._engine.is_gone:
            return  # Ray would wait for it
        if self._released is not None:
            ray.wait([self._released], timeout=CLOSE_SECONDS)
        ray.kill(self._actor)


class RayEngine:
    """Starts actors on a Ray cluster."""

    def __init__(self, workers: Workers) -> None:
        """Connect to the cluster, or start one of this machine alone.

        Raises:
            EngineError: If Ray is not installed, or there is no cluster at the address.
        """
        ray = import_ray()
        from ray._private import ray_constants

        # Else Ray starts its workers by `uv run` if this process was. The environment variable of
        # that name would be too late for a program that has imported Ray itself.
        ray_constants.RAY_ENABLE_UV_RUN_RUNTIME_ENV = False
        self.shared_out = workers.shared_out
        self.is_gone = False
        """True once the head of the cluster has not answered for a while."""
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            with _signals_kept():
                _connect(ray, workers)
        self._head = ray.get_runtime_context().gcs_address
        self._seen = self._knocked = time.monotonic()
        self._remote = ray.remote(RemoteWorker).options(
            num_cpus=1,
            max_restarts=0,
            scheduling_strategy="SPREAD",
            runtime_env={"env_vars": ENVIRONMENT},
        )

    def start(self, number: int, work: Work, log_path: Path) -> RayWorker:
        """Ask for an actor; it runs once the cluster has a processor for it."""
        actor = self._remote.remote(work, list(sys.path))
        return RayWorker(number, self, actor, log_path)

    def hear(self, workers: Sequence[Worker], seconds: float) -> list[tuple[Worker, Answer]]:
        """Wait for an answer."""
        import ray
        from ray.exceptions import ObjectLostError, RayActorError, RaySystemError, RayTaskError

        self._check_head()
        waiting = {w.pending: w for w in workers if isinstance(w, RayWorker) and w.pending}
        if not waiting:
            time.sleep(seconds)
            return []
        ready, _ = ray.wait(list(waiting), timeout=seconds)
        if not ready:
            return []
        worker = waiting[ready[0]]
        try:
            answer = worker.take(ray.get(ready[0]))
        except (RayActorError, ObjectLostError) as err:
            answer = Lost(how=_first_line(err))
            if worker.node and not _is_alive(ray, worker.node):
                answer = Lost(how="its node was lost", cause="machine")
        except RayTaskError as err:  # the result could not be pickled, say
            answer = Lost(how=_first_line(err.cause or err))
        except RaySystemError as err:
            raise WorkerError(f"the Ray cluster is gone: {_first_line(err)}") from err
        return [(worker, answer)] if answer is not None else []

    def close(self) -> None:
        """Leave the cluster; end it if it was started here."""
        import ray

        if self._is_ours and not self.is_gone:
            ray.shutdown()

    def _check_head(self) -> None:
        """Check that the head answers, every few seconds; raise WorkerError if it is gone."""
        now = time.monotonic()
        if now - self._knocked < KNOCK_SECONDS:
            return
        self._knocked = now
        try:
            _knock(self._head)
            self._seen = now
        except OSError as err:
            if now - self._seen > GONE_SECONDS:
                self.is_gone = True
                raise WorkerError(
                    f"the Ray cluster is gone: its head at {self._head}: {_first_line(err)}"
                ) from err


def import_ray() -> Any:
    """Import Ray.

    Raises:
        EngineError: If it is not installed.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    try:
        import ray
    except ImportError as err:
        raise EngineError(
            "engine ray needs Ray, which is not installed: uv sync --all-packages --extra ray, "
            "or pip install ray"
        ) from err
    return ray


def check_reachable(address: str | None) -> None:
    """Check quickly that Ray is installed, and that a cluster answers at its address.

    Raises:
        EngineError: If Ray is not installed, or nothing answers.
    """
    ray = import_ray()
    try:
        if address is not None and (head := _knock(address)):
            ray._raylet.GcsClient(address=head)  # noqa: SLF001 - another service may answer there
    except (OSError, ray.exceptions.RpcError) as err:
        raise EngineError(f"there is no Ray cluster at {address!r}: {_first_line(err)}") from err


@contextmanager
def _signals_kept() -> Iterator[None]:
    """Keep this process's signal handlers, which Ray replaces by one that ends it at once."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in numbers}
    try:
        yield
    finally:
        if threading.current_thread() is threading.main_thread():
            for number, handler in before.items():
                if handler is not None:
                    signal.signal(number, handler)


def _connect(ray: Any, workers: Workers) -> None:
    """Connect to the cluster of a run, or start one."""
    check_reachable(workers.address)
    where = {"num_cpus": workers.count, "include_dashboard": False}
    if workers.address is not None:
        where = {"address": workers.address}
    try:
        ray.init(log_to_driver=False, logging_level=logging.ERROR, **where)
    except (OSError, RuntimeError, ValueError) as err:
        place = "on this machine" if workers.address is None else f"at {workers.address!r}"
        raise EngineError(f"there is no Ray cluster {place}: {_first_line(err)}") from err


def _knock(address: str) -> str | None:
    """Connect to an address once; Ray itself would try for five minutes.

    Returns:
        The host and port that answered; None for an address of another form.

    Raises:
        OSError: If nothing answers, or no address is known for "auto".
    """
    if address == "auto":
        from ray._private.services import get_ray_address_from_environment

        address = get_ray_address_from_environment(address, None)
    host, _, port = address.rpartition(":")
    if host and port.isdecimal() and "/" not in host:
        socket.create_connection((host, int(port)), timeout=CONNECT_SECONDS).close()
        return address
    return None


def _is_alive(ray: Any, node: str) -> bool:
    return any(entry["NodeID"] == node and entry["Alive"] for entry in ray.nodes())


def _first_line(err: BaseException) -> str:
    text = str(err).strip()
    return text.splitlines()[0] if text else type(err).__name__
