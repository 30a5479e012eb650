"""Command line `dgl`: finds the verb, parses its options and turns errors into exit statuses.

A verb is one module in this package and one line in `VERBS`. The module defines

* `<Verb>Options` (`CollectOptions` for `collect`): a frozen keyword-only dataclass, or a union of
  them. Its docstring, with an example, is the verb's help; its fields are the arguments
  (`tyro.conf.Positional[str]` for a positional one);
* `run(options) -> int`: does the work and returns the exit status.

Verb modules import the packages that they need inside `run`, so that `dgl --help` stays quick.
"""

import difflib
import importlib
import logging
import os
import shutil
import sys
import traceback
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any

from dexgarmentlab.cli import console

__all__ = ["VERBS", "Verb", "main"]

EXIT_OK = 0
EXIT_FAILURE = 1  # The job could not be done: the message says why.
EXIT_USAGE = 2  # The command line was wrong, as argparse and tyro have it.
EXIT_INTERNAL = 70  # A defect of this program (EX_SOFTWARE).
EXIT_INTERRUPTED = 130  # Ctrl-C, as shells have it.
EXIT_PIPE = 141  # Nobody reads the output any more (SIGPIPE), as shells have it.

_LEAST_COLUMNS = 40  # tyro takes minutes to lay out help in a terminal of one column.

_OWN_PACKAGES = frozenset(
    {
        "dexgarmentlab",
        "dgl_files",
        "dgl_physics",
        "dgl_assets",
        "dgl_gam",
        "dgl_sadp",
        "dgl_tasks",
        "dgl_collect",
    }
)


@dataclass(frozen=True)
class Verb:
    """One verb of the command line."""

    name: str
    """Word on the command line, and name of the module in this package."""
    summary: str
    """One line for `dgl --help`."""

    def load(self) -> ModuleType:
        """Import the module that implements the verb."""
        return importlib.import_module(f"{__name__}.{self.name}")


VERBS: tuple[Verb, ...] = (
    Verb("doctor", "what works on this machine, and the fix for what does not"),
    Verb("demo", "collect one Fold Tops demonstration, with its video and a report"),
    Verb("tasks", "the tasks, with their stages, success rules and garments"),
    Verb("assets", "garments: list, draw and build them, or import your own from mesh files"),
    Verb("collect", "collect demonstrations of a task automatically"),
    Verb("verify", "check the folder of a collection or an evaluation: is everything whole?"),
    Verb("replay", "re-run a recorded episode from its file and compare"),
    Verb("relabel", "give episodes the affordance that the affordance model sees in them"),
    Verb("export", "write episodes as a data set of LeRobot, Diffusion Policy (zarr) or robomimic"),
    Verb("check", "do exported actions succeed in the environment that evaluates policies?"),
    Verb("eval", "evaluate a method on a task: several seeds, seen and unseen garments"),
    Verb("serve", "serve a trained policy to evaluations on this or another machine"),
    Verb("view", "look at garments, tasks and episodes in the browser"),
    Verb("compare", "compare evaluations episode by episode: is one method better than another?"),
    Verb("tune", "search for better parameters of a demonstration in simulation"),
    Verb("train", "train the affordance model or a policy: primitive, sadp, sadp-g, dp3, dp"),
    Verb("gam", "the affordance model: match two garments, measure networks, pack weights"),
    Verb("bench", "measure this machine: the numbers that the documentation quotes"),
)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        argv: Arguments without the program's name; `sys.argv[1:]` when None.

    Returns:
        The exit status: 0 done, 1 failed with a message, 2 wrong usage, 70 a defect, 130
            interrupted.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    is_debug = "--debug" in arguments
    arguments = [argument for argument in arguments if argument != "--debug"]
    # One line a record on stderr; libraries log through module loggers and never configure them.
    logging.basicConfig(
        level=logging.DEBUG if is_debug else logging.WARNING,
        format="%(levelname)s %(name)s: %(message)s",
    )
    console.write_utf8()
    if shutil.get_terminal_size().columns < _LEAST_COLUMNS:
        os.environ["COLUMNS"] = str(_LEAST_COLUMNS)
    try:
        status = _dispatch(arguments)
        console.flush()
        return status
    except SystemExit as stop:  # tyro ends so, after --help (0) and after a usage error (2).
        return stop.code if isinstance(stop.code, int) else EXIT_USAGE
    except KeyboardInterrupt:
        console.error("interrupted")
        return EXIT_INTERRUPTED
    except Exception as error:
        if isinstance(error, BrokenPipeError) and console.drop_closed_pipes():
            return EXIT_PIPE
        if is_debug:
            console.error(traceback.format_exc().rstrip())
        if is_domain_error(error):
            console.error(_one_line(error) + _tell_cache(error))
            return EXIT_FAILURE
        if isinstance(error, ModuleNotFoundError) and not _is_own(error.name or ""):
            console.error(f"{error.name} is not installed; in a clone, `make setup` installs it")
            return EXIT_FAILURE
        console.error(
            f"internal error, {type(error).__name__}: {_one_line(error)}"
            + ("" if is_debug else " (repeat with --debug for the traceback)")
        )
        return EXIT_INTERNAL


def is_domain_error(error: BaseException) -> bool:
    """Say whether an exception is a message to the user rather than a defect.

    Such are `ValueError`, `OSError`, and every class defined in the `errors` module of one of our
    packages. The packages are recognised by name, so that none of them has to be imported to handle
    the error of another.
    """
    if isinstance(error, (ValueError, OSError)):
        return True
    for base in type(error).__mro__:
        package, _, rest = base.__module__.partition(".")
        if package in _OWN_PACKAGES and rest.split(".")[-1] == "errors":
            return True
    return False


def _is_own(module: str) -> bool:
    return module.partition(".")[0] in _OWN_PACKAGES


def _dispatch(arguments: list[str]) -> int:
    if not arguments or arguments[0] in {"-h", "--help", "help"}:
        console.out(_help())
        return EXIT_OK if arguments else EXIT_USAGE
    if arguments[0] == "--version":
        console.out(f"dexgarmentlab {metadata.version('dexgarmentlab')}")
        return EXIT_OK
    name, rest = arguments[0], arguments[1:]
    verb = next((verb for verb in VERBS if verb.name == name), None)
    if verb is None:
        console.error(_unknown(name))
        return EXIT_USAGE

    module = verb.load()
    options = read_options(verb, rest)
    with console.keep_results_alone():
        return int(module.run(options))


def read_options(verb: Verb, words: Sequence[str]) -> Any:
    """Parse the options of a verb.

    Raises:
        SystemExit: If they are wrong, once stderr has told why.
    """
    import tyro

    options = getattr(verb.load(), f"{verb.name.capitalize()}Options")
    return tyro.cli(options, prog=f"dgl {verb.name}", args=words)


def _help() -> str:
    width = max(len(verb.name) for verb in VERBS)
    verbs = "\n".join(f"  {verb.name:<{width}}  {verb.summary}" for verb in VERBS)
    return (
        "usage: dgl VERB [options]\n\n"
        "The open, run-anywhere laboratory for dexterous garment manipulation.\n\n"
        f"verbs:\n{verbs}\n\n"
        "`dgl VERB --help` explains one verb. `--debug` shows the traceback of an error.\n\n"
        f"example: dgl {VERBS[0].name}"
    )


def _unknown(name: str) -> str:
    names = [verb.name for verb in VERBS]
    closest = difflib.get_close_matches(name, names, n=1, cutoff=0.6)
    hint = f" Did you mean `dgl {closest[0]}`?" if closest else ""
    return f"unknown verb {name!r}.{hint} The verbs are: {', '.join(names)}."


def _one_line(error: BaseException) -> str:
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.errno is not None and error.strerror:
        of = "" if error.filename is None else f": {os.fsdecode(error.filename)}"
        text = error.strerror + of  # without its number
    return text or type(error).__name__


def _tell_cache(error: BaseException) -> str:
    """Name the variable that moves the cache, where the error is that it cannot be written."""
    from dexgarmentlab.doctor import get_cache_folder

    if not isinstance(error, OSError) or error.filename is None or "CACHE" in str(error):
        return ""
    cache, path = get_cache_folder(), Path(os.fsdecode(error.filename))
    if path != cache and path not in cache.parents and cache not in path.parents:
        return ""
    return f"; the cache is {cache}: set XDG_CACHE_HOME to a folder that can be written to"
