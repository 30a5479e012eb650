"""`dgl assets import-robot` and `list-robots`: your own arms and hands."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.assets_import import name_flags

if TYPE_CHECKING:
    from dgl_assets.robots.importing import RobotReport

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
    """URDF; its meshes lie in its folder or below, or in a --package."""
    name: str
    """Name to use it by: lower-case letters, digits, "_" and "-"."""
    robots: Path
    """Folder of robots; it is written to ROBOTS/NAME."""
    kind: Literal["arm", "hand", "pair"]
    """Content of the file: an arm, a hand, or a pair of arm and hand."""
    collision: Literal["capsules", "coacd", "keep"] = "capsules"
    """Collision shapes of meshes: fitted capsules, convex pieces by CoACD, or one convex hull
    each."""
    root: str | None = None
    """Import only what hangs on this link."""
    ee_link: str | None = None
    """Link that an arm's tool is mounted on."""
    hand_link: str | None = None
    """First link of a pair's hand."""
    tool_axis: str = "+z"
    """Direction of the fingers in the link that the tool is mounted on."""
    tool_palm: str | None = None
    """Direction out of the palm there; the one that lets the arm reach most otherwise."""
    fingers_axis: str | None = None
    """Direction of the straight fingers in the hand's first link."""
    palm_axis: str | None = None
    """Direction out of the palm in the hand's first link."""
    thumb: str | None = None
    """A link of the thumb."""
    side: Literal["left", "right"] | None = None
    """Side of the hand in the file."""
    mount_offset: float | None = None
    """Distance from the flange to the hand's first link along the fingers [m]."""
    grasp_point: tuple[float, float, float] | None = None
    """Place between the fingers of the right hand that tasks lead, axes of ee [m]."""
    home: Path | None = None
    """JSON of where the arms start: {"left": {joint: value}, "right": {...}}."""
    poses: Path | None = None
    """JSON of hand poses: {"open": {joint: value}, ...}; those that it lacks are found."""
    package: dict[str, Path] = field(default_factory=dict)
    """Folders of ROS packages that the file refers to: NAME FOLDER ..."""
    licence: str = ""
    """Licence under which you have it; recorded in robot.json."""
    source: str = ""
    """Origin of the file; recorded in robot.json."""
    overwrite: bool = False
    """Replace a robot of the same name."""
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
    from dgl_assets.importing import AssetImportError

    try:
        report = _import(options)
    except AssetImportError as error:
        raise type(error)(name_flags(str(error))) from error
    shapes = ", ".join(f"{count} {kind}" for kind, count in report.collision_shapes.items())
    if options.json:
        console.out_json(
            {
                "name": report.name,
                "kind": report.kind,
                "folder": str(report.folder),
                "joints": report.joints,
                "links": report.links,
                "collision_shapes": dict(report.collision_shapes),
                "assumptions": list(report.assumptions),
            }
        )
        return EXIT_OK
    console.out(
        f"{report.folder}: {report.kind} of {report.joints} joints; collision shapes: "
        f"{shapes or 'none'}"
    )
    for assumption in report.assumptions:
        console.out(f"  {assumption}")
    console.out(f"use it: --robot {report.name} --robots {options.robots}")
    return EXIT_OK


def _import(options: ImportRobotOptions) -> "RobotReport":
    from dgl_assets.robots import importing

    with console.progress(f"importing {options.name}", None) as bar:
        return importing.import_robot(
            options.file,
            name=options.name,
            out=options.robots,
            kind=options.kind,
            options=importing.RobotImportOptions(
                root=options.root,
                ee_link=options.ee_link,
                hand_link=options.hand_link,
                tool_axis=options.tool_axis,
                tool_palm=options.tool_palm,
                fingers_axis=options.fingers_axis,
                palm_axis=options.palm_axis,
                thumb=options.thumb,
                side=options.side,
                mount_offset=options.mount_offset,
                grasp_point=options.grasp_point,
                home=options.home,
                poses=options.poses,
                packages=options.package,
                collision=options.collision,
                licence=options.licence,
                source=options.source,
                overwrite=options.overwrite,
            ),
            on_progress=lambda link: bar.advance(0, note=link),
        )


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
