"""`dgl assets props` and `materials`: what garments are hung on, and what surfaces look like."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import check_picture

__all__ = ["MaterialsOptions", "PropsOptions", "show_materials", "show_props"]

_MAP_SIZES = (32, 2048)


@dataclass(frozen=True, kw_only=True)
class PropsOptions:
    """Draw hangers, hooks, platforms, stands and tables with their landmarks.

    Example: dgl assets props --out props.png
    """

    out: Path
    """Picture to write, PNG."""
    kinds: tuple[str, ...] = ()
    """Only these kinds, such as hanger or table; all when none is named."""
    meshes: Path | None = None
    """Folder for each prop's mesh, OBJ."""
    landmarks: bool = True
    """Mark and name the landmarks."""
    json: bool = False
    """Write measures, shapes and landmarks as JSON."""


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

    check_picture(options.out)
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


def show_props(options: PropsOptions) -> int:
    """Draw the sheet of props, and write their meshes."""
    from dgl_assets import save_picture
    from dgl_assets.props import PROP_KINDS, make_prop, save_obj
    from dgl_tasks.drawing.props import draw_prop_sheet

    check_picture(options.out)
    props = [make_prop(kind) for kind in options.kinds or PROP_KINDS]
    with console.progress("drawing props") as bar:
        sheet = draw_prop_sheet(props, has_landmarks=options.landmarks)
        bar.advance()
    save_picture(sheet, options.out)
    rows: list[dict[str, Any]] = []
    for prop in props:
        row: dict[str, Any] = {
            "kind": prop.kind,
            "extent": prop.extent.round(6).tolist(),
            "mass": prop.mass,
            "shapes": [shape.kind for shape in prop.shapes],
            "landmarks": {name: place.tolist() for name, place in prop.landmarks.items()},
            "parameters": dict(prop.parameters),
        }
        if options.meshes is not None:
            row["mesh"] = str(save_obj(prop, options.meshes / f"{prop.kind}.obj"))
        rows.append(row)
    if options.json:
        console.out_json({"picture": str(options.out), "props": rows})
    else:
        console.out(f"{options.out}: {', '.join(prop.kind for prop in props)}")
        if options.meshes is not None:
            console.out(f"{options.meshes}: {len(props)} meshes")
    return EXIT_OK
