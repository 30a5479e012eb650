"""A garment that was imported, as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dgl_assets.garments.garment import GarmentShape


@dataclass(frozen=True, kw_only=True, eq=False)
class ImportedGarment(GarmentShape):
    """A garment from a file; hats stand on their rim.

    It has neither panels nor canonical coordinates: points on it are found by its landmarks or by a
    trained matcher. `rest_vertices` are as in the file, before it was laid flat, shape (V, 3).
    """

    uvs: np.ndarray | None = None
    """Texture coordinates of each corner, v upwards, shape (F, 3, 2), float32."""
    texture: Path | None = None
    """Picture on the cloth, PNG or JPEG."""
    meta: Mapping[str, Any] = field(default_factory=dict)
    """Content of meta.json: source, licence, assumptions."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_array("rest_vertices", 3)
        if not len(self.faces):
            raise ValueError("an imported garment must have faces")
        if self.uvs is not None and self.uvs.shape != (len(self.faces), 3, 2):
            raise ValueError(f"uvs must have shape ({len(self.faces)}, 3, 2); got {self.uvs.shape}")
