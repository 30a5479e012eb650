"""`dgl gam match`: find points of one garment on another."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional arguments; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console

if TYPE_CHECKING:
    import numpy as np

    from dexgarmentlab.gam.clouds import Cloud

__all__ = ["MatchOptions", "match"]

_SPREAD = 8


@dataclass(frozen=True, kw_only=True)
class MatchOptions:
    """Find points of one garment on another, and draw both with the matches and a heat map.

    A garment is a cloud in a file .npy, .ply or .safetensors, or an id of the catalogue, seen lying flat.

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
    """Which of the points the heat map is of."""
    weights: Path | None = None
    """File of weights, or a folder of them; those that come along when not given."""
    category: str | None = None
    """Category of the garments, where the files do not tell it."""
    device: str = "cpu"
    """Where to compute: cpu or cuda."""
    json: bool = False
    """Write the matches as JSON."""


def match(options: MatchOptions) -> int:
    """Match, draw, and write where each point was found."""
    from dexgarmentlab.gam.clouds import load_cloud
    from dexgarmentlab.gam.picture import draw_matches
    from dexgarmentlab.gam.runs import load_models

    if options.out.suffix.lower() != ".png":
        raise ValueError(f"--out must be a file .png; got {options.out}")
    source, target = load_cloud(options.source), load_cloud(options.target, seed=1)
    names, points = _choose(options, source)
    if not 0 <= options.heat < len(points):
        raise ValueError(f"--heat must be in [0, {len(points)}); got {options.heat}")
    category = options.category or source.category or target.category
    if category is None:
        raise ValueError("the files do not tell the category: name it with --category")
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
        console.out_json({"picture": str(options.out), "matches": found})
        return EXIT_OK
    console.out_table(
        ("", "point", "found at [m]", "similarity", "confidence"),
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


def _choose(options: MatchOptions, source: "Cloud") -> tuple[list[str], "np.ndarray"]:
    """Names and positions of the points to find."""
    import numpy as np
    import torch

    from dgl_gam._sampling import sample_farthest

    known = source.landmarks or {}
    unknown = [name for name in options.landmark if name not in known]
    if unknown:
        raise ValueError(
            f"{source.name} has no landmark {', '.join(unknown)}; it has {', '.join(known) or 'none'}"
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
