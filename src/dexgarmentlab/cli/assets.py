"""Verb `dgl assets`: its actions are in the modules beside, one subcommand each."""

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
from dexgarmentlab.cli.flags import Actions, join_options, run_action

__all__ = ["AssetsOptions", "run"]

_ACTIONS: Actions = {
    "list": (ListOptions, list_garments),
    "show": (ShowOptions, show),
    "build": (BuildOptions, build),
    "props": (PropsOptions, show_props),
    "materials": (MaterialsOptions, show_materials),
    "import": (ImportGarmentOptions, bring),
    "import-robot": (ImportRobotOptions, import_robot),
    "list-robots": (ListRobotsOptions, list_robots),
}
AssetsOptions = join_options(_ACTIONS)
"""Options of each action."""


def run(options: object) -> int:
    """Do what the action says."""
    return run_action(_ACTIONS, options)
