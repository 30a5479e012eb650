"""`dgl gam eval` and `dgl gam pack`: measure trained networks, and make weights to ship of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from dexgarmentlab.cli import EXIT_OK, console

__all__ = ["GamEvalOptions", "GamPackOptions", "evaluate_models", "pack"]


@dataclass(frozen=True, kw_only=True)
class GamEvalOptions:
    """Measure how well places are found again on garments that the networks have not seen.

    Example: dgl gam eval --data gam-data --weights gam-runs --markdown
    """

    data: Path
    """Folder of training data."""
    weights: Path | None = None
    """File of weights, a folder of them, or of runs; by default the shipped ones."""
    category: tuple[str, ...] = ()
    """Only these categories; all of the data when none is named."""
    split: Literal["train", "test"] = "test"
    """Split of the garments to measure on."""
    pairs: int = 40
    """Pairs of garments for each category and condition."""
    true_yaw: bool = False
    """Give the model the true yaw, which measures the cost of estimating it."""
    seed: int = 0
    """Of everything drawn."""
    device: str = "cpu"
    """Device: cpu or cuda."""
    markdown: bool = False
    """Write the table in Markdown."""
    json: bool = False
    """Print the rows as JSON."""


@dataclass(frozen=True, kw_only=True)
class GamPackOptions:
    """Make weights to ship from finished runs: 16 bit, calibrated, with model cards.

    The confidence is calibrated on garments of the training split; the card's figures are from the
    others.

    Example: dgl gam pack --runs gam-runs --data gam-data --out weights
    """

    runs: Path
    """Folder of runs, as `dgl train gam` made it."""
    data: Path
    """Folder of training data."""
    out: Path
    """Folder for the weights and cards, named by category."""
    samples: Path | None = None
    """Folder for sample clouds: two test garments of each category with a part of their views."""
    pairs: int = 40
    """Pairs of garments for each category and condition, for the card's figures."""
    calibration_pairs: int = 10
    """The same, for the calibration."""
    seed: int = 0
    """Of everything drawn."""
    json: bool = False
    """Write the files and their rows as JSON."""


def evaluate_models(options: GamEvalOptions) -> int:
    """Measure and write the rows."""
    from dexgarmentlab.gam.runs import load_models
    from dgl_gam.data import GarmentFolder
    from dgl_gam.evaluate import EvalConfig, evaluate, format_markdown
    from dgl_gam.trials import list_conditions

    config = EvalConfig(pairs=options.pairs, seed=options.seed, is_yaw_known=options.true_yaw)
    folder = GarmentFolder(options.data, categories=options.category or None, split=options.split)
    models = load_models(options.weights, folder.categories, device=options.device)
    total = sum(len(list_conditions(folder, category)) for category in folder.categories)
    with console.progress("measuring", total) as bar:
        rows = evaluate(
            models,
            folder,
            config,
            on_progress=lambda category, condition: bar.advance(note=f"{category}, {condition}"),
        )
    if options.json:
        console.out_json([row.to_dict() for row in rows])
    elif options.markdown:
        console.out(format_markdown(rows))
    else:
        names = ("category", "condition", "pairs", "mean_error", "pck05", "pck10", "swap_rate")
        names = (*names, "hidden_auroc", "milliseconds")
        console.out_table(
            names,
            [
                [
                    v if isinstance(v, (str, int)) else f"{v:.3g}"
                    for v in (getattr(row, n) for n in names)
                ]
                for row in rows
            ],
        )
    return EXIT_OK


def pack(options: GamPackOptions) -> int:
    """Calibrate, measure and write each run's network."""
    from dataclasses import replace

    from dexgarmentlab.gam.runs import find_runs
    from dexgarmentlab.gam.samples import write_samples
    from dgl_gam import GarmentAffordanceModel
    from dgl_gam.card import format_card
    from dgl_gam.checkpoint import load_checkpoint, save_checkpoint
    from dgl_gam.data import GarmentFolder
    from dgl_gam.evaluate import EvalConfig, calibrate, evaluate
    from dgl_gam.train import NETWORK_FILE

    config = EvalConfig(pairs=options.pairs, seed=options.seed)
    for_calibration = EvalConfig(pairs=options.calibration_pairs, seed=options.seed)
    results = []
    for run in console.track(find_runs(options.runs), "packing"):
        checkpoint = load_checkpoint(run / NETWORK_FILE)
        path = options.out / f"{run.name}.safetensors"
        # What is calibrated and measured is what is shipped: the weights after rounding.
        save_checkpoint(path, checkpoint, is_half=True)
        checkpoint = load_checkpoint(path)
        categories = checkpoint.network.config.categories

        def load(which=checkpoint, names=categories):
            return {name: GarmentAffordanceModel(which, category=name) for name in names}

        trained = GarmentFolder(options.data, categories=categories, split="train")
        checkpoint = replace(checkpoint, calibration=calibrate(load(), trained, for_calibration))
        unseen = GarmentFolder(options.data, categories=categories, split="test")
        rows = evaluate(load(checkpoint), unseen, config)
        save_checkpoint(path, checkpoint, is_half=True)
        card = path.with_suffix(".md")
        card.write_text(format_card(run.name, checkpoint, rows), encoding="utf-8")
        results.append(
            {
                "weights": str(path),
                "card": str(card),
                "bytes": path.stat().st_size,
                "rows": [row.to_dict() for row in rows],
            }
        )
    samples = [] if options.samples is None else write_samples(options.data, options.samples)
    if options.json:
        console.out_json({"packed": results, "samples": [str(path) for path in samples]})
    else:
        for result in results:
            console.out(f"{result['weights']}: {result['bytes'] / 1e6:.2f} MB; {result['card']}")
    return EXIT_OK
