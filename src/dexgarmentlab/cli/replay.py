"""Verb `dgl replay`."""

import math
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro  # noqa: TID253 - marks the positional argument; the command line imports it anyway

from dexgarmentlab.cli import EXIT_FAILURE, EXIT_OK, console
from dexgarmentlab.cli.flags import find_recorded_task
from dgl_collect.options import JointControlMode

if TYPE_CHECKING:
    from dgl_collect.replay import Replay

__all__ = ["ReplayOptions", "run"]


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """Send a recorded episode's commands to the simulation once more, and compare.

    Every recorded joint state, pose, picture and cloud, the garment's particles at the end and the
    verdict are compared. On the machine and with the packages of the record they are equal bit for
    bit. The exit status is 1 when they are not.

    Example: dgl replay out/fold/episodes/FoldTops-v1-s0-00000.h5 --video replay.mp4
    """

    episode: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="EPISODE")]
    """Episode file."""
    tolerance: float = 0.0
    """Largest difference that still counts as reproduced, of joints [rad], poses and particles [m]
    and the rule's value; above 0, pictures and clouds are not looked at."""
    control_mode: JointControlMode = "pd_joint_pos"
    """Actions that the commands are sent as; with `pd_hand_poses`, 22 numbers, the verdict alone
    must be the same."""
    video: Path | None = None
    """File .mp4 to write a film of the replay to."""
    task: str | None = None
    """File or module that declares the task, where it is one of your own."""
    robots: Path | None = None
    """Folder of imported robots, for episodes of a robot that is not built in."""
    json: bool = False
    """Write the comparison as JSON."""


def run(options: ReplayOptions) -> int:
    """Replay, and say how far what came is from what was recorded."""
    from dgl_collect import RunOptions, VideoWriter, read_episode
    from dgl_collect.replay import replay_episode

    if not 0 <= options.tolerance < math.inf:
        raise ValueError(
            f"--tolerance must be a finite number of at least 0; got {options.tolerance:g}"
        )
    episode = read_episode(options.episode)
    find_recorded_task(episode.task, options.task)
    steps = None if episode.commands is None else len(episode.commands)
    with ExitStack() as stack:
        film = None
        if options.video is not None:
            film = stack.enter_context(VideoWriter(options.video)).add
        bar = stack.enter_context(console.progress("replaying", steps))
        replay = replay_episode(
            episode,
            options=RunOptions(robots=options.robots, control_mode=options.control_mode),
            film=film,
            on_step=lambda _: bar.advance(),
        )
    is_same = replay.reproduces(options.tolerance)
    if options.control_mode != "pd_joint_pos":  # rounding alone makes cloth differ
        is_same = not replay.changed_draws and replay.recorded[0] == replay.replayed[0]
    if options.json:
        console.out_json(_to_json(replay, is_same=is_same))
    else:
        _show(replay)
    if is_same:
        return EXIT_OK
    console.error(f"{options.episode} does not reproduce: {_describe_fault(replay)}")
    return EXIT_FAILURE


def _show(replay: "Replay") -> None:
    console.out(f"{replay.task}, seed {replay.seed}, {replay.garment_id}: {replay.steps} steps")
    rows = [
        (d.name, d.count, f"{d.largest:.3g}" if d.largest else "equal", d.unit if d.largest else "")
        for d in replay.differences
    ]
    console.out_table(("array", "numbers", "largest difference", ""), rows)
    for name, pair in (("recorded", replay.recorded), ("replayed", replay.replayed)):
        console.out(f"{name}: {_describe_verdict(*pair)}")


def _describe_verdict(is_success: bool, value: float) -> str:  # noqa: FBT001 - a pair of the record
    return f"{'success' if is_success else 'failure'}, {value:.4f}"


def _describe_fault(replay: "Replay") -> str:
    """Name the first thing that differs."""
    for name, (recorded, replayed) in replay.changed_draws.items():
        return f"draw {name} was {recorded!r} and is {replayed!r}"
    if replay.recorded[0] != replay.replayed[0]:
        was, now = _describe_verdict(*replay.recorded), _describe_verdict(*replay.replayed)
        return f"the verdict was {was} and is {now}"
    worst = next((d for d in replay.differences if d.largest > 0), None)
    if worst is None:
        return f"the value was {replay.recorded[1]} and is {replay.replayed[1]}"
    return f"{worst.name} differs by up to {worst.largest:.3g} {worst.unit}"


def _to_json(replay: "Replay", *, is_same: bool) -> dict[str, object]:
    return {
        "reproduces": is_same,
        "task": replay.task,
        "seed": replay.seed,
        "garment": replay.garment_id,
        "steps": replay.steps,
        "differences": {
            d.name: {
                "numbers": d.count,
                "largest": d.largest if d.largest < float("inf") else None,
                "unit": d.unit,
            }
            for d in replay.differences
        },
        "changed_draws": {name: list(pair) for name, pair in replay.changed_draws.items()},
        "recorded": {"success": replay.recorded[0], "value": replay.recorded[1]},
        "replayed": {"success": replay.replayed[0], "value": replay.replayed[1]},
    }
