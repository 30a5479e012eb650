"""Limits of files that are read, beside those of time and memory of the process that reads."""

from __future__ import annotations

from dgl_assets.importing.errors import UnreadableFileError

MAX_FILE_BYTES = 256 * 2**20
"""Largest file that is opened [bytes]."""
MAX_VERTICES = 1_000_000
"""Most vertices of a mesh that is imported; garments of games and films have 5,000 to 200,000."""
MAX_FACES = 2_000_000
"""Most triangles of a mesh that is imported."""
LARGEST_COORDINATE = 1e9
"""Largest position along an axis, in units of the file."""
MAX_LINES = 6_000_000
"""Most lines of a text file, those of the largest mesh."""
MAX_OBJECTS = 2000
"""Most objects and groups whose names are kept."""
MAX_PIXELS = 8192 * 8192
"""Largest picture that is read."""
MAX_BUFFER_BYTES = 2 * MAX_FILE_BYTES
"""Largest sum of what a file refers to or unpacks to [bytes]."""
MAX_MEMBERS = 2000
"""Most files in an archive."""
MAX_MODELS = 20_000
"""Most models below a folder."""
MAX_KEYPOINTS = 1000
"""Most named points of a garment."""
MAX_TEXT = 500
"""Longest name or text in a JSON file [characters]."""


def check_size(vertices: int, faces: int, name: str) -> None:
    """Refuse meshes beyond the limits, from the counts alone.

    Raises:
        UnreadableFileError: With counts and limits.
    """
    if vertices > MAX_VERTICES or faces > MAX_FACES:
        raise UnreadableFileError(
            f"{name} has {vertices:,} vertices and {faces:,} faces; at most {MAX_VERTICES:,} and "
            f"{MAX_FACES:,} "
            "are imported, so reduce it first"
        )


def check_count(count: int, most: int, what: str, name: str) -> None:
    """Refuse more items than a limit.

    Args:
        count: How many there are.
        most: How many are read.
        what: Kind of items, such as "lines".
        name: Name of the file.

    Raises:
        UnreadableFileError: With count and limit.
    """
    if count > most:
        raise UnreadableFileError(f"{name} has {count:,} {what}; at most {most:,} are read")


def check_lines(data: bytes, name: str) -> None:
    """Refuse text of too many lines, however they end.

    Raises:
        UnreadableFileError: With count and limit.
    """
    check_count(max(data.count(b"\n"), data.count(b"\r")), MAX_LINES, "lines", name)
