"""The model card of a policy: what it was trained on, how often it succeeds, where it does not."""

import math
from collections.abc import Mapping
from typing import Any

from dgl_sadp.policy import DiffusionPolicy

__all__ = ["format_card"]

_TEMPLATE = """---
license: {license}
library_name: dexgarmentlab
pipeline_tag: robotics
tags: [robotics, diffusion-policy, garment-manipulation]
---

# {name}

A diffusion policy of `dgl_sadp` ({method}) for two UR10e arms with Shadow Hands. Behind the Garment
Affordance Model it is HALO: the model finds the grasp points, the policy does the rest.

| | |
|---|---|
| task | {tasks} |
| stages; longest recordings | {stages}; {longest} frames of 1/12 s |
| parameters | {parameters:,} |
| trained on | {episodes} successful episodes, {windows:,} windows |
| training | {steps:,} steps of {batch} windows, seed {seed} |
| error on {held_out} other episodes | {error} |
| success | {measured} |
| made with | {versions} |

```python
from dexgarmentlab.halo import HALO

halo = HALO.load("{task}")
```

## Limits

The policy was trained in simulation, on the scripted demonstration of its task, with clean clouds
({cloud}, see `--cloud` of `dgl eval`). It knows one robot. Licence: {license}.
"""


def format_card(policy: DiffusionPolicy, card: Mapping[str, Any]) -> str:
    """Write the card of a policy, as Markdown with the metadata that the Hugging Face Hub reads.

    Args:
        policy: The policy.
        card: As `read_card` gives it; `measured`, where it is there, says how often it succeeded,
            and `license` is one of the Hub's names.
    """
    tasks, training = card.get("tasks", ["unknown"]), card.get("training", {})
    error = (card.get("validation") or {}).get("error")
    return _TEMPLATE.format(
        name=f"{policy.config.method.upper()} for {' and '.join(tasks)}",
        method=policy.config.method,
        task=tasks[0],
        tasks=", ".join(tasks),
        stages=policy.config.stages,
        cloud=card.get("cloud", "segmented"),
        longest=" + ".join(map(str, card.get("longest", []))) or "unknown",
        parameters=sum(each.numel() for each in policy.parameters()),
        episodes=len(card.get("episodes", [])),
        windows=card.get("windows", 0),
        steps=card.get("steps_done", 0),
        batch=training.get("batch", "unknown"),
        seed=training.get("seed", "unknown"),
        held_out=len(card.get("validation_episodes", [])),
        error="unknown"
        if error is None
        else f"{math.degrees(error):.2f}°, the mean over joints of commanded targets",
        measured=card.get("measured", "not measured"),
        versions=", ".join(f"{k} {v}" for k, v in card.get("versions", {}).items()) or "unknown",
        license=card.get("license", "unknown"),
    )
