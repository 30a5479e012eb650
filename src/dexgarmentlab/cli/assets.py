"""Verb `dgl assets`: its actions are in the modules beside, one subcommand each."""

from typing import Annotated

import tyro  # noqa: TID253 - names the actions; the command line imports it anyway

from dexgarmentlab.cli.assets_catalogue import (
    BuildOptions,
    ListOptions,
    ShowOptions,
    build,
    list_garments,
    show,
)
from dexgarmentlab.cli.assets_import import ImportGarmentOptions, bring
from dexgarmentlab.cli.assets_looks import (
    MaterialsOptions,
    PropsOptions,
    show_materials,
    show_props,
)
from dexgarmentlab.cli.assets_robots import (
    ImportRobotOptions,
    ListRobotsOptions,
    import_robot,
    list_robots,
)

__all__ = ["AssetsOptions", "run"]

AssetsOptions = Annotated[
    Annotated[ListOptions, tyro.conf.subcommand("list")]
    | Annotated[ShowOptions, tyro.conf.subcommand("show")]
    | Annotated[BuildOptions, tyro.conf.subcommand("build")]
    | Annotated[PropsOptions, tyro.conf.subcommand("props")]
    | Annotated[MaterialsOptions, tyro.conf.subcommand("materials")]
    | Annotated[ImportGarmentOptions, tyro.conf.subcommand("import")]
    | Annotated[ImportRobotOptions, tyro.conf.subcommand("import-robot")]
    | Annotated[ListRobotsOptions, tyro.conf.subcommand("list-robots")],
    tyro.conf.arg(name=""),
]
"""Options of each action."""


def run(
    options: ListOptions
    | ShowOptions
    | BuildOptions
    | PropsOptions
    | MaterialsOptions
    | ImportGarmentOptions
    | ImportRobotOptions
    | ListRobotsOptions,
) -> int:
    """Do what the action says."""
    if isinstance(options, ListOptions):
        return list_garments(options)
    if isinstance(options, ShowOptions):
        return show(options)
    if isinstance(options, BuildOptions):
        return build(options)
    if isinstance(options, PropsOptions):
        return show_props(options)
    if isinstance(options, MaterialsOptions):
        return show_materials(options)
    if isinstance(options, ImportRobotOptions):
        return import_robot(options)
    if isinstance(options, ListRobotsOptions):
        return list_robots(options)
    return bring(options)
