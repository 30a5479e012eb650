"""Errors of robots that cannot be imported or loaded; each message is one line."""

from dgl_assets.importing.errors import AssetImportError


class RobotImportError(AssetImportError):
    """Raised when a robot description cannot be used; names the file, the line and the remedy."""
