"""Unpack a zip archive that may be hostile."""

from __future__ import annotations

import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath, PureWindowsPath

from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_assets.importing.raw import MAX_FILE_BYTES

MAX_MEMBERS = 2000
"""Most files in an archive."""
MAX_UNPACKED_BYTES = 2 * MAX_FILE_BYTES
"""Largest sum of unpacked files [bytes]."""
_BLOCK = 1 << 20


def unpack(archive: Path, folder: Path) -> None:
    """Unpack an archive into an empty folder.

    Args:
        archive: A zip file.
        folder: Where to; it exists.

    Raises:
        UnsafePathError: If a member is absolute, leads out of the folder, or is a link.
        UnreadableFileError: If the archive is broken, encrypted, or larger unpacked than the limits.
    """
    try:
        with zipfile.ZipFile(archive) as source:
            members = source.infolist()
            _check(archive.name, members)
            left = MAX_UNPACKED_BYTES
            for member in members:
                target = folder / PurePosixPath(member.filename.replace("\\", "/"))
                if member.is_dir():
                    target.mkdir(parents=True, exist_ok=True)
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                with source.open(member) as stream, target.open("xb") as file:
                    while block := stream.read(_BLOCK):
                        left -= len(block)  # what headers claim may be a lie
                        if left < 0:
                            raise UnreadableFileError(
                                f"{archive.name} unpacks to more than {MAX_UNPACKED_BYTES:,} bytes"
                            )
                        file.write(block)
    except (
        zipfile.BadZipFile,
        zlib.error,
        EOFError,
        OSError,
        NotImplementedError,
        RuntimeError,
    ) as err:
        raise UnreadableFileError(
            f"{archive.name} is no whole zip archive ({str(err)[:120]})"
        ) from err


def _check(name: str, members: list[zipfile.ZipInfo]) -> None:
    if len(members) > MAX_MEMBERS:
        raise UnreadableFileError(
            f"{name} has {len(members):,} members; at most {MAX_MEMBERS:,} are unpacked"
        )
    claimed = sum(member.file_size for member in members)
    if claimed > MAX_UNPACKED_BYTES:
        raise UnreadableFileError(
            f"{name} unpacks to {claimed:,} bytes; at most {MAX_UNPACKED_BYTES:,} are unpacked"
        )
    for member in members:
        path = PurePosixPath(member.filename.replace("\\", "/"))
        has_drive = bool(PureWindowsPath(member.filename).drive)
        if path.is_absolute() or ".." in path.parts or has_drive or not path.parts:
            raise UnsafePathError(
                f"{name} holds the path {member.filename[:120]!r}, which leads out of it"
            )
        if stat.S_ISLNK(member.external_attr >> 16):
            raise UnsafePathError(f"{name} holds the link {member.filename[:120]!r}")
        if member.flag_bits & 1:
            raise UnreadableFileError(f"{name} is encrypted: {member.filename[:120]!r}")
