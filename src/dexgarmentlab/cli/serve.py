"""Verb `dgl serve`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.flags import find_task
from dgl_collect.options import CloudKind

__all__ = ["ServeOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class ServeOptions:
    """Serve a trained policy to `dgl eval --policy ws://HOST:PORT`, on this or another machine.

    Messages are those of openpi's policy server. The affordance model, retries and the arms'
    controller stay with the client. GET /healthz answers OK. Ctrl-C ends the server.

    Example: dgl serve halo FoldTops-v1 --port 8000
    """

    policy: Annotated[
        Literal["primitive", "blind", "halo", "sadp", "gam-dp3", "dp3", "dp"],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="POLICY"),
    ]
    """primitive, blind, halo, sadp, gam-dp3, dp3 or dp."""
    task: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TASK")]
    """The task: an id such as FoldTops-v1, or a file or module of your own that declares one."""
    checkpoints: Path | None = None
    """The folder of a training, or its file. Default of
    primitive, blind and halo: what comes with dgl-sadp."""
    demonstration: Path | None = None
    """A demonstration of your own (JSON). Default: the one that belongs to the task."""
    cloud: CloudKind = "segmented"
    """Clouds that the policy was trained on."""
    host: str = "127.0.0.1"
    """Address to listen at. Anybody who reaches it may use the policy; 0.0.0.0 is everybody."""
    port: int = 8000
    """Port to listen at; 0 takes a free one."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device on which the policy computes."""


def run(options: ServeOptions) -> int:
    """Serve until an interrupt."""
    from dexgarmentlab.learned_methods import METHODS
    from dgl_collect.options import EvaluationOptions
    from dgl_collect.remote import PolicyServer

    if not 0 <= options.port < 2**16:
        raise ValueError(f"--port must be from 0 to 65535; got {options.port}")
    task = find_task(options.task)
    make_served = METHODS[options.policy].prepare_served(
        task,
        EvaluationOptions(
            policy=options.policy,
            checkpoints=options.checkpoints,
            demonstration=options.demonstration,
            cloud=options.cloud,
            device=options.device,
        ),
    )
    try:
        server = PolicyServer(make_served, host=options.host, port=options.port)
    except OSError as err:
        where = f"{options.host}:{options.port}"
        raise ValueError(f"cannot listen at {where}: {err.strerror or err}") from err
    console.out(f"{options.policy} of {task.id} at ws://{options.host}:{server.port}")
    console.flush()
    try:
        server.run()
    except KeyboardInterrupt:
        server.stop()
    return EXIT_OK
