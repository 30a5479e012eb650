"""`dgl gam skeleton`: correspondence for garments that have none."""

import dataclasses
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console

__all__ = ["SkeletonOptions", "register_category"]


@dataclass(frozen=True, kw_only=True)
class SkeletonOptions:
    """Learn key points of a category from clouds, and register its garments by them.

    The canonical coordinates of the data are not looked at; where there are any, they measure the
    result. What is written can be trained on like any other data.

    Example: dgl gam skeleton Trousers --data gam-data --out gam-registered
    """

    category: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="CATEGORY")]
    """Category of the garments."""
    data: Path
    """Folder of training data; the views that lie flat are used."""
    out: Path
    """Folder for the garments with their new coordinates; it must be empty or missing."""
    key_points: int = 12
    """Key points to learn."""
    steps: int = 300
    """Steps of their training."""
    pairs: int = 60
    """Pairs of unseen garments to measure on."""
    seed: int = 0
    """Of everything drawn."""
    json: bool = False
    """Write the result as JSON."""


def register_category(options: SkeletonOptions) -> int:
    """Learn, register, and say how well it went."""
    from dgl_gam.data import GarmentFolder
    from dgl_gam.skeleton import (
        SkeletonConfig,
        fit_skeleton,
        measure_registration,
        write_registered,
    )
    from dgl_gam.skeleton.dataset import get_flat_cloud

    if options.out.exists() and any(options.out.iterdir()):
        raise FileExistsError(f"{options.out} is not empty; choose another --out")
    config = dataclasses.replace(
        SkeletonConfig(), key_points=options.key_points, steps=options.steps, seed=options.seed
    )
    every = GarmentFolder(options.data, categories=[options.category])
    train = GarmentFolder(options.data, categories=[options.category], split="train")
    clouds = [get_flat_cloud(train.load(index)) for index in range(len(train))]
    with console.progress("learning key points", config.steps) as bar:
        network = fit_skeleton(
            clouds, config, on_progress=lambda step, loss: bar.advance(note=f"loss {loss:.4f}")
        )
    with console.progress("registering", len(every)) as bar:
        paths = write_registered(
            network, every, options.out, on_progress=lambda name: bar.advance(note=name)
        )
    result: dict[str, Any] = {"out": str(options.out), "garments": len(paths), "measured": None}
    unseen = [h.garment_id for h in every.headers if h.split == "test"]
    if len(unseen) > 1:
        truth, found = (
            GarmentFolder(root, categories=[options.category], split="test")
            for root in (options.data, options.out)
        )
        if all(truth.load(index).has_canonical for index in range(len(truth))):
            measured = measure_registration(truth, found, pairs=options.pairs, seed=options.seed)
            result["measured"] = asdict(measured)
    if options.json:
        console.out_json(result)
        return EXIT_OK
    console.out(f"{options.out}: {len(paths)} garments of {options.category} registered")
    if result["measured"] is None:
        console.out("not measured: there are no unseen garments with exact coordinates")
    else:
        console.out(
            "on unseen garments: mean error {mean_error:.1%} of the diagonal, PCK@.05 {pck05:.1%}, "
            "PCK@.10 {pck10:.1%}".format(**result["measured"])
        )
    return EXIT_OK
