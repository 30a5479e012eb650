"""`dgl assets import-robot` and `list-robots`: your own arms and hands."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.assets_import import in_flags
from dexgarmentlab.cli.flags import Flags
from dgl_assets.robots.importing.options import RobotImportOptions, RobotKind

__all__ = ["ImportRobotOptions", "ListRobotsOptions", "import_robot", "list_robots"]


@dataclass(frozen=True, kw_only=True)
class ImportRobotOptions:
    """Bring your own robot: import an arm, a hand, or an arm with its hand from a URDF.

    The other side is the same arm, and the hand's reflection. What is found out or assumed (where
    the arm ends, which finger is the thumb, home, hand poses, drives) is said, and each option
    fixes one of them. It is then
    used by name: --robot ARM+HAND, or one of the two with the built-in other.

    Example: dgl assets import-robot allegro.urdf --name allegro --kind hand --robots my-robots
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """URDF; its meshes lie in its folder or below, or one of --packages."""
    name: str
    """Name to use it by: lower-case letters, digits, "_" and "-"."""
    robots: Path
    """Folder of robots; it is written to ROBOTS/NAME."""
    kind: RobotKind
    """Content of the file: an arm, a hand, or a pair of arm and hand."""
    options: Flags[RobotImportOptions] = field(default_factory=RobotImportOptions)
    json: bool = False
    """Write the result as JSON."""


@dataclass(frozen=True, kw_only=True)
class ListRobotsOptions:
    """List the robots that --robot can name.

    Example: dgl assets list-robots --robots my-robots
    """

    robots: Path | None = None
    """Folder of imported robots; the built-in ones alone otherwise."""
    json: bool = False
    """Write the result as JSON."""


def import_robot(options: ImportRobotOptions) -> int:
    """Import a robot, and say what was made and what was assumed."""
    from dgl_assets.robots import importing

    with in_flags(), console.progress(f"importing {options.name}", None) as bar:
        report = importing.import_robot(
            options.file,
            name=options.name,
            out=options.robots,
            kind=options.kind,
            options=options.options,
            on_progress=lambda link: bar.advance(0, note=link),
        )
    shapes = ", ".join(f"{count} {kind}" for kind, count in report.collision_shapes.items())
    if options.json:
        console.out_json({**asdict(report), "folder": str(report.folder)})
        return EXIT_OK
    console.out(
        f"{report.folder}: {report.kind} of {report.joints} joints; collision shapes: "
        f"{shapes or 'none'}"
    )
    for assumption in report.assumptions:
        console.out(f"  {assumption}")
    console.out(f"use it: --robot {report.name} --robots {options.robots}")
    return EXIT_OK


def list_robots(options: ListRobotsOptions) -> int:
    """Write the robots with their kind, licence and origin."""
    from dgl_assets.robots import importing

    robots = importing.list_robots(options.robots)
    rows = [
        {"name": name, **{key: str(meta.get(key, "")) for key in ("kind", "licence", "source")}}
        for name, meta in robots.items()
    ]
    if options.json:
        console.out_json({"robots": rows})
        return EXIT_OK
    console.out_table(("name", "kind", "licence", "origin"), [tuple(r.values()) for r in rows])
    return EXIT_OK
