"""Write a folder that appears whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from dgl_assets.importing.errors import AssetImportError


@contextmanager
def stage_folder(target: Path, *, overwrite: bool, marker: str = "meta.json") -> Iterator[Path]:
    """Give a new folder beside the target, and move it there when the block ends well.

    Args:
        target: Folder to appear; parents are made.
        overwrite: Replace a folder that exists.
        marker: File by which a folder that may be replaced is known.

    Yields:
        An empty folder to write into. If the block fails or is interrupted, it is removed, with the
        parents that were made for it.

    Raises:
        AssetImportError: If the target exists and must not be replaced, or cannot be written.
    """
    check_target(target, overwrite=overwrite, marker=marker)
    made = [parent for parent in target.parents if not parent.exists()]
    staging: Path | None = None
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(
            tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".partial", dir=target.parent)
        )
        staging.chmod(0o755)
        yield staging
        if target.exists():
            old = Path(
                tempfile.mkdtemp(prefix=f".{target.name}.", suffix=".old", dir=target.parent)
            )
            target.rename(old / "asset")
            staging.rename(target)
            shutil.rmtree(old)
        else:
            staging.rename(target)
        staging = None
    except OSError as err:
        raise AssetImportError(f"{target} cannot be written: {err.strerror or err}") from err
    finally:
        if staging is not None:
            shutil.rmtree(staging, ignore_errors=True)
        if not target.exists():
            for parent in made:  # innermost first
                try:
                    parent.rmdir()
                except OSError:  # someone else has written there, or it was never made
                    break


def check_target(target: Path, *, overwrite: bool, marker: str = "meta.json") -> None:
    """Refuse a target that is there, unless it is an asset that may be replaced.

    Raises:
        AssetImportError: If it must not be written.
    """
    if not (target.exists() or target.is_symlink()):
        return
    if not overwrite:
        raise AssetImportError(
            f"{target} exists; choose another `name`, or replace it: `overwrite`"
        )
    if target.is_symlink() or not (target / marker).is_file():
        raise AssetImportError(f"{target} exists and is no asset; it is not overwritten")
