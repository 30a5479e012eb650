"""`dgl assets import`."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console
from dexgarmentlab.cli.flags import Flags
from dgl_assets.importing.options import GarmentImportOptions

if TYPE_CHECKING:
    import numpy as np

    from dgl_assets.importing import ImportReport

__all__ = ["ImportGarmentOptions", "bring", "in_flags", "name_flags"]


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
    lay_flat: bool = False
    """Let it fall on a table in a short simulation: for garments in the shape of a body."""
    options: Flags[GarmentImportOptions] = field(default_factory=GarmentImportOptions)
    json: bool = False
    """Write the result as JSON."""


def bring(options: ImportGarmentOptions) -> int:
    """Import one model or many, and say what was made and what was refused."""
    from dgl_assets import AssetError
    from dgl_assets.importing import list_models

    models = [options.path]
    if options.path.is_dir() and options.options.mesh is None:
        models = list(list_models(options.path))
    if len(models) == 1:
        report = _import(options.path, options)
        if options.json:
            console.out_json({"imported": [report.to_dict()], "refused": []})
        else:
            console.out("\n".join(_lines(report)))
        return EXIT_OK
    reports, refused = [], []
    if options.options.name is not None:
        raise ValueError(f"--name is for one garment; {options.path} holds {len(models)}")
    for model in console.track(models, f"importing {options.path.name}"):
        try:
            reports.append(_import(model, options))
        except AssetError as error:
            refused.append({"path": str(model), "reason": str(error)})
    if options.json:
        console.out_json({"imported": [report.to_dict() for report in reports], "refused": refused})
    else:
        for report in reports:
            console.out(f"imported {report.folder}: {report.vertex_count:,} vertices")
    for entry in refused:
        console.error(f"refused {entry['path']}: {entry['reason']}")
    if refused:
        console.error(f"{len(refused)} of {len(models)} models were refused")
    return EXIT_FAILURE if refused else EXIT_OK


def _import(path: Path, options: ImportGarmentOptions) -> "ImportReport":
    from dgl_assets.importing import import_garment

    with in_flags():
        return import_garment(
            path,
            out=options.out,
            options=options.options,
            lay_flat=_lay_flat if options.lay_flat else None,
        )


@contextmanager
def in_flags() -> Iterator[None]:
    """Name the flags in the errors of an import."""
    from dgl_assets.importing import AssetImportError

    try:
        yield
    except AssetImportError as error:
        raise type(error)(name_flags(str(error))) from error


def name_flags(text: str) -> str:
    """Replace the options in a message of the library by flags: `units` by --units."""

    def to_flag(found: re.Match[str]) -> str:
        return f"--{'no-' if found[2] else ''}{found[1].replace('_', '-')}"

    return re.sub(r"`([a-z_]+)(=False)?`", to_flag, text)


def _lay_flat(
    vertices: "np.ndarray", faces: "np.ndarray", rest_vertices: "np.ndarray"
) -> "np.ndarray":
    from dgl_physics.lay_flat import FRAMES, lay_flat

    with console.progress("laying it flat", FRAMES) as bar:
        return lay_flat(vertices, faces, rest_vertices, on_frame=bar.advance)


def _lines(report: "ImportReport") -> list[str]:
    """Summarise an asset in a few lines."""
    x, y, z = report.extent
    return [
        f"imported {report.folder}",
        f"  {report.category}, {x:.2f} x {y:.2f} x {z:.2f} m, {report.area:.2f} m^2 of cloth",
        f"  {report.vertex_count:,} vertices, {report.even_edges:.1%} of edges and "
        f"{report.even_angles:.1%} of "
        "angles even",
        f"  landmarks: {', '.join(report.landmarks) or 'none; write them into keypoints.json'}",
        f"  licence: {report.licence}",
        *(f"  - {name_flags(text)}" for text in report.assumptions),
    ]
