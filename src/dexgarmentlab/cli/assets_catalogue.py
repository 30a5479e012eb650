"""`dgl assets list`, `show` and `build`: the garments that are made in code."""

import statistics
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_INTERRUPTED, EXIT_OK, console
from dexgarmentlab.cli.flags import check_picture, tell_command

if TYPE_CHECKING:
    from dgl_assets import BuiltGarment

__all__ = ["BuildOptions", "ListOptions", "ShowOptions", "build", "list_garments", "show"]

Split = Literal["train", "test"]
Subset = Literal["paper"]
Sizes = Literal["reach", "all"]

SPLITS: tuple[Split, ...] = ("train", "test")
SHEET_COUNT = 48
_FAILURES_SHOWN = 10


@dataclass(frozen=True, kw_only=True)
class ListOptions:
    """List the categories with how many garments they have, or the ids of one category.

    Example: dgl assets list Scarf --subset paper
    """

    category: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="CATEGORY")] = None
    """A category such as Trousers, to list its ids; all categories otherwise."""
    split: Split | None = None
    """Only ids of this split."""
    subset: Subset | None = None
    """Only as many ids as the paper used."""
    sizes: Sizes = "reach"
    """Ids of garments that the robots reach, or of others from children to XXL."""
    json: bool = False
    """Write the result as JSON."""


@dataclass(frozen=True, kw_only=True)
class ShowOptions:
    """Draw one garment with its landmarks, or the contact sheet of a category.

    Example: dgl assets show Baseball_Cap --out caps.png
    """

    what: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID|CATEGORY")]
    """An id such as Tops_LongSleeve/000123, or a category."""
    out: Path
    """Picture to write, PNG."""
    count: int = SHEET_COUNT
    """Garments on a contact sheet."""
    sizes: Sizes = "all"
    """Sizes on a contact sheet: within reach of the robots, or from children to XXL."""
    json: bool = False
    """Write what was drawn as JSON."""


@dataclass(frozen=True, kw_only=True)
class BuildOptions:
    """Build garments into a cache, in parallel.

    Garments that are there are read and checked, so that an interrupted build goes on where it was.
    Every file appears whole.

    Example: dgl assets build --category Trousers --subset paper --workers 4 --cache garments
    """

    cache: Path
    """Folder of the cache; made if it does not exist."""
    category: tuple[str, ...] = ()
    """Categories to build; all of them when none is named."""
    split: Split | None = None
    """Only garments of this split."""
    subset: Subset | None = None
    """Only as many garments as the paper used."""
    sizes: Sizes = "reach"
    """Garments that the robots reach, or others from children to XXL."""
    count: int | None = None
    """Only the first so many of each category and split."""
    workers: int = 1
    """Processes that build at the same time."""
    json: bool = False
    """Write the summary as JSON."""


def list_garments(options: ListOptions) -> int:
    """Write the categories with their counts, or the ids of one."""
    from dgl_assets import garment_ids, list_categories
    from dgl_assets.garments.registry import get_category

    if options.category is not None:
        ids = [
            garment_id
            for split in _get_splits(options.split)
            for garment_id in garment_ids(
                options.category, split, sizes=options.sizes, subset=options.subset
            )
        ]
        if options.json:
            console.out_json({"category": options.category, "ids": ids})
        elif ids:
            console.out("\n".join(ids))
        return EXIT_OK
    rows: list[dict[str, Any]] = []
    for name in list_categories():
        entry = get_category(name)
        counts = {split: len(garment_ids(name, split, sizes=options.sizes)) for split in SPLITS}
        paper = {"train": entry.paper_train, "all": entry.paper_all}
        rows.append({"category": name, "title": entry.title, **counts, "paper": paper})
    if options.json:
        console.out_json({"categories": rows})
        return EXIT_OK
    console.out_table(
        ("category", "train", "test", "paper train", "paper all", "what"),
        [(r["category"], r["train"], r["test"], *r["paper"].values(), r["title"]) for r in rows],
    )
    return EXIT_OK


def show(options: ShowOptions) -> int:
    """Draw a garment or a contact sheet."""
    from dgl_assets import (
        draw_contact_sheet,
        draw_garment,
        garment_ids,
        load_garment,
        save_picture,
    )
    from dgl_assets.materials import sample_fabric_material

    check_picture(options.out)
    if "/" in options.what:
        garment = load_garment(options.what)
        picture = draw_garment(
            garment,
            fabric=sample_fabric_material(13).render(),
            size=1000,
            has_landmarks=True,
            has_names=True,
        )
        result: dict[str, Any] = {
            "id": options.what,
            "picture": str(options.out),
            "vertices": len(garment.vertices),
            "extent": garment.extent.tolist(),
            "landmarks": garment.landmarks,
            "parameters": garment.parameters,
        }
        text = f"{len(garment.vertices):,} vertices, {len(garment.landmarks)} landmarks"
    else:
        if options.count < 1:
            raise ValueError(f"--count must be at least 1; got {options.count}")
        ids = garment_ids(options.what, "train", sizes=options.sizes, count=options.count)
        garments = [load_garment(i) for i in console.track(ids, f"making {options.what}")]
        picture = draw_contact_sheet(garments, columns=8, size=200)
        result = {"category": options.what, "picture": str(options.out), "ids": list(ids)}
        text = f"{len(ids)} of {options.what}"
    save_picture(picture, options.out)
    if options.json:
        console.out_json(result)
    else:
        console.out(f"{options.out}: {text}")
    return EXIT_OK


def build(options: BuildOptions) -> int:
    """Build garments, and say how many, how long one took, and which failed."""
    from dgl_assets import build_garments, garment_ids, list_categories

    if options.count is not None and options.count < 1:
        raise ValueError(f"--count must be at least 1; got {options.count}")
    ids: list[str] = []
    for category in dict.fromkeys(options.category or list_categories()):
        for split in _get_splits(options.split):
            every = garment_ids(category, split, sizes=options.sizes, subset=options.subset)
            ids += every if options.count is None else every[: options.count]
    done: list[BuiltGarment] = []
    is_interrupted = False
    # An interruption inside of the block ends the workers, each after the garment that it has in
    # hand.
    with (
        closing(build_garments(ids, options.cache, workers=options.workers)) as running,
        console.progress("building garments", len(ids)) as bar,
    ):
        try:
            for built in running:
                done.append(built)
                bar.advance(note=built.id)
        except KeyboardInterrupt:
            is_interrupted = True
    summary = _summarise(done, requested=len(ids), is_interrupted=is_interrupted)
    if options.json:
        console.out_json({**summary, "cache": str(options.cache)})
    else:
        console.out("\n".join(_lines(summary, options.cache)))
    for failure in summary["failures"][:_FAILURES_SHOWN]:
        console.error(f"{failure['id']}: {failure['error']}")
    if len(summary["failures"]) > _FAILURES_SHOWN:
        console.error(f"and {len(summary['failures']) - _FAILURES_SHOWN} more failed")
    if is_interrupted:
        console.error(f"interrupted; continue with: {tell_command('assets build', options)}")
        return EXIT_INTERRUPTED
    return EXIT_FAILURE if summary["failures"] else EXIT_OK


def _get_splits(split: Split | None) -> tuple[Split, ...]:
    return SPLITS if split is None else (split,)


def _summarise(
    done: "list[BuiltGarment]", *, requested: int, is_interrupted: bool
) -> dict[str, Any]:
    fresh = [built for built in done if built.error is None and not built.is_cached]
    return {
        "status": "interrupted" if is_interrupted else "finished",
        "requested": requested,
        "built": len(fresh),
        "found": sum(built.error is None and built.is_cached for built in done),
        "median_seconds": statistics.median(b.seconds for b in fresh) if fresh else None,
        "longest_seconds": max(b.seconds for b in fresh) if fresh else None,
        "failures": [{"id": b.id, "error": b.error} for b in done if b.error is not None],
    }


def _lines(summary: dict[str, Any], cache: Path) -> list[str]:
    """Summarise a build in a few lines."""
    lines = [
        f"{cache}: {summary['built']} of {summary['requested']} garments built, {summary['found']} "
        "were there, "
        f"{len(summary['failures'])} failed"
    ]
    if summary["built"]:
        lines.append(
            f"CPU time of a garment: median {summary['median_seconds']:.2f} s, longest "
            f"{summary['longest_seconds']:.2f} s"
        )
    return lines
