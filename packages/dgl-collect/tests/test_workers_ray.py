"""Workers on a Ray cluster: the same files as on one machine, whatever is lost on the way."""

import importlib.util
import json
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from dgl_collect import CollectConfig, EngineError, Limits, WorkerError, Workers, collect
from dgl_collect.results import read_results
from dgl_collect.workers import dispatch

HAS_RAY = importlib.util.find_spec("ray") is not None  # importing it takes a second
pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(300),
    pytest.mark.skipif(not HAS_RAY, reason="Ray is not installed"),
]


def start_cluster(**options):
    """Start a cluster of a head on this machine."""
    from ray.cluster_utils import Cluster

    return Cluster(initialize_head=True, head_node_args=options)


@pytest.fixture(scope="module")
def cluster():
    """A cluster of a head without processors and two nodes of one each, all on this machine."""
    cluster = start_cluster(num_cpus=0)
    for _ in range(2):
        cluster.add_node(num_cpus=1)
    yield cluster
    cluster.shutdown()


@pytest.fixture
def run(tmp_path, fakes, cluster):
    def go(out=tmp_path / "out", on_progress=None, **changes):
        settings = {
            "task": "FoldTops-v1",
            "episodes": 6,
            "attempt_factory": fakes.FACTORY,
            "workers": Workers(count=2, engine="ray", address=cluster.address),
        }
        config = CollectConfig(out=out, **(settings | changes))
        return collect(config, on_progress=on_progress)

    return go


@pytest.fixture
def local(run, tmp_path, fakes):
    """The files of the same run without Ray, by their paths."""
    out = tmp_path / "local"
    with pytest.MonkeyPatch.context() as patch:
        fakes.work_here(patch)
        run(out=out, workers=Workers())
    return files_of(out)


def files_of(out):
    return {
        str(path.relative_to(out)): path.read_bytes()
        for folder in ("episodes", "failed")
        for path in (out / folder).glob("*")
    }


def test_a_cluster_gives_the_files_of_one_machine(run, local, tmp_path):
    summary = run()
    assert summary.status == "complete"
    assert files_of(tmp_path / "out") == local
    log = "".join(path.read_text() for path in (tmp_path / "out/logs").glob("*.log"))
    assert all(f"attempt {index} speaks" in log for index in range(6))


def test_workers_may_write_where_every_node_sees_it(run, local, tmp_path, cluster):
    workers = Workers(count=2, engine="ray", address=cluster.address, shared_out=True)
    run(workers=workers)
    assert files_of(tmp_path / "out") == local


def test_a_killed_worker_loses_no_attempt(run, local, tmp_path):
    options = {"die_once_at": [0, 3], "marks": str(tmp_path)}
    assert run(options=options).attempted == 6
    assert files_of(tmp_path / "out") == local


def test_an_attempt_that_crashes_each_time_is_a_result_with_its_reason(run, tmp_path):
    summary = run(options={"exit_at": [1]})
    assert dict(summary.reasons)["worker crashed"] == 1
    assert ", 5 times (see logs/worker-" in read_results(tmp_path / "out/attempts.jsonl")[1].detail


def test_an_attempt_that_hangs_is_ended(run, tmp_path):
    run(episodes=2, options={"hang_at": [0]}, limits=Limits(job_seconds=6.0))
    late, fine = read_results(tmp_path / "out/attempts.jsonl")
    assert (late.reason, fine.reason == "time limit") == ("time limit", False)


def test_a_lost_node_loses_no_attempt(run, local, tmp_path, cluster):
    """The node goes while each worker is in the middle of an attempt; another one comes."""
    was_removed = False

    def remove(progress):
        nonlocal was_removed
        if len(progress.results) >= 2 and not was_removed:
            was_removed = True
            cluster.remove_node(next(iter(cluster.worker_nodes)), allow_graceful=False)
            cluster.add_node(num_cpus=1)

    summary = run(options={"seconds": 1.5}, on_progress=remove)
    assert was_removed
    assert (summary.status, summary.attempted) == ("complete", 6)
    assert "worker crashed" not in summary.reasons
    assert files_of(tmp_path / "out") == local


def test_more_workers_than_places_wait_and_are_told(run, cluster):
    told = []
    workers = Workers(count=3, engine="ray", address=cluster.address)
    run(
        workers=workers,
        options={"seconds": 0.5},
        on_progress=lambda progress: told.append(
            (progress.workers_ready, progress.workers_waiting)
        ),
    )
    assert (2, 1) in told


def test_nodes_with_other_packages_are_refused(run, monkeypatch):
    monkeypatch.setattr(dispatch, "package_versions", lambda: {"dgl-collect": "9.9"})
    with pytest.raises(WorkerError, match=r"has other packages: .*dgl-collect .* \(here 9\.9\)"):
        run()


@pytest.mark.parametrize("address", ["127.0.0.1:1", "auto"])
def test_a_cluster_that_is_not_there_is_told(run, tmp_path, monkeypatch, address):
    monkeypatch.setenv("RAY_ADDRESS", "127.0.0.1:1")
    with pytest.raises(EngineError, match=f"there is no Ray cluster at '{re.escape(address)}'"):
        run(workers=Workers(engine="ray", address=address))
    assert not (tmp_path / "out").exists()


def test_another_service_at_the_address_is_told(run, tmp_path):
    class Refuse(BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Refuse) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"127.0.0.1:{server.server_port}"
        with pytest.raises(EngineError, match=f"there is no Ray cluster at '{address}'"):
            run(workers=Workers(engine="ray", address=address))
        server.shutdown()
    assert not (tmp_path / "out").exists()


def start_run(fakes, out, address, *, episodes=6):
    """Start a run in a process of its own, and wait for two attempts."""
    command = [sys.executable, fakes.__file__, str(out), address, str(episodes)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for line in process.stdout:
        if line.strip().isdigit() and int(line) >= 2:
            break
    return process


def test_a_run_that_is_told_to_end_does_so(run, tmp_path, fakes, cluster):
    with start_run(fakes, tmp_path / "out", cluster.address) as process:
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) == 130
    assert 2 <= len(read_results(tmp_path / "out/attempts.jsonl")) < 6
    assert json.loads((tmp_path / "out/summary.json").read_text())["status"] == "interrupted"


def test_a_lost_head_is_told(tmp_path, fakes):
    own = start_cluster(num_cpus=2)
    try:
        with start_run(fakes, tmp_path / "out", own.address, episodes=1000) as process:
            own.head_node.kill_gcs_server()
            assert process.wait(timeout=100) == 1
            assert "the Ray cluster is gone: its head at " in process.stderr.read()
    finally:
        own.head_node.kill_all_processes()
    assert 2 <= len(read_results(tmp_path / "out/attempts.jsonl")) < 1000
    assert json.loads((tmp_path / "out/summary.json").read_text())["status"] == "failed"


def test_a_killed_run_goes_on(run, local, tmp_path, fakes, cluster):
    out = tmp_path / "out"
    with start_run(fakes, out, cluster.address) as process:
        process.send_signal(signal.SIGKILL)
    done = len(read_results(out / "attempts.jsonl"))
    assert 2 <= done < 6
    deadline = time.monotonic() + 60  # the cluster ends the actors of a driver that is gone
    while True:
        try:
            summary = run(resume=True, options={"seconds": 0.5})
            break
        except WorkerError:
            assert time.monotonic() < deadline
    assert (summary.status, summary.attempted) == ("complete", 6)
    assert files_of(out) == local
    shutil.rmtree(out)
