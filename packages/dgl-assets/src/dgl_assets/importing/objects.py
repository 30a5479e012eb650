"""Choose one object of a file that holds several: by its name, or as a connected part."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from dgl_assets.importing.errors import UnclearGarmentError
from dgl_assets.importing.raw import RawMesh
from dgl_assets.importing.topology import compute_normals

_LISTED = 8
_PART = re.compile(r"(?:(?P<name>.*)/)?part(?P<number>[1-9][0-9]{0,5})", re.DOTALL)


def split_choice(choice: str | None, raw: RawMesh) -> tuple[str | None, int | None]:
    """Split a choice into the name of an object and the number of a connected part.

    Args:
        choice: A name of the file, "part2", or "name/part2"; None for all.
        raw: What was read.

    Returns:
        The name, and the number from 1; None for what is not chosen.
    """
    if choice is None or any(choice in names for names in raw.objects):
        return choice, None
    found = _PART.fullmatch(choice)
    return (choice, None) if found is None else (found["name"], int(found["number"]))


def choose_object(raw: RawMesh, name: str | None, file: str) -> RawMesh:
    """Keep the triangles of one object or group.

    Args:
        raw: What was read.
        name: Of the object or group; all is kept when None.
        file: Name of the file, for messages.

    Returns:
        The same vertices with fewer triangles.

    Raises:
        UnclearGarmentError: If the file has no such object; the message lists those that it has.
    """
    if name is None:
        return raw
    wanted = [index for index, names in enumerate(raw.objects) if name in names]
    keep = np.zeros(len(raw.faces), dtype=bool)
    if raw.object_ids is not None:
        keep = np.isin(raw.object_ids, wanted)
    if not keep.any():
        listed = list_objects(raw, np.arange(len(raw.faces)))
        has = f"it has {listed}" if listed else "it names no objects; parts are part1, part2, ..."
        raise UnclearGarmentError(f"{file} has no `object` {name[:60]!r}; {has}")
    return replace(
        raw,
        faces=raw.faces[keep],
        uvs=None if raw.uvs is None else raw.uvs[keep],
        object_ids=None if raw.object_ids is None else raw.object_ids[keep],
        notes=(*raw.notes, f"object {name} alone was taken, {keep.mean():.0%} of the faces"),
    )


def list_objects(raw: RawMesh, faces: np.ndarray) -> str:
    """List the objects of some triangles with their share of the area, largest first.

    The text is empty where the file names none.

    Args:
        raw: What was read.
        faces: Ids of the triangles, shape (N,), int.
    """
    if raw.object_ids is None or not len(faces):
        return ""
    _, areas = compute_normals(raw.vertices, raw.faces[faces])
    sums: dict[str, float] = {}
    shares = np.bincount(raw.object_ids[faces] + 1, areas, minlength=len(raw.objects) + 1)[1:]
    for names, share in zip(raw.objects, shares.tolist(), strict=True):
        for name in names[:2] if share else ():
            sums[name] = sums.get(name, 0.0) + share
    total = max(float(areas.sum()), 1e-300)
    ranked = sorted(sums, key=lambda name: -sums[name])
    text = ", ".join(f"{name[:40]} ({sums[name] / total:.1%})" for name in ranked[:_LISTED])
    return text + (", ..." if len(ranked) > _LISTED else "")
