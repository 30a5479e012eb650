"""Codes in the names of ClothesNet's models.

Layout: `<root>/<Category>/<Subtype>/<CODE>_<Name><number>/<CODE>_<Name><number>_obj.usd` as shared
with GarmentLab, or a folder of OBJ, MTL and pictures per model. The data set comes with no licence
text that allows passing it on.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

LICENCE = "none known for ClothesNet: research only, do not redistribute"
SOURCE = "ClothesNet"
SCALE = 0.85
"""Size over life size, so that robots reach both cuffs.

With centimetres this is the factor 0.0085 of the DexGarmentLab paper's code.
"""

_CODE = re.compile(r"^(T[CNH][LSN][OC]|D[LS][LSN]S|P[LS]|HA|GL)_", re.ASCII)
_COLLARS = {"C": "collar", "N": "no collar", "H": "hood"}
_SLEEVES = {"L": "long sleeves", "S": "short sleeves", "N": "no sleeves"}
_LENGTHS = {"L": "long", "S": "short"}


@dataclass(frozen=True, kw_only=True)
class ClothesNetName:
    """Facts about a garment in its name."""

    code: str
    """Such as "TNLC"."""
    category: str | None
    """Category here; None for hats, which are caps or bowl hats, and for short sleeves."""
    subtype: str
    """In words."""


def read_clothesnet_name(path: Path) -> ClothesNetName | None:
    """Read the code of a model from its file's or folder's name.

    Args:
        path: Of the mesh.

    Returns:
        What it says, or None if neither name begins with a code.
    """
    for name in (path.name, path.parent.name):
        match = _CODE.match(name)
        if match:
            return _explain(match.group(1))
    return None


def _explain(code: str) -> ClothesNetName:
    if code[0] == "T":
        front = "open front" if code[3] == "O" else "closed front"
        subtype = f"{_COLLARS[code[1]]}, {_SLEEVES[code[2]]}, {front}"
        category = {"L": "Tops_LongSleeve", "N": "Tops_NoSleeve"}.get(code[2])
        if code[3] == "O":
            category = "Tops_FrontOpen" if code[2] == "L" else None
        return ClothesNetName(code=code, category=category, subtype=subtype)
    if code[0] == "D":
        subtype = f"{_LENGTHS[code[1]]} dress, {_SLEEVES[code[2]]}"
        category = None if code[2] == "N" else "Dress_LongSleeve"  # as the paper sorts them
        return ClothesNetName(code=code, category=category, subtype=subtype)
    if code[0] == "P":
        return ClothesNetName(
            code=code, category="Trousers", subtype=f"{_LENGTHS[code[1]]} trousers"
        )
    if code == "HA":
        return ClothesNetName(code=code, category=None, subtype="hat")
    return ClothesNetName(code=code, category="Glove", subtype="glove")
