"""Bring your own garment: mesh files of other programs become assets of this one."""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

if TYPE_CHECKING:
    from dgl_assets.importing.asset_folder import load_asset as load_asset
    from dgl_assets.importing.categories import CATEGORIES as CATEGORIES
    from dgl_assets.importing.errors import AssetImportError as AssetImportError
    from dgl_assets.importing.errors import BrokenMeshError as BrokenMeshError
    from dgl_assets.importing.errors import UnclearGarmentError as UnclearGarmentError
    from dgl_assets.importing.errors import UnreadableFileError as UnreadableFileError
    from dgl_assets.importing.errors import UnsafePathError as UnsafePathError
    from dgl_assets.importing.find import AnyGarment as AnyGarment
    from dgl_assets.importing.find import find_garment as find_garment
    from dgl_assets.importing.imported import ImportedGarment as ImportedGarment
    from dgl_assets.importing.importer import LayFlat as LayFlat
    from dgl_assets.importing.importer import import_garment as import_garment
    from dgl_assets.importing.options import GarmentImportOptions as GarmentImportOptions
    from dgl_assets.importing.report import ImportReport as ImportReport
    from dgl_assets.importing.source import list_models as list_models

__all__, __getattr__ = export_lazily(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
