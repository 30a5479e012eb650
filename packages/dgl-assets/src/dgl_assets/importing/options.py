"""Options of importing a garment: one frozen dataclass from the command line to the importer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from annotated_types import Ge, Gt, Le

from dgl_assets.importing.categories import CATEGORIES
from dgl_files.fields import STRICT, check_fields


@dataclass(frozen=True, kw_only=True)
class GarmentImportOptions:
    """Options of an import; what is None is found out or assumed, with a note.

    The command line makes a flag of each field.

    Raises:
        ValueError: If a field is of another type or out of range.
    """

    __pydantic_config__ = STRICT

    category: str | None = None
    """Category, such as Tops_LongSleeve or Trousers; by default guessed from the openings."""
    units: Literal["m", "cm", "mm", "in"] | None = None
    """Unit of the file; found from the size otherwise."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """Up axis of the file; found from the openings otherwise."""
    scale: Annotated[float, Ge(0.1), Le(10)] | None = None
    """Size over the original's; 1, or 0.85 for ClothesNet, so that robots reach both cuffs."""
    spacing: Annotated[float, Ge(0.006), Le(0.025)] = 0.013
    """Edge length of the mesh that is made [m], 0.006 to 0.025."""
    keypoints: Path | None = None
    """JSON file of named points, {"left_cuff": 123, "collar": [x, y, z]}: vertices or positions of
    the file; by default keypoints.json in the folder. Names such as left_cuff, collar and hem tell
    the orientation."""
    name: str | None = None
    """Name of the asset, letters of any alphabet; that of the file otherwise."""
    licence: str | None = None
    """Licence under which you have it; recorded in meta.json, never checked."""
    source: str | None = None
    """Origin of the file; recorded in meta.json."""
    textures: bool = True
    """Keep the texture, a missing picture is an error then; without, pictures do not matter."""
    overwrite: bool = False
    """Replace an asset of the same name."""
    mesh: str | None = None
    """Mesh to read from a folder or an archive of several, such as source/shirt.obj."""
    object: str | None = None
    """Object to read from a file of several: the name of an object or a group, or a connected part
    by its area, such as part2 or Shirt/part2."""
    weld: Annotated[float, Gt(0), Le(0.01)] | None = None
    """Distance below which open edges are sewn together, at the size of the file [m], up to 0.01;
    by default 1e-4 of the diagonal."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.category is not None and self.category not in CATEGORIES:
            raise ValueError(f"category must be one of {list(CATEGORIES)}; got {self.category!r}")
