"""Why a robot cannot be imported or loaded; each message is one line."""

from dgl_assets.importing.errors import AssetImportError


class RobotImportError(AssetImportError):
    """Raised when a robot description cannot be used: it names the file, the place and the remedy."""
