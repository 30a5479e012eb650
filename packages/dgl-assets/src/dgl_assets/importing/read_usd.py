"""USD files, through Pixar's library, which is an extra of this package."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from dgl_assets.importing.bounds import MAX_FACES, MAX_VERTICES, check_size
from dgl_assets.importing.errors import (
    UnreadableFileError,
    UnsafePathError,
    describe_install,
)
from dgl_assets.importing.paths import TEXTURE_HINT, read_bytes, resolve_reference
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.textures import load_texture

_SECONDS = 120  # that reading may take
_WORKER = Path(__file__).parent / "_usd_worker.py"
_COMMAND = "import runpy, sys; runpy.run_path(sys.argv[1])['read_to_file'](*sys.argv[2:])"


def read_usd(path: Path, *, use_textures: bool, root: Path | None = None) -> RawMesh:
    """Read the meshes of a USD file (.usd, .usda, .usdc, .usdz) into one.

    Args:
        path: Of the file.
        use_textures: Whether to look for a picture; only those beside the file are read.
        root: Folder that references must not leave; that of the file by default.

    Raises:
        UnreadableFileError: If `usd-core` is not installed, or the file is broken or holds no mesh.
        UnsafePathError: If the file is composed of others: they could be anywhere.

    Limitations:
        Subdivision is not applied; the cage is the mesh. Pictures within a .usdz are not read.
    """
    places = [_find_package("pxr"), _find_package("numpy")]
    if places[0] is None:
        raise UnreadableFileError(
            f"{path.name} is USD, which needs the package usd-core: {describe_install('usd', 'usd-core')}"
        )
    search = os.pathsep.join(str(place) for place in places if place is not None)
    with tempfile.TemporaryDirectory(prefix="dgl-usd-") as folder:
        facts, arrays = _run(path, Path(folder), search)
    if facts["parts"]:
        raise UnsafePathError(
            f"{path.name} is composed of other files ({', '.join(facts['parts'])[:100]}); flatten it to one file"
        )
    if facts["problem"] is not None:
        raise UnreadableFileError(f"{path.name} cannot be read as USD: {facts['problem'][:160]}")
    check_size(len(arrays["vertices"]), len(arrays["faces"]), path.name)
    notes = []
    if facts["polygons"]:
        notes.append(
            f"{facts['polygons']} polygons of more than three corners were cut into triangles"
        )
    texture = None
    if use_textures and "uvs" in arrays:
        if facts["picture"] is None:
            notes.append("no picture; materials of other libraries are not read")
        else:
            target = resolve_reference(
                path.parent, facts["picture"], named_by=path.name, root=root, hint=TEXTURE_HINT
            )
            texture = load_texture(read_bytes(target), target.name)
    return RawMesh(
        vertices=arrays["vertices"],
        faces=arrays["faces"],
        uvs=arrays.get("uvs"),
        texture=texture,
        unit=facts["unit"],
        up=facts["up"],
        notes=tuple(notes),
        objects=tuple(tuple(names) for names in facts["objects"]),
        object_ids=arrays["object_ids"],
    )


def _find_package(name: str) -> Path | None:
    """Folder to search for a package, which the other process might not know."""
    try:
        spec = importlib.util.find_spec(name)
    except ValueError:  # made impossible to import
        return None
    return Path(spec.origin).parent.parent if spec is not None and spec.origin else None


def _run(path: Path, folder: Path, search: str) -> tuple[dict, dict[str, np.ndarray]]:
    """Read in another process: on some damaged files the library ends its own."""
    target = folder / "found.npz"
    words = [_COMMAND, _WORKER, path.resolve(), target, MAX_VERTICES, 4 * MAX_FACES]
    # Its reports of crashes go where they are removed.
    environment = {**os.environ, "TMPDIR": str(folder), "PYTHONPATH": search}
    try:
        done = subprocess.run(
            [sys.executable, "-c", *map(str, words)],
            capture_output=True,
            env=environment,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired as err:
        raise UnreadableFileError(f"{path.name} cannot be read as USD within {_SECONDS} s") from err
    try:
        with np.load(target, allow_pickle=False) as found:
            arrays = {name: found[name] for name in found.files}
        return json.loads(str(arrays.pop("facts"))), arrays
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as err:
        said = re.findall(r" in file \S+ : '(.{3,120})", done.stderr.decode("utf-8", "replace"))
        reason = " ".join(said[-1].split()) if said else f"its library ended with {done.returncode}"
        raise UnreadableFileError(
            f"{path.name} cannot be read as USD, it may be cut off ({reason})"
        ) from err
