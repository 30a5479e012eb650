"""`dgl assets import`."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console

if TYPE_CHECKING:
    import numpy as np

    from dgl_assets.importing import ImportReport

__all__ = ["ImportGarmentOptions", "bring", "name_flags"]

_FLAGS = {"object_name": "--object", "use_textures=False": "--no-textures"}
"""Flags that are not called as the parameter of the library is."""


@dataclass(frozen=True, kw_only=True)
class ImportGarmentOptions:
    """Bring your own garment: import a mesh file, a folder of them, or a zip archive.

    OBJ, PLY, STL, GLB, glTF and USD; a folder of {mesh, keypoints.json, meta.json}; a ClothesNet
    folder. What is found out or assumed (unit, up axis, category) is said, and each option fixes
    one of them. A mesh that cannot be cloth is refused with the place of the fault, and leaves
    nothing behind.

    Example: dgl assets import shirt.glb --out my-assets --licence CC-BY-4.0
    """

    path: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PATH")]
    """Mesh file, folder or archive. A folder of many models is imported model by model."""
    out: Path
    """Root of assets; each is written to OUT/CATEGORY/NAME."""
    category: str | None = None
    """Category, such as Tops_LongSleeve or Trousers; by default guessed from the openings."""
    units: Literal["m", "cm", "mm", "in"] | None = None
    """Unit of the file; found from the size otherwise."""
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None
    """Up axis of the file; found from the openings otherwise."""
    scale: float | None = None
    """Size over the original's; 1, or 0.85 for ClothesNet, so that robots reach both cuffs."""
    spacing: float = 0.013
    """Edge length of the mesh that is made [m], 0.006 to 0.025."""
    lay_flat: bool = False
    """Let it fall on a table in a short simulation: for garments in the shape of a body."""
    keypoints: Path | None = None
    """JSON file of named points: vertices or positions of the file."""
    name: str | None = None
    """Name of the asset; that of the file otherwise."""
    licence: str | None = None
    """Licence under which you have it; recorded in meta.json."""
    source: str | None = None
    """Origin of the file; recorded in meta.json."""
    textures: bool = True
    """Keep the texture; with --no-textures, missing pictures do not matter."""
    overwrite: bool = False
    """Replace an asset of the same name."""
    mesh: str | None = None
    """Mesh to read from a folder or an archive of several, such as source/shirt.obj."""
    object: str | None = None
    """Object to read from a file of several: a name in the file, or a connected part such as
    part2."""
    weld: float | None = None
    """Distance below which open edges are sewn together [mm], up to 10; found from the size
    otherwise."""
    json: bool = False
    """Write the result as JSON."""


def bring(options: ImportGarmentOptions) -> int:
    """Import one model or many, and say what was made and what was refused."""
    from dgl_assets import AssetError
    from dgl_assets.importing import list_models

    models = [options.path]
    if options.path.is_dir() and options.mesh is None:
        models = list(list_models(options.path))
    if len(models) == 1:
        report = _import(options.path, options)
        if options.json:
            console.out_json({"imported": [_to_json(report)], "refused": []})
        else:
            console.out("\n".join(_lines(report)))
        return EXIT_OK
    reports, refused = [], []
    if options.name is not None:
        raise ValueError(f"--name is for one garment; {options.path} holds {len(models)}")
    for model in console.track(models, f"importing {options.path.name}"):
        try:
            reports.append(_import(model, options))
        except AssetError as error:
            refused.append({"path": str(model), "reason": name_flags(str(error))})
    if options.json:
        console.out_json({"imported": [_to_json(r) for r in reports], "refused": refused})
    else:
        for report in reports:
            console.out(f"imported {report.folder}: {report.vertex_count:,} vertices")
    for entry in refused:
        console.error(f"refused {entry['path']}: {entry['reason']}")
    if refused:
        console.error(f"{len(refused)} of {len(models)} models were refused")
    return EXIT_FAILURE if refused else EXIT_OK


def _import(path: Path, options: ImportGarmentOptions) -> "ImportReport":
    from dgl_assets.importing import AssetImportError, import_garment

    try:
        return import_garment(
            path,
            out=options.out,
            category=options.category,
            units=options.units,
            up=options.up,
            scale=options.scale,
            spacing=options.spacing,
            lay_flat=_lay_flat if options.lay_flat else None,
            keypoints=options.keypoints,
            name=options.name,
            licence=options.licence,
            source=options.source,
            use_textures=options.textures,
            overwrite=options.overwrite,
            mesh=options.mesh,
            object_name=options.object,
            weld=None if options.weld is None else options.weld * 1e-3,
        )
    except AssetImportError as error:
        raise type(error)(name_flags(str(error))) from error


def name_flags(text: str) -> str:
    """Replace the parameters in a message of the library by flags: `units` by --units."""

    def to_flag(found: re.Match[str]) -> str:
        name = found.group(1)
        return _FLAGS.get(name, "--" + name.replace("_", "-"))

    return re.sub(r"`([a-z_]+(?:=False)?)`", to_flag, text)


def _lay_flat(
    vertices: "np.ndarray", faces: "np.ndarray", rest_vertices: "np.ndarray"
) -> "np.ndarray":
    from dgl_physics.lay_flat import FRAMES, lay_flat

    with console.progress("laying it flat", FRAMES) as bar:
        return lay_flat(vertices, faces, rest_vertices, on_frame=bar.advance)


def _to_json(report: "ImportReport") -> dict[str, Any]:
    return report.to_dict()


def _lines(report: "ImportReport") -> list[str]:
    """Summarise an asset in a few lines."""
    x, y, z = report.extent
    return [
        f"imported {report.folder}",
        f"  {report.category}, {x:.2f} x {y:.2f} x {z:.2f} m, {report.area:.2f} m^2 of cloth",
        f"  {report.vertex_count:,} vertices, {report.even_edges:.1%} of edges and "
        f"{report.even_angles:.1%} of "
        "angles even",
        f"  key points: {', '.join(report.landmarks) or 'none; write them into keypoints.json'}",
        f"  licence: {report.licence}",
        *(f"  - {name_flags(text)}" for text in report.assumptions),
    ]
