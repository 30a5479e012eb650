"""Checks of this machine: each part is tried, and a fix is named for each that fails."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Literal

__all__ = [
    "CHECKS",
    "Check",
    "check_cache",
    "check_disk",
    "check_python",
    "get_cache_folder",
    "run_checks",
    "run_probe",
]

PROBE_TIMEOUT_S = 240.0  # Warp compiles on its first run; a software renderer starts slowly.
MIN_FREE_BYTES = 1_000_000_000  # Compiled kernels, a few episodes and their videos.
MIN_PYTHON, END_PYTHON = (3, 10), (3, 13)

_FIX_RENDERING = (
    "install a Vulkan driver: the graphics card's own, or Mesa's software driver (Debian 13, "
    "Ubuntu 24.04 and newer: "
    "`apt-get install mesa-vulkan-drivers libvulkan1`; Debian 12: the same `-t "
    "bookworm-backports`, as its own Mesa "
    "22.3 is too old). In a checkout, `make setup` does it."
)
_FIX_INSTALL = (
    "install the packages again: `make setup` in a checkout, or `pip install --force-reinstall`"
)
_FIX_LIBRARY = (
    "install the missing system library; on Debian and Ubuntu `apt-get install libgl1 libglib2.0-0`"
)


@dataclass(frozen=True)
class Check:
    """Outcome of one check."""

    name: str
    """Key of `CHECKS`."""
    state: Literal["ok", "fail", "optional"]
    """`ok` works; `fail` does not work and `dgl demo` needs it; `optional` does not work and is not
    needed."""
    detail: str
    """Finding, in one line."""
    fix: str = ""
    """Remedy; empty when the part works."""

    def to_dict(self) -> dict[str, str]:
        """Return the fields as a dictionary of strings."""
        return asdict(self)


@dataclass(frozen=True)
class ProbeResult:
    """Outcome of a probe's process: facts when it worked, else an error."""

    facts: dict[str, object]
    error: str = ""


def run_probe(name: str, *, timeout_s: float = PROBE_TIMEOUT_S) -> ProbeResult:
    """Run one probe in a process of its own.

    Args:
        name: A key of `dexgarmentlab._probes.PROBES`.
        timeout_s: Time after which the process is ended [s].

    Returns:
        Its facts or its error. A process that crashes or hangs is an error too.
    """
    with tempfile.TemporaryDirectory(prefix="dgl-doctor-") as folder:
        path = Path(folder) / "result.json"
        command = [sys.executable, "-m", "dexgarmentlab._probes", name, str(path)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=timeout_s, check=False
            )
        except subprocess.TimeoutExpired:
            return ProbeResult({}, f"no answer within {timeout_s:.0f} s")
        if not path.exists():
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            return ProbeResult({}, f"the process ended with status {done.returncode}: {last}")
        result = json.loads(path.read_text(encoding="utf-8"))
    return ProbeResult(result.get("facts", {}), result.get("error", ""))


def check_python(version: tuple[int, int] | None = None) -> Check:
    """Check the Python version; this process's when None."""
    found = version or sys.version_info[:2]
    text = f"Python {found[0]}.{found[1]}"
    if MIN_PYTHON <= found < END_PYTHON:
        return Check("python", "ok", text)
    return Check(
        "python",
        "fail",
        text,
        "use Python 3.10, 3.11 or 3.12; `uv sync` in a checkout fetches one",
    )


def check_disk(folder: Path | None = None, *, needed_bytes: int = MIN_FREE_BYTES) -> Check:
    """Check the free disk space [bytes] where outputs go; the current folder when None."""
    where = folder or Path.cwd()
    free = shutil.disk_usage(where).free
    detail = f"{free / 1e9:.1f} GB free in {where}; {needed_bytes / 1e9:.1f} GB needed"
    if free >= needed_bytes:
        return Check("disk", "ok", detail)
    return Check("disk", "fail", detail, "free some space, or work in another folder")


def get_cache_folder() -> Path:
    """Return the folder of all caches: `$XDG_CACHE_HOME`, or `~/.cache`."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def check_cache() -> Check:
    """Check that the folder of all caches can be written."""
    folder = get_cache_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as err:
        return Check(
            "cache",
            "fail",
            f"{folder} cannot be written: {err.strerror}",
            "set XDG_CACHE_HOME to a folder that can be written to",
        )
    return Check("cache", "ok", f"{folder} can be written")


def check_probed(name: str) -> Check:
    """Check a part that `dgl demo` needs by its probe."""
    describe, fix = _PROBED[name]
    result = run_probe(name)
    if not result.error:
        return Check(name, "ok", describe(result.facts))
    if name == "packages" and "cannot open shared object file" in result.error:
        fix = _FIX_LIBRARY
    return Check(name, "fail", result.error, fix)


def _describe_warp(facts: dict[str, object]) -> str:
    obstacle = facts["slow_because"]
    code = f"without vector code, as {obstacle}" if obstacle else "in vector code"
    return f"Warp {facts['version']}, a kernel ran; cloth runs {code}"


_PROBED: dict[str, tuple[Callable[[dict[str, object]], str], str]] = {
    "packages": (
        lambda facts: ", ".join(f"{name} {version}" for name, version in facts.items()),
        _FIX_INSTALL,
    ),
    "rendering": (lambda facts: f"drawn by {facts['device']}", _FIX_RENDERING),
    "physics": (lambda facts: f"SAPIEN {facts['version']}, a ball falls", _FIX_INSTALL),
    "warp": (
        _describe_warp,
        f"{_FIX_INSTALL}; XDG_CACHE_HOME must name a folder that can be written to",
    ),
    "video": (lambda _: "H.264 written and read back", _FIX_INSTALL),
}
"""Parts by name: what is said of the probe's facts, and the remedy."""


def check_cuda() -> Check:
    """Check for a CUDA device that both Warp and PyTorch can use. Nothing needs one."""
    if not _has_nvidia_driver():
        return Check(
            "cuda",
            "optional",
            "no NVIDIA GPU with a driver; everything runs on the CPU",
            "none needed; with an NVIDIA GPU, its driver makes training faster",
        )
    result = run_probe("cuda")
    if result.error:
        fix = "update the NVIDIA driver, or install the PyTorch build for its CUDA version"
        return Check("cuda", "optional", result.error, fix)
    return Check("cuda", "ok", str(result.facts["devices"]))


CHECKS: dict[str, Callable[[], Check]] = {
    "python": check_python,
    "disk": check_disk,
    "cache": check_cache,
    **{name: partial(check_probed, name) for name in _PROBED},
    "cuda": check_cuda,
}


def run_checks(
    *, only: Sequence[str] = (), on_result: Callable[[Check], None] | None = None
) -> list[Check]:
    """Run checks, some at the same time, since each spends its time in a process of its own.

    Args:
        only: Names of the checks to run; all of them when empty.
        on_result: Called with each outcome as it arrives.

    Returns:
        The outcomes, in the order of `CHECKS`.

    Raises:
        ValueError: If a name is unknown.
    """
    unknown = sorted(set(only) - set(CHECKS))
    if unknown:
        raise ValueError(f"unknown check(s) {unknown}; the checks are {list(CHECKS)}")
    names = [name for name in CHECKS if not only or name in only]
    outcomes: dict[str, Check] = {}
    with ThreadPoolExecutor(max_workers=min(4, os.cpu_count() or 1)) as pool:
        futures = {pool.submit(CHECKS[name]): name for name in names}
        for future in as_completed(futures):
            outcomes[futures[future]] = future.result()
            if on_result is not None:
                on_result(future.result())
    return [outcomes[name] for name in names]


def _has_nvidia_driver() -> bool:
    return Path("/proc/driver/nvidia/version").exists() or shutil.which("nvidia-smi") is not None
