"""Garments by what people call them: an id of the catalogue, or the folder of one of their own."""

from pathlib import Path

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.garments.catalogue import list_categories, load_garment
from dgl_assets.garments.garment import Garment
from dgl_assets.importing.asset_folder import load_asset
from dgl_assets.importing.imported import ImportedGarment
from dgl_assets.importing.source import META_FILE

__all__ = ["AnyGarment", "find_garment"]

AnyGarment = Garment | ImportedGarment
"""A garment of the catalogue, or an imported one."""


def find_garment(source: str | Path) -> AnyGarment:
    """Make a garment of the catalogue, or load an imported one.

    Args:
        source: An id, such as "Tops_LongSleeve/000123", or the folder of an imported garment.

    Raises:
        ValueError: If it is neither a text nor a path.
        AssetNotFoundError: If there is no such garment.
        UnreadableFileError: If the files of an imported one are broken.
    """
    if not isinstance(source, (str, Path)):
        raise ValueError(
            f"a garment must be an id, such as Tops_LongSleeve/000123, or a folder; got {source!r}"
        )
    path = Path(source)
    if (path / META_FILE).is_file():
        return load_asset(path)
    is_id = isinstance(source, str) and source.partition("/")[0] in list_categories()
    if is_id and not path.exists():
        return load_garment(str(source))
    if path.exists():
        raise AssetNotFoundError(
            f"{path} is not the folder of an imported garment; `dgl assets import` makes one of a "
            "mesh file"
        )
    raise AssetNotFoundError(
        f"there is no garment {str(source)!r}: neither an id, such as Tops_LongSleeve/000123, nor "
        "a folder that is there; "
        "`dgl assets import` and `dgl collect --garment` make folders of mesh files"
    )
