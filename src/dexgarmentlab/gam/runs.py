"""Folders of training runs: one run for each category, or one for all."""

from collections.abc import Sequence
from pathlib import Path

from dgl_gam import GarmentAffordanceModel
from dgl_gam.train import NETWORK_FILE

__all__ = ["TOGETHER", "find_runs", "load_models"]

TOGETHER = "garments"
"""Name of a run that trains one network for all categories."""


def find_runs(folder: Path) -> list[Path]:
    """Find the finished runs of a folder: the folders in it that hold a network, sorted.

    Raises:
        ValueError: If there is none.
    """
    runs = sorted(path.parent for path in Path(folder).glob(f"*/{NETWORK_FILE}"))
    if not runs:
        raise ValueError(f"{folder} holds no finished run: no folder in it has a {NETWORK_FILE}")
    return runs


def load_models(
    weights: Path | None, categories: Sequence[str], *, device: str
) -> dict[str, GarmentAffordanceModel]:
    """Load the model of each category.

    Args:
        weights: A file; a folder of files named by category, or of runs; None for the shipped
            weights.
        categories: Categories that are needed.
        device: Device to compute on.

    Raises:
        ValueError: If the folder has no weights for a category.
        FileNotFoundError: If there is no such file or folder.
    """
    if weights is not None and not weights.exists():
        raise FileNotFoundError(f"{weights} does not exist")
    models = {}
    for category in categories:
        if weights is None:
            models[category] = GarmentAffordanceModel.load(category, device=device)
            continue
        path = weights if weights.is_file() else _find(weights, category)
        models[category] = GarmentAffordanceModel.load(path, category=category, device=device)
    return models


def _find(folder: Path, category: str) -> Path:
    tried = [
        folder / f"{category}.safetensors",
        folder / category / NETWORK_FILE,
        folder / f"{TOGETHER}.safetensors",
        folder / TOGETHER / NETWORK_FILE,
        folder / NETWORK_FILE,
    ]
    for path in tried:
        if path.is_file():
            return path
    raise ValueError(f"{folder} has no weights for {category}: neither {tried[0]} nor {tried[1]}")
