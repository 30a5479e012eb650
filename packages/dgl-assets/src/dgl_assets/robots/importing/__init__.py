"""Bring your own robot: arms and hands from URDF, usable by name in every task."""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

if TYPE_CHECKING:
    from dgl_assets.robots.errors import RobotImportError as RobotImportError
    from dgl_assets.robots.importing.importer import RobotReport as RobotReport
    from dgl_assets.robots.importing.importer import import_robot as import_robot
    from dgl_assets.robots.importing.library import list_robots as list_robots
    from dgl_assets.robots.importing.library import load_robot as load_robot
    from dgl_assets.robots.importing.options import RobotImportOptions as RobotImportOptions

__all__, __getattr__ = export_lazily(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
