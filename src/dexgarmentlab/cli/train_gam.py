"""`dgl train gam`: train the affordance model."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from dexgarmentlab.cli import EXIT_OK, console

if TYPE_CHECKING:
    from dgl_gam.data import GarmentFolder
    from dgl_gam.schedule import Schedule
    from dgl_gam.train import GamTrainConfig, GamTrainProgress

__all__ = ["TrainGamOptions", "train_gam", "use_threads"]

MAX_THREADS = 1024


@dataclass(frozen=True, kw_only=True)
class TrainGamOptions:
    """Train the affordance model: a network for each category of the data, or one for all of them.

    Each run is a folder of --out: its log, the state to go on from, and network.safetensors at the
    end. Ctrl-C loses the steps since the last state; --resume goes on from there, to the same
    weights.

    Example: dgl train gam --data gam-data --out gam-runs --preset shipped
    """

    data: Path
    """Folder of training data, one file a garment; garments of the split "train" are used."""
    out: Path
    """Folder of the runs, one folder each."""
    together: bool = False
    """Train one network for all categories."""
    category: tuple[str, ...] = ()
    """Only these categories; all of the data when none is named."""
    preset: Literal["cpu", "tune", "yaw", "paper", "shipped"] = "cpu"
    """cpu: small network, from the start; tune: refines the weights of --start; yaw: only their
    estimate of the yaw; paper: the paper's batches; shipped: all stages of the shipped weights, one
    network for all categories."""
    steps: int | None = None
    """Steps, of all stages together; the preset's when not given."""
    start: Path | None = None
    """Weights to start from, .safetensors."""
    seed: int = 0
    """Of the weights and of everything drawn."""
    device: str = "cpu"
    """Device to compute on: cpu or cuda."""
    threads: int | None = None
    """Threads of the CPU; torch decides when not given. Resume with the same number."""
    resume: bool = False
    """Go on with the runs in the folder, and begin those that are missing."""
    json: bool = False
    """Write the result as JSON."""


def train_gam(options: TrainGamOptions) -> int:
    """Train each run, and say where the networks are."""
    import torch

    from dexgarmentlab.gam.runs import TOGETHER
    from dgl_gam.data import GarmentFolder
    from dgl_gam.run_files import CONFIG_FILE

    config = _configure(options)
    if options.preset in ("tune", "yaw") and options.start is None:
        raise ValueError(f"--preset {options.preset} refines other weights: name them with --start")
    if options.device.startswith("cuda") and not torch.cuda.is_available():
        raise ValueError(f"--device {options.device}: torch finds no CUDA device here")
    use_threads(options.threads)
    chosen = options.category or None
    folder = GarmentFolder(options.data, categories=chosen, split="train")
    runs = {TOGETHER: folder}
    if not options.together and options.preset != "shipped":
        runs = {
            name: GarmentFolder(options.data, categories=[name], split="train")
            for name in folder.categories
        }
    begun = [name for name in runs if (options.out / name / CONFIG_FILE).exists()]
    if begun and not options.resume:
        raise FileExistsError(
            f"{options.out} holds the runs {', '.join(begun)} already; give --resume or another "
            "--out"
        )
    if options.resume and not begun:
        raise ValueError(f"{options.out} holds no run to resume")
    results = [_train_one(options, config, name, garments) for name, garments in runs.items()]
    if options.json:
        console.out_json({"runs": results})
    else:
        for result in results:
            console.out(_describe(result))
    return EXIT_OK


def use_threads(count: int | None) -> None:
    """Let torch use so many threads of the CPU; as many as it decides when None."""
    import torch

    if count is None:
        return
    if not 1 <= count <= MAX_THREADS:
        raise ValueError(f"--threads must lie in 1 ... {MAX_THREADS}; got {count}")
    torch.set_num_threads(count)


def _describe(result: dict[str, Any]) -> str:
    """One line of a run."""
    if result["loss"] is None:
        return f"{result['network']}: finished before"
    head = f"{result['network']}: {result['garments']} garments, {result['steps']} steps, "
    if _is_yaw_alone(result["loss"]):
        return head + f"cross entropy of the yaw {result['yaw_loss']:.3f}"
    return head + f"InfoNCE {result['loss']:.3f}, {result['accuracy']:.1%} of the points right"


def _is_yaw_alone(loss: float) -> bool:
    """Say whether the yaw alone was trained: its InfoNCE loss is given as 0."""
    return loss == 0.0


def _configure(options: TrainGamOptions) -> "GamTrainConfig | Schedule":
    """Return the preset, of one stage or several, with the options' steps and seed."""
    from dgl_gam.schedule import SCHEDULES
    from dgl_gam.train import get_train_config

    if options.preset in SCHEDULES:
        schedule = SCHEDULES[options.preset]
        return schedule if options.steps is None else schedule.shorten(options.steps)
    config = dataclasses.replace(get_train_config(options.preset), seed=options.seed)
    return config if options.steps is None else dataclasses.replace(config, steps=options.steps)


def _train_one(
    options: TrainGamOptions,
    config: "GamTrainConfig | Schedule",
    name: str,
    garments: "GarmentFolder",
) -> dict[str, Any]:
    from dgl_gam.run_files import CONFIG_FILE
    from dgl_gam.schedule import Schedule, train_schedule
    from dgl_gam.train import train

    recent: list[GamTrainProgress] = []
    is_resumed = options.resume and (options.out / name / CONFIG_FILE).exists()
    with console.progress(f"training {name}", config.steps) as bar:

        def show(progress: "GamTrainProgress") -> None:
            if recent and _is_yaw_alone(recent[-1].loss) != _is_yaw_alone(progress.loss):
                recent.clear()
            recent.append(progress)
            del recent[:-50]
            loss = sum(p.loss for p in recent) / len(recent)
            yaw_loss = sum(p.yaw_loss for p in recent) / len(recent)
            kind = f"yaw {yaw_loss:.3f}" if _is_yaw_alone(loss) else f"InfoNCE {loss:.3f}"
            note = f"{kind}, {progress.seconds:.2f} s a step"
            bar.reach(progress.step, note=note)

        out = options.out / name
        if isinstance(config, Schedule):
            network = train_schedule(
                garments,
                out,
                config,
                start=options.start,
                seed=options.seed,
                is_resumed=is_resumed,
                device=options.device,
                on_progress=show,
            )
        else:
            network = train(
                garments,
                out,
                config,
                start=options.start,
                is_resumed=is_resumed,
                device=options.device,
                on_progress=show,
            )
    count = len(recent)
    return {
        "name": name,
        "network": str(network),
        "garments": len(garments),
        "steps": config.steps,
        "loss": sum(p.loss for p in recent) / count if count else None,
        "yaw_loss": sum(p.yaw_loss for p in recent) / count if count else None,
        "accuracy": sum(p.accuracy for p in recent) / count if count else None,
    }
