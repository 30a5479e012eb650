"""Unpack a zip archive that may be hostile."""

from __future__ import annotations

import lzma
import stat
import struct
import zipfile
import zlib
from pathlib import Path, PurePosixPath, PureWindowsPath

from dgl_assets.importing.bounds import (
    MAX_BUFFER_BYTES,
    MAX_MEMBERS,
    MAX_NAME_BYTES,
    check_count,
)
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_assets.importing.paths import read_bytes

_BLOCK = 1 << 20
_ENTRY = b"PK\x01\x02"  # begins the entry of each member; other data may hold it by chance
_LONGEST_PATH = 1000  # bytes


def unpack(archive: Path, folder: Path) -> None:
    """Unpack an archive into an empty folder.

    Args:
        archive: A zip file.
        folder: Where to; it exists.

    Raises:
        UnsafePathError: If a member is absolute, leads out of the folder, or is a link.
        UnreadableFileError: If the archive is broken, encrypted, or larger unpacked than the limits.
    """
    name = archive.name
    check_count(read_bytes(archive).count(_ENTRY), 10 * MAX_MEMBERS, "members", name)
    try:
        with zipfile.ZipFile(archive) as source:
            members = source.infolist()
            targets = _check(name, members)
            left = MAX_BUFFER_BYTES
            for member, inside in zip(members, targets, strict=True):
                target = folder / inside
                if member.is_dir():
                    target.mkdir(parents=True, exist_ok=True)
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                with source.open(member) as stream, target.open("xb") as file:
                    while block := stream.read(_BLOCK):
                        left -= len(block)  # what headers claim may be a lie
                        if left < 0:
                            raise UnreadableFileError(
                                f"{name} unpacks to more than {MAX_BUFFER_BYTES:,} bytes"
                            )
                        file.write(block)
    except (
        zipfile.BadZipFile,
        zlib.error,
        lzma.LZMAError,
        struct.error,
        ArithmeticError,
        EOFError,
        IndexError,
        NotImplementedError,
        RuntimeError,
        ValueError,
    ) as err:
        raise UnreadableFileError(
            f"{name} is no whole zip archive ({type(err).__name__}: {str(err)[:120]})"
        ) from err
    except OSError as err:  # of damaged bzip2, too
        raise UnreadableFileError(
            f"{name} cannot be unpacked: {err.strerror or 'a member is damaged'}"
        ) from err


def _check(name: str, members: list[zipfile.ZipInfo]) -> list[PurePosixPath]:
    """Check every member; return where each goes in the folder."""
    check_count(len(members), MAX_MEMBERS, "members", name)
    claimed = sum(member.file_size for member in members)
    if claimed > MAX_BUFFER_BYTES:
        raise UnreadableFileError(
            f"{name} unpacks to {claimed:,} bytes; at most {MAX_BUFFER_BYTES:,} are unpacked"
        )
    paths = [PurePosixPath(member.filename.replace("\\", "/")) for member in members]
    files: set[PurePosixPath] = set()
    for member, path in zip(members, paths, strict=True):
        said = repr(member.filename[:120])
        has_drive = bool(PureWindowsPath(member.filename).drive)
        if path.is_absolute() or ".." in path.parts or has_drive or not path.parts:
            raise UnsafePathError(f"{name} holds the path {said}, which leads out of it")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise UnsafePathError(f"{name} holds the link {said}")
        if member.flag_bits & 1:
            raise UnreadableFileError(f"{name} is encrypted: {said}")
        longest = max(len(part.encode("utf-8", "replace")) for part in path.parts)
        if longest > MAX_NAME_BYTES or len(str(path).encode("utf-8", "replace")) > _LONGEST_PATH:
            raise UnreadableFileError(
                f"{name} holds a name of {len(member.filename):,} characters, which begins {said}; at most "
                f"{MAX_NAME_BYTES} bytes are written"
            )
        if path in files:
            raise UnreadableFileError(f"{name} holds the name {said} twice; pack it again")
        if not member.is_dir():
            files.add(path)
    for path in paths:
        if any(parent in files for parent in path.parents):
            raise UnreadableFileError(
                f"{name} holds {str(path)[:120]!r} inside of what is a file there; pack it again"
            )
    return paths
