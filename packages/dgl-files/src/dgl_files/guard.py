"""Read files of unknown origin in a child process with limits of time and memory."""

import atexit
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections.abc import Callable
from dataclasses import is_dataclass
from itertools import repeat
from pathlib import Path
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from dgl_files import _guard_server

__all__ = ["GuardError", "read_guarded"]

_SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "PXR_WORK_THREAD_LIMIT")


class GuardError(Exception):
    """Raised when a file cannot be read within the limits; one line that names the file."""


def read_guarded(
    reader: Callable[..., Any],
    *arguments: Any,
    file: str,
    seconds: float = 60.0,
    gigabytes: float = 4.0,
    errors: tuple[type[Exception], ...] = (),
    returns: Any = None,
) -> Any:
    """Call a reader in a child process.

    Args:
        reader: Function of a module that can be imported. It returns plain values, arrays, bytes,
            paths, dataclasses, and lists and dictionaries of them.
        *arguments: For the reader, as JSON holds them.
        file: Name of what is read, for messages.
        seconds: Longest processor time [s]; by the clock it may take four times as long.
        gigabytes: Largest address space of the child, and largest file that it writes [GiB].
        errors: Classes of exceptions that are raised here as the reader raised them, made of their
            text.
        returns: Type of the result where it holds dataclasses, tuples or paths, which are made
            again as it is annotated; plain values when None.

    Returns:
        The reader's result. It comes through a file without pickled objects.

    Raises:
        GuardError: If the reader exceeds a limit, crashes, or raises anything else.
    """
    with tempfile.TemporaryDirectory(prefix="dgl-read-") as name:
        folder = Path(name)
        request = {
            "module": reader.__module__,
            "name": reader.__name__,
            "arguments": arguments,
            "folder": str(folder),
            "seconds": seconds,
            "gigabytes": gigabytes,
        }
        code = _get_server().ask(request)
        problem = folder / _guard_server.ERROR_FILE
        if code in (-signal.SIGALRM, -signal.SIGXCPU):
            raise GuardError(f"{file} takes more than {seconds:g} s to read")
        if code == 0 and problem.is_file():
            error = json.loads(problem.read_text())
            if error["kind"] == "MemoryError":
                raise GuardError(f"{file} takes more than {gigabytes:g} GB of memory to read")
            for cls in errors:
                if cls.__name__ == error["kind"]:
                    raise cls(error["text"])
            text = " ".join(error["text"].split())[:300]
            raise GuardError(f"{file} cannot be read ({error['kind']}: {text})")
        try:
            result = _guard_server.read_result(folder / _guard_server.RESULT_FILE)
        except (OSError, KeyError, ValueError, zipfile.BadZipFile) as err:
            raise GuardError(f"{file} makes its reader crash ({_describe(code)})") from err
        return _rebuild(returns, result)


def _rebuild(kind: Any, value: Any) -> Any:
    """Make dataclasses, tuples and paths of plain values, as the annotation says."""
    if get_origin(kind) in (Union, UnionType):
        if value is None:
            return None
        (kind,) = (part for part in get_args(kind) if part is not type(None))
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: _rebuild(hints[name], part) for name, part in value.items()})  # pyright: ignore[reportCallIssue]
    if get_origin(kind) is tuple:
        parts = get_args(kind)
        return tuple(map(_rebuild, repeat(parts[0]) if parts[-1] is Ellipsis else parts, value))
    return Path(value) if kind is Path else value


def _describe(code: int) -> str:
    """Describe how a process ended."""
    with contextlib.suppress(ValueError):
        return signal.Signals(-code).name
    return f"exit code {code}"


class _Server:
    """A process that forks a child for each request, so that libraries are imported once."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self._lock = threading.Lock()
        search = os.pathsep.join(os.path.abspath(path) for path in sys.path)
        self._process = subprocess.Popen(
            [sys.executable, _guard_server.__file__],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": search, **dict.fromkeys(_SINGLE_THREADED, "1")},
            start_new_session=True,  # an interrupt of the terminal is for the parent alone
        )
        atexit.register(self.close)

    def is_usable(self) -> bool:
        return self.owner == os.getpid() and self._process.poll() is None

    def ask(self, request: dict[str, Any]) -> int:
        """Run a request; return the exit code of its process, negative for a signal."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with self._lock:
            try:
                self._process.stdin.write(json.dumps(request).encode() + b"\n")
                self._process.stdin.flush()
                return int(self._process.stdout.readline())
            except BaseException as err:  # of an interrupted request, the answer would come later
                self.close()
                if isinstance(err, (OSError, ValueError)):
                    raise GuardError("the process that reads files has ended") from err
                raise

    def close(self) -> None:
        atexit.unregister(self.close)
        if self.owner != os.getpid():
            return
        with contextlib.suppress(OSError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for stream in (self._process.stdin, self._process.stdout):
            with contextlib.suppress(OSError):
                if stream is not None:
                    stream.close()


_servers: list[_Server] = []
_starting = threading.Lock()


def _get_server() -> _Server:
    """Give the server of this process, started when it is first needed."""
    with _starting:
        if not (_servers and _servers[0].is_usable()):
            _servers[:] = [_Server()]
        return _servers[0]
