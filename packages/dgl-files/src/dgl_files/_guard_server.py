"""Child side of the guard: a server that forks one process for each reader, with limits.

It is run as a script and imports only the standard library and numpy before it is asked to read.
"""

import contextlib
import dataclasses
import importlib
import json
import math
import os
import resource
import signal
import sys
from pathlib import Path
from typing import Any

import numpy as np

RESULT_FILE, ERROR_FILE = "result.npz", "error.json"
CLOCK_FACTOR = 4
"""Longest time by the clock over the longest processor time; machines are busy."""
_MAX_TEXT = 2000  # characters of an error


def serve() -> None:
    """Answer requests on stdin, one JSON object a line, with exit codes on stdout."""
    silent = os.open(os.devnull, os.O_RDWR)
    requests, replies = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    for stream in (0, 1, 2):
        os.dup2(silent, stream)
    for line in requests:
        request = json.loads(line)
        with contextlib.suppress(Exception):  # told by the child, which meets it again
            importlib.import_module(request["module"])  # once for all children
        child = os.fork()
        if child == 0:
            replies.close()
            requests.close()
            _run(request)
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        replies.write(f"{code}\n")
        replies.flush()


def _run(request: dict[str, Any]) -> None:
    """Read one file, write the result or the error into the request's folder, and exit."""
    folder = Path(request["folder"])
    os.environ["TMPDIR"] = str(folder)
    memory, seconds = int(request["gigabytes"] * 2**30), request["seconds"]
    for kind, limit in (
        (resource.RLIMIT_AS, memory),
        (resource.RLIMIT_FSIZE, memory),
        (resource.RLIMIT_CPU, math.ceil(seconds)),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(
            kind, (limit if hard == resource.RLIM_INFINITY else min(limit, hard), hard)
        )
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.setitimer(signal.ITIMER_REAL, CLOCK_FACTOR * seconds)  # its signal ends the process
    try:
        function = getattr(importlib.import_module(request["module"]), request["name"])
        write_result(folder / RESULT_FILE, function(*request["arguments"]))
    except BaseException as err:
        kind = "MemoryError" if isinstance(err, MemoryError) else type(err).__name__
        text = json.dumps({"kind": kind, "text": str(err)[:_MAX_TEXT]})
        (folder / ERROR_FILE).write_text(text)
    finally:
        os._exit(0)


def write_result(path: Path, value: Any) -> None:
    """Write plain values, arrays, bytes, paths and dataclasses into an NPZ file without pickles."""
    arrays: dict[str, np.ndarray] = {}

    def flatten(item: Any) -> Any:
        if dataclasses.is_dataclass(item):
            return {f.name: flatten(getattr(item, f.name)) for f in dataclasses.fields(item)}
        if isinstance(item, Path):
            return str(item)
        if isinstance(item, dict):
            if any(not isinstance(key, str) or key.startswith("$") for key in item):
                raise TypeError("keys of a result must be texts that do not begin with $")
            return {key: flatten(part) for key, part in item.items()}
        if isinstance(item, (list, tuple)):
            return [flatten(part) for part in item]
        if isinstance(item, (np.ndarray, bytes)):
            name, kind = f"a{len(arrays)}", "$bytes" if isinstance(item, bytes) else "$array"
            arrays[name] = np.frombuffer(item, np.uint8) if isinstance(item, bytes) else item
            return {kind: name}
        return item

    tree = json.dumps(flatten(value)).encode()
    with path.open("wb") as file:
        np.savez(file, allow_pickle=False, tree=np.frombuffer(tree, np.uint8), **arrays)


def read_result(path: Path) -> Any:
    """Read what `write_result` wrote; lists, texts and dictionaries come back for the others."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}

    def restore(item: dict[str, Any]) -> Any:
        if set(item) == {"$array"}:
            return arrays[item["$array"]]
        if set(item) == {"$bytes"}:
            return arrays[item["$bytes"]].tobytes()
        return item

    return json.loads(arrays.pop("tree").tobytes(), object_hook=restore)


if __name__ == "__main__":
    here = Path(__file__).parent  # its modules must not stand for others of their names
    sys.path[:] = [path for path in sys.path if Path(path) != here]
    serve()
