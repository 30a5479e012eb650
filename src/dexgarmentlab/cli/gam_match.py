"""`dgl gam match`: find points of one garment on another."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro  # noqa: TID253 - marks the positional arguments; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import check_picture

if TYPE_CHECKING:
    import numpy as np

    from dexgarmentlab.gam.axes import Up
    from dexgarmentlab.gam.clouds import Cloud

__all__ = ["MIN_POINTS", "MatchOptions", "match"]

MIN_POINTS, MAX_POINTS = 16, 2**21
"""Limits of a cloud, repeated from `dgl_gam.model`, which takes seconds to import."""

_SPREAD = 8


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """Find points of one garment on another, and draw both with the matches and a heat map.

    A garment is a cloud in a file .npy, .ply or .safetensors; a mesh in a file .obj, .ply, .stl,
    .glb, .gltf or .usd, or the folder of an imported one; or an id of the catalogue. Meshes are
    seen from above. What is found out or assumed about a file (its unit, which way is up, what it
    is) is said.

    Example: dgl gam match Trousers/000001 Trousers/000002 --out match.png
    """

    source: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="A")]
    """The demonstrated garment."""
    target: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="B")]
    """The observed garment."""
    out: Path
    """Picture to write, PNG."""
    landmark: tuple[str, ...] = ()
    """Landmarks of A to find; eight points spread over A when nothing is named."""
    index: tuple[int, ...] = ()
    """Points of A to find, by their index in its cloud."""
    heat: int = 0
    """Number of the point that the heat map shows."""
    weights: Path | None = None
    """File of weights, or a folder of them; by default the shipped ones."""
    category: str | None = None
    """Category of the garments if the files do not tell it, or to use another category's
    network."""
    up: tuple[Literal["x", "y", "z", "-x", "-y", "-z"], ...] = ()
    """Up axis of the files, towards the camera: one for both, or one for A and one for B. Default:
    z for points; for a mesh it is found from its openings."""
    device: str = "cpu"
    """Device: cpu or cuda."""
    json: bool = False
    """Write the matches as JSON."""


def match(options: MatchOptions) -> int:
    """Match, draw, and write where each point was found."""
    check_picture(options.out)
    if len(options.up) > 2:
        raise ValueError(f"--up must be one axis or two; got {len(options.up)}")
    up_a, up_b = (options.up[0], options.up[-1]) if options.up else (None, None)
    source = _load("A", options.source, seed=0, up=up_a, category=options.category)
    target = _load("B", options.target, seed=1, up=up_b, category=options.category)
    # Late: what cannot be matched is refused before torch and the pictures' libraries are loaded.
    from dexgarmentlab.gam.picture import draw_matches
    from dexgarmentlab.gam.runs import load_models

    for cloud in (source, target):
        for text in cloud.assumptions:
            console.info(f"{cloud.name}: {text}")
    names, points = _choose(options, source)
    if not 0 <= options.heat < len(points):
        raise ValueError(f"--heat must be in [0, {len(points)}); got {options.heat}")
    category = _find_category(options, source, target)
    model = load_models(options.weights, [category], device=options.device)[category]
    matches = model.locate(source.points, points, target.points)
    draw_matches(options.out, source, points, target, matches, heat=options.heat)
    found = [
        {
            "point": name,
            "source": points[number].tolist(),
            "index": int(matches.indices[number]),
            "target": matches.points[number].tolist(),
            "similarity": float(matches.similarity[number].max()),
            "confidence": float(matches.confidence[number]),
        }
        for number, name in enumerate(names)
    ]
    if options.json:
        assumed = {"A": list(source.assumptions), "B": list(target.assumptions)}
        console.out_json(
            {
                "picture": str(options.out),
                "category": category,
                "assumptions": assumed,
                "matches": found,
            }
        )
        return EXIT_OK
    console.out_table(
        ("", "point", "found at, z up", "similarity", "confidence"),
        [
            (
                number,
                row["point"],
                ", ".join(f"{x:.3f}" for x in row["target"]),
                f"{row['similarity']:.3f}",
                f"{row['confidence']:.2f}",
            )
            for number, row in enumerate(found)
        ],
    )
    console.out(f"picture: {options.out}")
    return EXIT_OK


def _load(which: str, what: str, *, seed: int, up: "Up | None", category: str | None) -> "Cloud":
    """Load a cloud, and refuse one in which nothing can be found."""
    import numpy as np

    from dexgarmentlab.gam.clouds import load_cloud

    try:
        cloud = load_cloud(what, seed=seed, up=up, category=category)
    except MemoryError as err:
        raise ValueError(f"{which}, {what}, must fit into memory; it declares more") from err
    if not MIN_POINTS <= len(cloud.points) <= MAX_POINTS:
        raise ValueError(
            f"{which}, {what}, must have {MIN_POINTS} to {MAX_POINTS} points; "
            f"got {len(cloud.points)}"
        )
    bad = np.flatnonzero(~np.isfinite(cloud.points).all(axis=1))
    if len(bad):
        raise ValueError(
            f"{which}, {what}, must have finite coordinates; got {len(bad)} point(s) that have "
            "not, "
            f"first {bad[0]}"
        )
    return cloud


def _find_category(options: MatchOptions, source: "Cloud", target: "Cloud") -> str:
    """Choose the category: the user's, or that of both clouds."""
    known = {cloud.category for cloud in (source, target) if cloud.category is not None}
    if options.category is not None:
        return options.category
    if not known:
        raise ValueError("the files do not tell the category: name it with --category")
    if len(known) > 1:
        raise ValueError(
            f"A is of {source.category} and B of {target.category}, and places correspond within "
            "a category only; "
            "to try the network of one of them on both, name it with --category"
        )
    return known.pop()


def _choose(options: MatchOptions, source: "Cloud") -> tuple[list[str], "np.ndarray"]:
    """Choose names and positions of the points to find."""
    import numpy as np
    import torch

    from dgl_gam._sampling import sample_farthest

    known = source.landmarks or {}
    unknown = [name for name in options.landmark if name not in known]
    if unknown:
        raise ValueError(
            f"{source.name} has no landmark {', '.join(unknown)}; it has "
            f"{', '.join(known) or 'none'}"
        )
    wrong = [i for i in options.index if not 0 <= i < len(source.points)]
    if wrong:
        raise ValueError(f"--index must be in [0, {len(source.points)}); got {wrong[0]}")
    indices = list(options.index)
    if not options.landmark and not indices:
        cloud = torch.from_numpy(np.ascontiguousarray(source.points[None]))
        indices = sample_farthest(cloud, min(_SPREAD, len(source.points)))[0][0].tolist()
    names = [*options.landmark, *map(str, indices)]
    positions = [known[name] for name in options.landmark] + [source.points[i] for i in indices]
    return names, np.stack(positions)
