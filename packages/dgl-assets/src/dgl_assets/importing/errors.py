"""Errors of importing: one line each, with the file, the place and the remedy."""

from dgl_assets.errors import AssetError

_LONGEST = 600  # characters


class AssetImportError(AssetError):
    """Base of the errors of importing; the message is one printable line, whatever names it holds.

    Options that help are named as parameters in backquotes, such as `units`; the command line
    writes its flags in their place.
    """

    def __init__(self, message: str) -> None:
        super().__init__(make_printable(" ".join(message.split())[:_LONGEST]))


def make_printable(text: str) -> str:
    """Replace parts of names that are not UTF-8, which no encoding can write."""
    return text.encode("utf-8", "replace").decode("utf-8")


def describe_install(extra: str, package: str) -> str:
    """Give the command that installs an optional package.

    Args:
        extra: Extra of this package that has it.
        package: Its name.
    """
    return f"in a checkout uv sync --all-packages --extra {extra}, elsewhere pip install {package}"


class UnreadableFileError(AssetImportError):
    """Raised when a file is missing, cut off, too large, or not what it claims to be."""


class UnsafePathError(AssetImportError):
    """Raised when a file or an archive refers to a path outside its own folder."""


class BrokenMeshError(AssetImportError):
    """Raised when a surface is not one sheet of cloth: holes, branches, spikes, loose pieces."""


class UnclearGarmentError(AssetImportError):
    """Raised when category, unit or orientation cannot be told and have to be given."""
