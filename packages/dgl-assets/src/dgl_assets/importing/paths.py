"""Read files, find their kind by their content, and keep references within their folder."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath
from urllib.parse import unquote

from dgl_assets.importing.bounds import MAX_FILE_BYTES
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_files.fields import decode_json

TEXTURE_HINT = ", or import without pictures: `textures=False`"
"""Remedy where a picture cannot be read."""

_HEAD = 65536  # bytes that tell the kind of a file
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
"""Kind of file by suffix."""


def resolve_reference(
    folder: Path, reference: str, *, named_by: str, root: Path | None = None, hint: str = ""
) -> Path:
    """Find a file that another one refers to.

    Args:
        folder: Folder of the file that refers.
        reference: Its text.
        named_by: Name of the file that refers, for messages.
        root: Folder that the reference must not leave; `folder` by default. Archives may have
            pictures beside the folder of the mesh.
        hint: Remedy, for messages.

    Returns:
        Path of an existing file inside the root.

    Raises:
        UnsafePathError: If the reference is absolute, has a drive or a scheme, or leaves the root.
        UnreadableFileError: If there is no such file.
    """
    text = unquote(reference.strip()).replace("\\", "/")
    path = PurePosixPath(text)
    goes_up = root is None and ".." in path.parts
    is_outside = path.is_absolute() or goes_up or "\0" in text or "://" in text
    if is_outside or PureWindowsPath(reference).drive or text.startswith("file:"):
        raise UnsafePathError(
            f"{named_by} refers to {reference[:120]!r}, which is not inside its own folder; put "
            "the file beside it" + hint
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
    """Test that a path, all links followed, lies in a folder; links in a circle lie nowhere."""
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):
        return False


def check_file(path: Path) -> int:
    """Check that a path is a plain file within the limit; return its size [bytes].

    Raises:
        UnreadableFileError: If it is missing, empty, no plain file, or too large.
    """
    try:
        size = path.stat().st_size if path.is_file() else -1
    except OSError as err:
        raise UnreadableFileError(f"{path} cannot be read: {err.strerror or err}") from err
    if size < 0:
        raise UnreadableFileError(f"{path} is not a file")
    if size == 0:
        raise UnreadableFileError(f"{path.name} is empty")
    if size > MAX_FILE_BYTES:
        raise UnreadableFileError(
            f"{path.name} has {size:,} bytes; at most {MAX_FILE_BYTES:,} are read"
        )
    return size


def read_bytes(path: Path) -> bytes:
    """Read a whole file, if it is a plain one within the limit.

    Raises:
        UnreadableFileError: If it is missing, empty, no plain file, unreadable or too large.
    """
    check_file(path)
    try:
        return path.read_bytes()
    except OSError as err:
        raise UnreadableFileError(f"{path} cannot be read: {err.strerror or err}") from err


def detect_kind(path: Path) -> str:
    """Find the kind of a file by its content, and check that its name agrees.

    Returns:
        One of "obj", "ply", "stl", "glb", "gltf", "usd", "usdz", "zip".

    Raises:
        UnreadableFileError: If the content is none of these, or another one than the name says.
    """
    named = KINDS.get(path.suffix.lower())
    size = check_file(path)
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except OSError as err:
        raise UnreadableFileError(f"{path} cannot be read: {err.strerror or err}") from err
    found = _find_kind(head, size, named)
    if found == "zip" and named == "usdz":
        found = "usdz"
    if found is None:
        known = ", ".join(sorted(KINDS))
        raise UnreadableFileError(
            f"{path.name} holds no mesh of a known kind ({known}); it begins with {head[:16]!r}"
        )
    if named is not None and named != found:
        raise UnreadableFileError(
            f"{path.name} is named like {named} but its content is {found}; rename it"
        )
    return found


def _find_kind(head: bytes, size: int, named: str | None) -> str | None:
    start = head[:512].lstrip(b"\xef\xbb\xbf \t\r\n")
    signs = {
        "glb": head[:4] == b"glTF",
        "ply": start[:4] in (b"ply\n", b"ply\r"),
        "usd": head[:8] == b"PXR-USDC" or start[:5] == b"#usda",
        "zip": head[:4] in (b"PK\x03\x04", b"PK\x05\x06"),
        "gltf": start[:1] == b"{",
        "stl": size == 84 + 50 * int.from_bytes(head[80:84], "little")
        or (start[:5].lower() == b"solid" and b"facet" in head[:4096]),
    }
    for kind, is_there in signs.items():
        if is_there:
            return kind
    if b"\0" not in head[:4096]:
        starts = [line.split(maxsplit=1)[0] for line in head.splitlines() if line.strip()]
        if any(word in (b"v", b"f", b"vt", b"vn", b"o", b"mtllib") for word in starts):
            return "obj"
    return named if named == "stl" else None  # neither form is whole; the reader says more


def read_json(path: Path) -> object:
    """Read a JSON file.

    Raises:
        UnreadableFileError: If it is not JSON.
    """
    return parse_json(read_bytes(path), str(path))


def parse_json(data: bytes, name: str) -> object:
    """Parse JSON with finite numbers.

    Raises:
        UnreadableFileError: If it is not JSON, too long, or nested too deep.
    """
    try:
        return decode_json(data.decode("utf-8-sig"))
    except ValueError as err:
        raise UnreadableFileError(f"{name} is not valid JSON: {str(err)[:120]}") from err
