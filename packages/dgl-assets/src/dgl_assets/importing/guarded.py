"""Call readers of other people's files in a child process with limits of time and memory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dgl_assets.importing.errors import AssetImportError, UnreadableFileError


def call_reader(reader: Callable[..., Any], *arguments: Any, file: str, returns: Any = None) -> Any:
    """Call a reader in a child process.

    Args:
        reader: Function of a module; it returns plain values, arrays, bytes, paths and dataclasses.
        *arguments: For the reader, as JSON holds them.
        file: Name of what is read, for messages.
        returns: Type of the result, see `read_guarded`.

    Raises:
        UnreadableFileError: If the reader takes too long, needs too much memory, or fails.
        AssetImportError: As the reader raised it.
    """
    from dgl_files.guard import GuardError, read_guarded

    try:
        return read_guarded(
            reader,
            *arguments,
            file=file,
            errors=tuple(AssetImportError.__subclasses__()),
            returns=returns,
        )
    except GuardError as err:
        raise UnreadableFileError(f"{err}; it may be damaged") from err
