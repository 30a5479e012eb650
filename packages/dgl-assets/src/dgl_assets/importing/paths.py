"""Paths that files and archives refer to stay within their own folder; what a file is, is told by its content."""

from __future__ import annotations

import json
import math
from pathlib import Path, PurePosixPath, PureWindowsPath
from urllib.parse import unquote

from dgl_assets.importing.bounds import MAX_DIGITS, MAX_FILE_BYTES
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError

TEXTURE_HINT = ", or import without pictures: `use_textures=False`"
"""Way out when a picture cannot be had."""

KINDS: dict[str, str] = {
    ".obj": "obj",
    ".ply": "ply",
    ".stl": "stl",
    ".glb": "glb",
    ".gltf": "gltf",
    ".usd": "usd",
    ".usda": "usd",
    ".usdc": "usd",
    ".usdz": "usdz",
    ".zip": "zip",
}
"""Kind of file that each suffix promises."""


def resolve_reference(
    folder: Path, reference: str, *, named_by: str, root: Path | None = None, hint: str = ""
) -> Path:
    """Find a file that another one refers to.

    Args:
        folder: Folder of the file that refers.
        reference: What it says.
        named_by: Name of the file that refers, for messages.
        root: Folder that the reference must not leave; `folder` by default. Models and archives have pictures
            beside the folder of the mesh.
        hint: Way out, for messages.

    Returns:
        Path of an existing file inside the root.

    Raises:
        UnsafePathError: If the reference is absolute, has a drive or a scheme, or leads out of the root.
        UnreadableFileError: If there is no such file.
    """
    text = unquote(reference.strip()).replace("\\", "/")
    path = PurePosixPath(text)
    goes_up = root is None and ".." in path.parts
    is_outside = path.is_absolute() or goes_up or "\0" in text or "://" in text
    if is_outside or PureWindowsPath(reference).drive or text.startswith("file:"):
        raise UnsafePathError(
            f"{named_by} refers to {reference[:120]!r}, which is not inside its own folder; put the file beside it"
            + hint
        )
    target = folder / path
    try:
        is_file = target.is_file()
    except (OSError, ValueError) as err:
        raise UnsafePathError(
            f"{named_by} refers to {reference[:120]!r}, which is no usable path"
        ) from err
    if not is_inside(target, folder if root is None else root):
        raise UnsafePathError(
            f"{named_by} refers to {reference[:120]!r}, which leads out of its own folder (a link?)"
        )
    if not text or not is_file:
        raise UnreadableFileError(
            f"{named_by} refers to {reference[:120]!r}, which does not exist; add it{hint}"
        )
    return target


def is_inside(path: Path, folder: Path) -> bool:
    """Say whether a path, all links followed, lies in a folder; links in a circle lie nowhere."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):
        return False


def read_bytes(path: Path) -> bytes:
    """Read a whole file, if its size is within the limit.

    Raises:
        UnreadableFileError: If it is missing, empty, no plain file, unreadable or too large.
    """
    try:
        if not path.is_file():
            raise UnreadableFileError(f"{path} is not a file")
        size = path.stat().st_size
        if size == 0:
            raise UnreadableFileError(f"{path.name} is empty")
        if size > MAX_FILE_BYTES:
            raise UnreadableFileError(
                f"{path.name} has {size:,} bytes; at most {MAX_FILE_BYTES:,} are read"
            )
        return path.read_bytes()
    except OSError as err:
        raise UnreadableFileError(f"{path} cannot be read: {err.strerror or err}") from err


def detect_kind(path: Path, data: bytes) -> str:
    """Tell what a file is from its content, and check that its name agrees.

    Args:
        path: Of the file.
        data: The whole file.

    Returns:
        One of "obj", "ply", "stl", "glb", "gltf", "usd", "usdz", "zip".

    Raises:
        UnreadableFileError: If the content is none of these, or another one than the name says.
    """
    named = KINDS.get(path.suffix.lower())
    found = _sniff(data, named)
    if found == "zip" and named == "usdz":
        found = "usdz"
    if found is None:
        known = ", ".join(sorted(KINDS))
        raise UnreadableFileError(
            f"{path.name} holds no mesh of a known kind ({known}); it begins with {data[:16]!r}"
        )
    if named is not None and named != found:
        raise UnreadableFileError(
            f"{path.name} is named like {named} but its content is {found}; rename it"
        )
    return found


def _sniff(data: bytes, named: str | None) -> str | None:
    head = data[:512].lstrip(b"\xef\xbb\xbf \t\r\n")
    if data[:4] == b"glTF":
        return "glb"
    if head[:4] in (b"ply\n", b"ply\r"):
        return "ply"
    if data[:8] == b"PXR-USDC" or head[:5] == b"#usda":
        return "usd"
    if data[:4] in (b"PK\x03\x04", b"PK\x05\x06"):
        return "zip"
    if head[:1] == b"{":
        return "gltf"
    if len(data) >= 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        return "stl"
    if head[:5].lower() == b"solid" and b"facet" in data[:4096]:
        return "stl"
    if b"\0" not in data[:4096]:
        lines = data[:65536].splitlines()
        starts = [line.split(maxsplit=1)[0] for line in lines if line.strip()]
        if any(start in (b"v", b"f", b"vt", b"vn", b"o", b"mtllib") for start in starts):
            return "obj"
    if named == "stl":  # neither form is whole; the reader says what is missing
        return "stl"
    return None


def read_json(path: Path) -> object:
    """Read a JSON file.

    Raises:
        UnreadableFileError: If it is not JSON.
    """
    return parse_json(read_bytes(path), str(path))


def parse_json(data: bytes, name: str) -> object:
    """Parse JSON: finite numbers and text that can be written again.

    Raises:
        UnreadableFileError: If it is not JSON, nested too deep, or holds what no program here can use.
    """
    try:
        tree = json.loads(
            data.decode("utf-8-sig"),
            parse_int=_read_whole,
            parse_float=_read_number,
            parse_constant=_refuse_constant,
        )
        if b"\\u" in data:  # half of a pair of surrogates cannot be written
            json.dumps(tree, ensure_ascii=False).encode()
    except UnicodeEncodeError as err:
        raise UnreadableFileError(f"{name} holds text that is not Unicode: {err.reason}") from err
    except (ValueError, RecursionError) as err:
        raise UnreadableFileError(f"{name} is not valid JSON: {str(err)[:120]}") from err
    return tree


def _read_whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise ValueError(f"a number has {len(text)} digits, at most {MAX_DIGITS} are read")
    return int(text)


def _read_number(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text[:40]} is beyond what can be computed with")
    return number


def _refuse_constant(text: str) -> float:
    raise ValueError(f"{text} is no number of JSON")
