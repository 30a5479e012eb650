"""Folder of garments: headers in memory, arrays cached."""

import itertools
from collections import OrderedDict
from collections.abc import Sequence
from pathlib import Path

from dgl_gam.data.garment_file import GarmentData, GarmentHeader, read_garment, read_header
from dgl_gam.errors import DataError

__all__ = ["GarmentFolder"]

DEFAULT_CACHE_BYTES = 512 * 2**20


class GarmentFolder:
    """The garments below a folder, in the order of category and id."""

    def __init__(
        self,
        root: Path,
        *,
        categories: Sequence[str] | None = None,
        split: str | None = None,
        cache_bytes: int = DEFAULT_CACHE_BYTES,
    ) -> None:
        """Read the headers of all files ending in .safetensors.

        Args:
            root: The folder; searched at any depth.
            categories: Only these categories; all when None.
            split: Only "train" or "test"; both when None.
            cache_bytes: Memory that arrays may take [bytes]. The garment in use is held in any
                case.

        Raises:
            DataError: If the folder is missing, a file in it is not a garment's data, two have the
                same category and id, or none is left by `categories` and `split`.
        """
        root = Path(root)
        if not root.is_dir():
            raise DataError(f"{root} is no folder of training data")
        paths = sorted(p for p in root.rglob("*.safetensors") if not p.name.startswith("."))
        every = [read_header(path) for path in paths]
        found = sorted({h.category for h in every})
        unknown = sorted(set(categories or ()) - set(found))
        if unknown:
            raise DataError(f"{root} has no garments of {', '.join(unknown)}; it has {found}")
        chosen = [
            h
            for h in every
            if (categories is None or h.category in categories) and split in (None, h.split)
        ]
        if not chosen:
            raise DataError(
                f"{root} has no garments" + (f" of the split {split}" if split else "") + f"; "
                f"it has {len(every)} file(s) ending in .safetensors"
            )
        self.headers: tuple[GarmentHeader, ...] = tuple(
            sorted(chosen, key=lambda h: (h.category, h.garment_id))
        )
        """Header of each garment."""
        names = [(h.category, h.garment_id) for h in self.headers]
        for first, second in itertools.pairwise(names):
            if first == second:
                raise DataError(f"{root} has two garments {first[0]} {first[1]}")
        self._cache: OrderedDict[int, GarmentData] = OrderedDict()
        self._cache_bytes = cache_bytes
        self._held = 0

    def __len__(self) -> int:
        return len(self.headers)

    @property
    def categories(self) -> tuple[str, ...]:
        """Categories of the garments, sorted."""
        return tuple(sorted({h.category for h in self.headers}))

    @property
    def held_bytes(self) -> int:
        """Memory that the arrays held at present take."""
        return self._held

    def get_indices(self, category: str) -> tuple[int, ...]:
        """Find the garments of a category."""
        return tuple(i for i, h in enumerate(self.headers) if h.category == category)

    def load(self, index: int) -> GarmentData:
        """Arrays of a garment, read from its file or still held.

        Raises:
            DataError: If the file has become unreadable or is damaged.
        """
        if index in self._cache:
            self._cache.move_to_end(index)
            return self._cache[index]
        data = read_garment(self.headers[index].path)
        self._cache[index] = data
        self._held += data.nbytes
        while self._held > self._cache_bytes and len(self._cache) > 1:
            self._held -= self._cache.popitem(last=False)[1].nbytes
        return data
