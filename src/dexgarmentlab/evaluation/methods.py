"""The methods that can be evaluated, by name."""

import importlib
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dgl_collect.setup import Setup
    from dgl_tasks.declaration import Task
    from dgl_tasks.policy import Method

__all__ = ["SCRIPTED", "MethodOptions", "check_method", "make_method"]

DEFAULT_ACTIONS = 600
"""Actions that a policy of one's own has for an episode: 50 s."""


@dataclass(frozen=True, kw_only=True)
class MethodOptions:
    """What a method may be told."""

    actions: int = DEFAULT_ACTIONS
    """Most actions of a policy that starts from the parked arms, each five control steps."""

    checkpoints: str | None = None
    """Folder with a trained policy for each stage, for the learned methods."""
    chunks: int | None = None
    """Predictions that each stage gets; as long as the longest recorded stage when None."""
    rounds: int | None = None
    """How often a method goes through the stages at most; as the task says when None."""
    device: str = "cpu"
    """Where policies compute, "cpu" or "cuda"."""

    def __post_init__(self) -> None:
        for name in ("actions", "chunks", "rounds"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} must be at least 1; got {value}")


SCRIPTED = ("nothing", "lift-drop", "expert")
"""Names of the methods without learning."""


def check_method(name: str, task: "Task", options: MethodOptions) -> None:
    """Check a method, or the name of a factory, without making it.

    Raises:
        ValueError: If there is no such method or module, or what it needs is missing or of another kind.
        CheckpointError: If a policy is damaged.
    """
    if name in SCRIPTED:
        return
    from dexgarmentlab.evaluation.learned import METHODS, check_checkpoints

    if name in METHODS:
        if options.checkpoints is None:
            raise ValueError(f"--policy {name} needs --checkpoints, a folder of trained policies")
        check_checkpoints(task, Path(options.checkpoints), use_gam=METHODS[name].use_gam)
        return
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        names = ", ".join([*SCRIPTED, *METHODS])
        raise ValueError(f"--policy must be one of {names}, or module:factory; got {name!r}")
    try:
        found = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # of the package that it would be in
        found = None
    if found is None:
        raise ValueError(f"--policy {name}: there is no module {module} here or on PYTHONPATH")


def make_method(name: str, setup: "Setup", options: MethodOptions) -> "Method":
    """Make a method.

    Args:
        name: One of `SCRIPTED` or of `learned.METHODS`, or `module:factory` of your own, which is called with the environment
            and gives a `Policy` or a `Method` of `dgl_tasks.policy`.
        setup: Environment and demonstration.
        options: What it may be told.

    Raises:
        ValueError: If there is no such method, or what the factory gives has not the methods of a policy.
        ImportError: If the module cannot be imported.
    """
    from dexgarmentlab.evaluation.learned import METHODS, load_actor
    from dgl_collect.actors import Expert, LiftAndDrop
    from dgl_tasks.policy import Nothing

    check_method(name, setup.env.task, options)
    if name == "nothing":
        return Nothing()
    if name == "expert":
        return setup.make_runner(Expert(), rounds=options.rounds)
    if name == "lift-drop":
        first = replace(setup.demonstration, stages=setup.demonstration.stages[:1])
        return setup.make_runner(LiftAndDrop(), rounds=1, tries=1, demonstration=first)
    if name in METHODS:
        actor = load_actor(
            name,
            setup.env.task,
            Path(str(options.checkpoints)),
            chunks=options.chunks,
            device=options.device,
        )
        return setup.make_runner(actor, rounds=options.rounds)
    return _adapt(_load(name)(setup.env), name, options)


def _load(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    factory = getattr(importlib.import_module(module), attribute, None)
    if not callable(factory):
        raise ValueError(f"--policy {name} must name something callable; got {factory!r}")
    return factory


def _adapt(made: object, name: str, options: MethodOptions) -> "Method":
    from dgl_tasks.policy import FromStart, Method, Policy

    if isinstance(made, Method):
        return made
    if isinstance(made, Policy):
        return FromStart(policy=made, actions=options.actions)
    raise ValueError(
        f"--policy {name} must give something with reset and act, or with run; "
        f"got {type(made).__name__}"
    )
