"""Built garments on disk: one archive each, of plain arrays and one JSON text."""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from dgl_assets._archive import read_archive, write_archive
from dgl_assets.errors import CacheError
from dgl_assets.garments.garment import Garment

GENERATOR_VERSION = 3
"""Increased whenever an id gives another garment; files of other versions are refused."""

_ARRAYS = ("vertices", "faces", "rest_vertices", "canonical", "face_panels")


def find_cached(folder: Path, garment_id: str) -> Garment | None:
    """Read a garment from a cache; None if it has not been built.

    Raises:
        CacheError: If the file is damaged, of another garment, or of another generator version.
    """
    path = _get_path(folder, garment_id)
    if not path.exists():
        return None
    try:
        arrays = read_archive(path, ("text", *_ARRAYS))
        text = bytes(arrays.pop("text")).decode()
        entry = json.loads(text)
        if entry["generator_version"] != GENERATOR_VERSION:
            raise CacheError(
                f"{path} is of version {entry['generator_version']} of the generator, expected "
                f"{GENERATOR_VERSION}; delete it to have it built again"
            )
        content = entry["garment"]
        content["panels"] = tuple(content["panels"])
        garment = Garment(**arrays, **content)
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as err:
        raise CacheError(f"{path} is damaged ({err}); delete it to have it built again") from err
    if garment.name != garment_id:
        raise CacheError(f"{path} must hold {garment_id}; got {garment.name}")
    return garment


def store_garment(folder: Path, garment: Garment) -> Path:
    """Write a garment into a cache and return the path; the file appears whole."""
    path = _get_path(folder, garment.name)
    content = {f.name: getattr(garment, f.name) for f in fields(garment) if f.name not in _ARRAYS}
    text = json.dumps({"generator_version": GENERATOR_VERSION, "garment": content})
    arrays = {name: getattr(garment, name) for name in _ARRAYS}
    write_archive(path, {"text": np.frombuffer(text.encode(), dtype=np.uint8), **arrays})
    return path


def _get_path(folder: Path, garment_id: str) -> Path:
    category, _, number = garment_id.partition("/")
    return Path(folder) / category / f"{number}.npz"
