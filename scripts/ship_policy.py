"""Put a trained policy into `dgl_sadp`, in 16 bits, with its card and how often it succeeded.

Usage: python scripts/ship_policy.py RUN EVALUATION

RUN is the folder of `dgl train sadp-g`, EVALUATION that of `dgl eval --policy halo`. It writes
NAME.safetensors and NAME.md, NAME being the task's.
"""

import json
import sys
from pathlib import Path

from dgl_sadp import load_policy, read_card, save_policy
from dgl_sadp.card import format_card

FOLDER = Path(__file__).parents[1] / "packages/dgl-sadp/src/dgl_sadp/policies"


def main(run: Path, evaluation: Path) -> None:
    """Write the policy and its card."""
    policy, card = load_policy(run), read_card(run)
    found = json.loads((evaluation / "results.json").read_text(encoding="utf-8"))
    (task,) = card["tasks"]
    if (found["task"], found["policy"], found["status"]) != (task, "halo", "complete"):
        raise SystemExit(f"{evaluation} must be a complete evaluation of halo on {task}")
    if found["checkpoints"] != str(run):
        raise SystemExit(f"{evaluation} must be of {run}; got one of {found['checkpoints']}")
    count = found["success"]
    card["license"] = "apache-2.0"
    card["measured"] = (
        f"{count['first_try']} of {count['episodes']} episodes at the first try, "
        f"{count['succeeded']} with retries; garments: {found['garments']}, matcher: "
        f"{found['matcher']}, seeds: {', '.join(map(str, found['seeds']))}"
    )
    path = FOLDER / f"{task.partition('-')[0]}.safetensors"
    save_policy(path, policy, card, is_half=True)
    path.with_suffix(".md").write_text(format_card(policy, card), encoding="utf-8")
    print(path, path.stat().st_size)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
