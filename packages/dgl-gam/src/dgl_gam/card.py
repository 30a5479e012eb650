"""The model card: what a network was trained on, how well it works, and where it does not."""

from collections.abc import Mapping, Sequence
from typing import Any

from dgl_gam.checkpoint import Checkpoint
from dgl_gam.evaluate import Row, format_markdown

__all__ = ["format_card"]

_TEMPLATE = """# {name}

Weights of the Garment Affordance Model of `dgl_gam`: dense correspondence between clouds of
garments of one category.

| | |
|---|---|
| categories | {categories} |
| parameters | {parameters:,} |
| features of a point | {features} |
| trained on | {trained} |
| states | {states} |
| data made with | {generators} |
| seed | {seed} |
| confidence | {calibration} |
| made with | {versions} |

```python
from dgl_gam import GarmentAffordanceModel

model = GarmentAffordanceModel.load("{name}.safetensors"{category})
indices, similarity = model.match(demonstrated_cloud, points, observed_cloud)
```

## How well it works

On garments that it was not trained on. Errors are shares of the garment's horizontal diagonal; the
conditions and the columns are explained in `docs/gam.md`. `noise_any`, and hanging states with
`_any`, are the stricter readings of `noise_half` and of the others.

{table}

## Limits

A match is returned for a hidden point too: look at its confidence. Trained on generated garments;
asymmetric, torn or heavily decorated ones are outside of its training. Licence: Apache-2.0.
"""


def format_card(name: str, checkpoint: Checkpoint, rows: Sequence[Row]) -> str:
    """Write the card of a network.

    Args:
        name: Name of the file without its ending.
        checkpoint: The network, with the card that training left in it.
        rows: How well it works, see `dgl_gam.evaluate`.

    Returns:
        Markdown.
    """
    config, card = checkpoint.network.config, checkpoint.card
    train = card.get("train", {})
    samples = checkpoint.calibration.samples
    several = len(config.categories) > 1
    return _TEMPLATE.format(
        name=name,
        categories=", ".join(config.categories),
        parameters=sum(p.numel() for p in checkpoint.network.parameters()),
        features=config.features,
        trained="; then ".join(
            f"{part.get('garments', 'unknown')} garments, {part.get('deformed', 'unknown')} of "
            "them "
            f"with deformed states: {part.get('steps_done', 'unknown')} steps{_name_parts(part)}"
            for part in (*card.get("earlier", []), card)
        ),
        states=", ".join(card.get("states", [])) or "unknown",
        generators=", ".join(card.get("generators", [])) or "unknown",
        seed=train.get("seed", "unknown"),
        calibration=f"calibrated on {samples:,} matches" if samples else "not calibrated",
        versions=", ".join(f"{k} {v}" for k, v in card.get("versions", {}).items()) or "unknown",
        category=f', category="{config.categories[0]}"' if several else "",
        table=format_markdown(rows, is_timed=False),
    )


def _name_parts(part: Mapping[str, Any]) -> str:
    """Describe the trained part of the network if it was not the whole."""
    parts = part.get("parts", part.get("train", {}).get("parts", "all"))
    return {"yaw": " of the yaw alone", "features": " of the features alone"}.get(parts, "")
