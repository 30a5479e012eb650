"""`dgl assets materials`: pictures of what garments and floors can look like."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgarmentlab.cli import EXIT_OK, console

__all__ = ["MaterialsOptions", "show_materials"]

_MAP_SIZES = (32, 2048)


@dataclass(frozen=True, kw_only=True)
class MaterialsOptions:
    """Draw fabrics and floors of a seed as swatches, and write their maps when asked.

    Example: dgl assets materials --seed 0 --out materials.png
    """

    out: Path
    """Picture to write, PNG."""
    seed: int = 0
    """Of the sheet; other seeds give other materials."""
    fabrics: int = 18
    """Fabrics on the sheet."""
    floors: int = 12
    """Floors on the sheet."""
    maps: Path | None = None
    """Folder for the maps of each material: base colour, roughness and normal, PNG."""
    size: int = 512
    """Pixels along a side of a map."""
    json: bool = False
    """Write what was drawn as JSON."""


def show_materials(options: MaterialsOptions) -> int:
    """Draw the sheet, and write the maps."""
    import numpy as np

    from dgl_assets import save_picture
    from dgl_assets.materials import draw_material_sheet, sample_materials

    if options.out.suffix.lower() != ".png":
        raise ValueError(f"--out must be a file .png; got {options.out}")
    if not _MAP_SIZES[0] <= options.size <= _MAP_SIZES[1]:
        raise ValueError(f"--size must be in {list(_MAP_SIZES)}; got {options.size}")
    for name in ("seed", "fabrics", "floors"):
        if getattr(options, name) < 0:
            raise ValueError(f"--{name} must not be negative; got {getattr(options, name)}")
    with console.progress("drawing swatches") as bar:
        sheet = draw_material_sheet(options.seed, fabrics=options.fabrics, floors=options.floors)
        bar.advance()
    save_picture(sheet, options.out)
    rows: list[dict[str, Any]] = []
    groups = sample_materials(options.seed, fabrics=options.fabrics, floors=options.floors)
    entries = [
        (f"{group}_{k:02}", material)
        for group, materials in zip(("fabric", "floor"), groups, strict=True)
        for k, material in enumerate(materials)
    ]
    for stem, material in entries if options.maps is None else console.track(entries, "maps"):
        row: dict[str, Any] = {"id": stem, "name": material.name}
        if options.maps is not None:
            maps = material.render(options.size)
            row |= {"tile_size": maps.tile_size, "maps": {}}
            for kind, image in (
                ("base_colour", maps.base_colour),
                ("roughness", np.repeat(maps.roughness[..., None], 3, axis=2)),
                ("normal", maps.normal),
            ):
                path = save_picture(image, options.maps / f"{stem}_{kind}.png")
                row["maps"][kind] = str(path)
        rows.append(row)
    if options.json:
        console.out_json({"picture": str(options.out), "seed": options.seed, "materials": rows})
    else:
        console.out(f"{options.out}: {len(groups[0])} fabrics, {len(groups[1])} floors")
        if options.maps is not None:
            console.out(f"{options.maps}: {3 * len(rows)} maps of {options.size} pixels")
    return EXIT_OK
