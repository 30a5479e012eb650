"""`dgl train sadp`, `sadp-g`, `dp3` and `dp`: train a policy for all stages of a task."""

import dataclasses
import math
import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from dexgarmentlab.cli import EXIT_OK, console
from dexgarmentlab.cli.train_gam import use_threads

if TYPE_CHECKING:
    from dgl_sadp import TrainProgress, TrainResult
    from dgl_sadp.validation import Validation

__all__ = [
    "TrainDp3Options",
    "TrainDpOptions",
    "TrainPolicyOptions",
    "TrainSadpGOptions",
    "TrainSadpOptions",
    "train_policy",
]


@dataclass(frozen=True, kw_only=True)
class TrainPolicyOptions:
    """Options of every policy's training."""

    method: ClassVar[str]

    data: Path
    """Folder of collected episodes (*.h5); some are kept for validation if there are several."""
    out: Path
    """Folder of the run: policy.safetensors, the state to go on from, and logs for TensorBoard."""
    gam: bool = True
    """Bring the hands to matched grasp points before the policy acts. --no-gam: the policy learns
    the approach, too, from episodes collected with --record approaches, and sees no affordance."""
    preset: Literal["small", "paper"] = "small"
    """small: trains on a CPU; paper: the published sizes, for a large GPU."""
    epochs: int | None = None
    """Passes over all windows; the preset's when not given."""
    batch: int | None = None
    """Windows in a batch; the preset's when not given."""
    precision: Literal["no", "bf16"] = "no"
    """Mixed precision."""
    seed: int = 42
    """Seed of weights and of all random draws."""
    device: Literal["cpu", "cuda"] = "cpu"
    """Device of the computation."""
    devices: int | Literal["auto"] = 1
    """Number of devices that share each batch, which they must divide; one process each. auto: all
    CUDA devices. On the CPU: number of processes. Example: --device cuda --devices 4."""
    threads: int | None = None
    """CPU threads, shared by the processes; torch decides when not given. Resume with the same
    number."""
    workers: int = 0
    """Processes that read episodes beside each one that trains."""
    memory: float = 1.0
    """Memory for frames of episodes [GiB]; those that do not fit are read again each time."""
    resume: bool = False
    """Go on with the run in the folder."""
    json: bool = False
    """Write the result as JSON."""


@dataclass(frozen=True, kw_only=True)
class TrainSadpOptions(TrainPolicyOptions):
    """Train SADP: it observes garment, affordance, object, environment and joints.

    Ctrl-C finishes the step and saves; --resume goes on from there, to the same weights. Episodes
    that are damaged are named and left out.

    Example: dgl train sadp --data out/hang_trousers/episodes --out runs/hang_trousers
    """

    method: ClassVar[str] = "sadp"


@dataclass(frozen=True, kw_only=True)
class TrainSadpGOptions(TrainPolicyOptions):
    """Train SADP_G, for tasks without an object: garment, affordance, environment, joints.

    Ctrl-C finishes the step and saves; --resume goes on from there, to the same weights. Episodes
    that are damaged are named and left out.

    Example: dgl train sadp-g --data out/fold_tops/episodes --out runs/fold_tops
    """

    method: ClassVar[str] = "sadp-g"


@dataclass(frozen=True, kw_only=True)
class TrainDp3Options(TrainPolicyOptions):
    """Train the baseline DP3: it observes environment and joints.

    Ctrl-C finishes the step and saves; --resume goes on from there, to the same weights. Episodes
    that are damaged are named and left out.

    Example: dgl train dp3 --data out/fold_tops/episodes --out runs/fold_tops_dp3
    """

    method: ClassVar[str] = "dp3"


@dataclass(frozen=True, kw_only=True)
class TrainDpOptions(TrainPolicyOptions):
    """Train the baseline DP: it observes the camera picture and joints.

    Ctrl-C finishes the step and saves; --resume goes on from there, to the same weights. Episodes
    that are damaged are named and left out.

    Example: dgl train dp --data out/fold_tops/episodes --out runs/fold_tops_dp
    """

    method: ClassVar[str] = "dp"


def train_policy(options: TrainPolicyOptions) -> int:
    """Train the policy, and say where it is and how it does."""
    import dgl_sadp

    config = dgl_sadp.get_train_config(options.method, options.preset)
    config = dataclasses.replace(
        config,
        epochs=config.epochs if options.epochs is None else options.epochs,
        batch=config.batch if options.batch is None else options.batch,
        precision=options.precision,
        seed=options.seed,
        with_approach=not options.gam,
    )
    policy = dgl_sadp.get_policy_config(options.method, options.preset)
    if policy.garment is not None:
        garment = dataclasses.replace(policy.garment, use_affordance=options.gam)
        policy = dataclasses.replace(policy, garment=garment)
    use_threads(options.threads)
    if not 0 <= options.memory < 2**20:  # Neither NaN nor infinity.
        raise ValueError(f"--memory must be at least 0 GiB; got {options.memory}")
    with console.progress(f"training {options.method}") as bar:
        result = dgl_sadp.train_policy(
            options.data,
            options.out,
            policy,
            config,
            is_resumed=options.resume,
            device=options.device,
            devices=options.devices,
            workers=options.workers,
            keep_bytes=int(options.memory * 2**30),
            on_progress=lambda p: bar.reach(p.step, note=_describe(p), total=p.steps),
        )
    if options.json:
        console.out_json(_as_json(options, result))
    else:
        console.out(_as_text(result))
    if result.validation_episodes == 0 and config.validation_share > 0:
        console.info(_advise_on_validation(options.data, result.policy))
    return EXIT_OK


def _advise_on_validation(data: Path, policy: Path) -> str:
    """Say that nothing was held out to validate on, and how to collect one more episode."""
    import dgl_sadp
    from dgl_collect import OutputFolderError
    from dgl_collect.results import ATTEMPTS_FILE, read_results
    from dgl_collect.run_folder import read_run

    tasks = dgl_sadp.read_card(policy).get("tasks") or ["TASK"]
    folder = data.absolute().parent if data.name in ("", ".") else data.parent
    words, attempts = ["dgl", "collect", tasks[0]], 1
    try:
        run = read_run(folder)
        attempts = len(read_results(folder / ATTEMPTS_FILE))
        told = [shlex.split(command) for command in run.commands]
        told = [command for command in told if command[:2] == ["dgl", "collect"]]
        words = (
            _drop(told[-1], "--episodes", "--out") if told else [*words, "--seed", str(run.seed)]
        )
    except OutputFolderError:  # The episodes are not where a run has put them.
        pass
    words = [word for word in words if word != "--resume"]
    command = shlex.join(
        [*words, "--episodes", str(attempts + 1), "--resume", "--out", str(folder)]
    )
    return (
        "only one episode could be used, and it was trained on: to validate takes one more; "
        f"collect it with `{command}`"
    )


def _drop(words: list[str], *names: str) -> list[str]:
    """Leave out options, each with its value."""
    return [
        word
        for before, word in zip(["", *words], words, strict=False)
        if word not in names and before not in names
    ]


def _describe(progress: "TrainProgress") -> str:
    left = round(progress.seconds_left)
    note = f"epoch {progress.epoch}/{progress.epochs}, loss {progress.loss:.4f}, "
    note += f"{left // 3600}:{left % 3600 // 60:02}:{left % 60:02} left"
    if progress.validation is not None:
        mean, largest = _degrees(progress.validation)
        note += f", validation {mean:.2f} deg, of the worst joint {largest:.2f} deg"
    return note


def _as_json(options: TrainPolicyOptions, result: "TrainResult") -> dict[str, object]:
    validation = result.validation
    mean, largest = (None, None) if validation is None else _degrees(validation)
    return {
        "method": options.method,
        "preset": options.preset,
        "gam": options.gam,
        "policy": str(result.policy),
        "steps": result.steps,
        "loss": None if math.isnan(result.loss) else result.loss,
        "validation_loss": None if validation is None else validation.loss,
        "validation_error_deg": mean,
        "validation_largest_error_deg": largest,
        "episodes": result.episodes,
        "validation_episodes": result.validation_episodes,
        "windows": result.windows,
        "refused": [str(error.path) for error in result.refused],
    }


def _as_text(result: "TrainResult") -> str:
    text = (
        f"{result.policy}: {result.episodes} episodes, {result.steps} steps, loss {result.loss:.4f}"
    )
    if result.validation is not None:
        mean, largest = _degrees(result.validation)
        text += (
            f", {mean:.2f} deg from the commanded targets of {result.validation_episodes} other "
            f"episode(s), {largest:.2f} deg at the worst joint"
        )
    return text


def _degrees(validation: "Validation") -> tuple[float, float]:
    """Errors of a policy [deg]: the mean over all joints, and that of the worst joint."""
    return math.degrees(validation.error), math.degrees(validation.largest_error)
