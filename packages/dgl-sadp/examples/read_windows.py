"""Read collected episodes as training windows, and keep some episodes for validation.

Example: python examples/read_windows.py out/fold_tops/episodes
"""

import sys
from pathlib import Path

from dgl_sadp import EpisodeDataset, split_episodes


def main(directory: Path) -> dict[str, object]:
    """Return how many episodes and windows there are, and the shape of a window's actions."""
    dataset = EpisodeDataset(directory)
    train, validation = (
        dataset.select(part) for part in split_episodes(len(dataset.episodes), seed=0)
    )
    return {
        "episodes": len(dataset.episodes),
        "failed": len(dataset.failed),
        "training_windows": len(train),
        "validation_windows": len(validation),
        "action": train[0]["action"].shape,
    }


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python read_windows.py FOLDER_OF_EPISODES")
    print(main(Path(sys.argv[1])))
