"""Methods that can be evaluated, by name."""

import dataclasses
import importlib
import importlib.util
from collections.abc import Mapping
from typing import Protocol

from dgl_collect.actors import Expert, LiftAndDrop
from dgl_collect.attempt import Attempts
from dgl_collect.options import EvaluationOptions
from dgl_collect.remote import Connection, check_served, is_address, make_remote_method
from dgl_collect.setup import Setup, make_setup
from dgl_tasks import load_task
from dgl_tasks.declaration import Task
from dgl_tasks.policy import FromStart, Method, Nothing, Policy

__all__ = ["SCRIPTED", "LearnedMethod", "check_method", "make_evaluation_attempts", "make_method"]

SCRIPTED = ("nothing", "lift-drop", "expert")
"""Names of the methods without learning."""


class LearnedMethod(Protocol):
    """A method that is loaded from files."""

    def check(self, task: Task, options: EvaluationOptions) -> None:
        """Check, without loading weights, that its files fit the task.

        Raises:
            ValueError: If one is missing, or of another stage or task.
        """
        ...

    def make(self, setup: Setup, options: EvaluationOptions) -> Method:
        """Make the method; raises as `check` does."""
        ...


LearnedMethods = Mapping[str, LearnedMethod]
"""Learned methods by name. This package has none; the caller passes them in."""


def make_evaluation_attempts(
    task: str, options: EvaluationOptions, learned: LearnedMethods
) -> Attempts:
    """Build the attempts of an evaluation; see `dgl_collect.CollectConfig.attempt_factory`."""
    declared = load_task(task)
    material = declared.material
    material = dataclasses.replace(
        material,
        friction=options.friction * material.friction,
        adhesion=options.friction * material.adhesion,
    )
    setup = make_setup(dataclasses.replace(declared, material=material), options)
    method = make_method(setup, options, learned)
    return Attempts(setup, method, recorded=None, garments=options.garments)


def check_method(task: Task, options: EvaluationOptions, learned: LearnedMethods) -> None:
    """Check the method of an evaluation without making it.

    Raises:
        ValueError: If the method or module is unknown, or its checkpoints are missing or unfit.
    """
    name = options.policy
    if name not in learned and options.checkpoints is not None:
        raise ValueError(f"--checkpoints are of a learned method; got --policy {name}")
    if options.device == "cuda" and not _has_cuda():
        raise ValueError("--device cuda needs a GPU with CUDA, which is not here; use cpu")
    if name in SCRIPTED:
        return
    if is_address(name):
        connection = Connection(name)
        try:
            connection.open()
            check_served(connection, task, options.cloud)
        finally:
            connection.close()
        return
    if name in learned:
        learned[name].check(task, options)
        return
    module, _, attribute = name.partition(":")
    if not module or not attribute or attribute.startswith("//"):
        names = ", ".join([*SCRIPTED, *learned])
        raise ValueError(
            f"--policy must be one of {names}, module:factory, or ws://HOST:PORT; got {name!r}"
        )
    try:
        found = importlib.util.find_spec(module)
    except (ImportError, ValueError):  # of the package that it would be in
        found = None
    if found is None:
        raise ValueError(f"--policy {name}: there is no module {module} here or on PYTHONPATH")


def _has_cuda() -> bool:
    import torch

    return torch.cuda.is_available()


def make_method(setup: Setup, options: EvaluationOptions, learned: LearnedMethods) -> Method:
    """Make the method of an evaluation.

    Args:
        setup: Environment and demonstration.
        options: `policy` is one of `SCRIPTED` or `learned`, or `module:factory` of your own, which
            is called with the environment and gives a `Policy` or a `Method` of `dgl_tasks.policy`,
            or the address of a policy server.
        learned: Learned methods by name.

    Raises:
        ValueError: If there is no such method, or the factory gives something else.
        ImportError: If the module cannot be imported.
    """
    task, name = setup.env.task, options.policy
    check_method(task, options, learned)
    if name == "nothing":
        return Nothing()
    if name == "expert":
        return setup.make_runner(Expert())
    if name == "lift-drop":
        first = dataclasses.replace(setup.demonstration, stages=setup.demonstration.stages[:1])
        return setup.make_runner(LiftAndDrop(), rounds=1, tries=1, demonstration=first)
    if is_address(name):
        return make_remote_method(setup, options)
    if name in learned:
        return learned[name].make(setup, options)
    module, _, attribute = name.partition(":")
    factory = getattr(importlib.import_module(module), attribute, None)
    if not callable(factory):
        raise ValueError(f"--policy {name} must name something callable; got {factory!r}")
    made = factory(setup.env)
    if isinstance(made, Method):
        return made
    if isinstance(made, Policy):
        return FromStart(policy=made, actions=options.actions, control_mode=options.control_mode)
    raise ValueError(
        f"--policy {name} must give something with reset and act, or with run; "
        f"got {type(made).__name__}"
    )
