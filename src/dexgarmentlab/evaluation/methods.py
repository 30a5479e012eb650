"""The methods that can be evaluated, by name."""

import importlib
import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dgl_collect.execution import Setup
    from dgl_tasks.declaration import Task
    from dgl_tasks.policy import EpisodePolicy

__all__ = ["METHODS", "MethodOptions", "check_method", "make_method"]

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
    """How often a learned method goes through the stages at most; as the task says when None."""
    device: str = "cpu"
    """Where policies compute, "cpu" or "cuda"."""

    def __post_init__(self) -> None:
        for name in ("actions", "chunks", "rounds"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"{name} must be at least 1; got {value}")


def _make_nothing(setup: "Setup", options: MethodOptions) -> "EpisodePolicy":
    from dgl_tasks.policy import Nothing

    del setup, options
    return Nothing()


def _make_expert(setup: "Setup", options: MethodOptions) -> "EpisodePolicy":
    from dgl_collect.scripted import Expert

    del options
    return Expert(setup=setup)


def _make_lift_drop(setup: "Setup", options: MethodOptions) -> "EpisodePolicy":
    from dgl_collect.scripted import LiftAndDrop

    del options
    return LiftAndDrop(setup=setup)


METHODS: Mapping[str, Callable[["Setup", MethodOptions], "EpisodePolicy"]] = {
    "nothing": _make_nothing,
    "lift-drop": _make_lift_drop,
    "expert": _make_expert,
}
"""Name of a method to what makes it in a worker."""


def check_method(name: str, task: "Task", options: MethodOptions) -> None:
    """Check a method, or the name of a factory, without making it.

    Raises:
        ValueError: If there is no such method or module, or what it needs is missing or of another kind.
        CheckpointError: If a policy is damaged.
    """
    if name in METHODS:
        return
    from dexgarmentlab.evaluation.halo import LEARNED, check_checkpoints

    if name in LEARNED:
        if options.checkpoints is None:
            raise ValueError(f"--policy {name} needs --checkpoints, a folder of trained policies")
        check_checkpoints(task, Path(options.checkpoints), use_gam=LEARNED[name].use_gam)
        return
    module, _, attribute = name.partition(":")
    if not module or not attribute:
        names = ", ".join([*METHODS, *LEARNED])
        raise ValueError(f"--policy must be one of {names}, or module:factory; got {name!r}")
    try:
        found = importlib.util.find_spec(module)
    except ModuleNotFoundError:  # of the package that it would be in
        found = None
    if found is None:
        raise ValueError(f"--policy {name}: there is no module {module} here or on PYTHONPATH")


def make_method(name: str, setup: "Setup", options: MethodOptions) -> "EpisodePolicy":
    """Make a method.

    Args:
        name: One of `METHODS` or of `LEARNED`, or `module:factory` of your own, which is called with the environment and gives
            a `Policy` or an `EpisodePolicy` of `dgl_tasks.policy`.
        setup: Environment and demonstration.
        options: What it may be told.

    Raises:
        ValueError: If there is no such method, or what the factory gives has not the methods of a policy.
        ImportError: If the module cannot be imported.
    """
    if name in METHODS:
        return METHODS[name](setup, options)
    from dexgarmentlab.evaluation.halo import LEARNED, HaloMethod

    check_method(name, setup.env.task, options)
    if name in LEARNED:
        return HaloMethod(
            name,
            setup,
            Path(str(options.checkpoints)),
            chunks=options.chunks,
            rounds=options.rounds,
            device=options.device,
        )
    return _adapt(_load(name)(setup.env), name, options)


def _load(name: str) -> Callable[..., Any]:
    module, _, attribute = name.partition(":")
    factory = getattr(importlib.import_module(module), attribute, None)
    if not callable(factory):
        raise ValueError(f"--policy {name} must name something callable; got {factory!r}")
    return factory


def _adapt(made: object, name: str, options: MethodOptions) -> "EpisodePolicy":
    from dgl_tasks.policy import EpisodePolicy, FromStart, Policy

    if isinstance(made, EpisodePolicy):
        return made
    if isinstance(made, Policy):
        return FromStart(policy=made, actions=options.actions)
    raise ValueError(
        f"--policy {name} must give something with reset and act, or with run; "
        f"got {type(made).__name__}"
    )
