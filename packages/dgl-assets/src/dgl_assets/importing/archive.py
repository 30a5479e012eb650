"""Unpack a zip archive that may be hostile."""

from __future__ import annotations

import stat
import zipfile
from pathlib import Path, PurePosixPath, PureWindowsPath

from dgl_assets.importing.bounds import MAX_BUFFER_BYTES, MAX_MEMBERS, check_count
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_assets.importing.guarded import call_reader
from dgl_assets.importing.paths import check_file

_BLOCK = 1 << 20
_LONGEST_PATH = 1000


def unpack(archive: Path, folder: Path) -> None:
    """Unpack an archive into an empty folder, in a child process.

    Args:
        archive: A zip file.
        folder: Folder to write into; it exists.

    Raises:
        UnsafePathError: If a member is absolute, leads out of the folder, or is a link.
        UnreadableFileError: If the archive is broken, encrypted, or too large when unpacked.
    """
    check_file(archive)
    call_reader(unpack_members, str(archive.absolute()), str(folder.absolute()), file=archive.name)


def unpack_members(archive: str, folder: str) -> None:
    """Unpack all members; `unpack` calls this in the child process."""
    name, left = Path(archive).name, MAX_BUFFER_BYTES
    with zipfile.ZipFile(archive) as source:
        members = source.infolist()
        check_count(len(members), MAX_MEMBERS, "members", name)
        check_count(sum(m.file_size for m in members), MAX_BUFFER_BYTES, "bytes unpacked", name)
        for member in members:
            target = Path(folder, _find_place(name, member))
            if member.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                with source.open(member) as stream, target.open("xb") as file:
                    while block := stream.read(_BLOCK):
                        left -= len(block)  # headers may claim too little
                        check_count(-left, 0, "bytes unpacked beyond the limit", name)
                        file.write(block)
            except FileExistsError as err:
                raise UnreadableFileError(
                    f"{name} holds the name {member.filename[:120]!r} twice; pack it again"
                ) from err
            except OSError as err:  # a name too long, a file where a folder is needed, or damage
                raise UnreadableFileError(
                    f"{name}: {member.filename[:120]!r} cannot be unpacked: "
                    f"{err.strerror or 'it is damaged'}"
                ) from err


def _find_place(name: str, member: zipfile.ZipInfo) -> PurePosixPath:
    """Find the place of a member in the folder; refuse one outside, a link, and encryption."""
    path, said = PurePosixPath(member.filename.replace("\\", "/")), repr(member.filename[:120])
    has_drive = bool(PureWindowsPath(member.filename).drive)
    if path.is_absolute() or ".." in path.parts or has_drive or not path.parts:
        raise UnsafePathError(f"{name} holds the path {said}, which leads out of it")
    if stat.S_ISLNK(member.external_attr >> 16):
        raise UnsafePathError(f"{name} holds the link {said}")
    if len(member.filename) > _LONGEST_PATH:
        raise UnreadableFileError(
            f"{name} holds a name of {len(member.filename):,} characters, {said}"
        )
    if member.flag_bits & 1:
        raise UnreadableFileError(f"{name} is encrypted: {said}")
    return path
