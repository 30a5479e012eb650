"""The episodes of a training, divided, and the order of their windows."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dgl_sadp._episode_file import STATIC_KEYS
from dgl_sadp._random import ORDER, Share
from dgl_sadp.config import PolicyConfig
from dgl_sadp.dataset import EpisodeDataset, split_episodes
from dgl_sadp.errors import DamagedEpisodeError
from dgl_sadp.ranges import join_ranges, measure_episodes
from dgl_sadp.train_config import TrainConfig

__all__ = ["Batches", "TrainData", "collate_windows"]


@dataclass(frozen=True, kw_only=True)
class TrainData:
    """Episodes for a run, divided."""

    train: EpisodeDataset
    validation: EpisodeDataset | None
    ranges: Mapping[str, Any]
    refused: tuple[DamagedEpisodeError, ...]
    tasks: tuple[str, ...]

    @classmethod
    def open(
        cls,
        directory: str | Path,
        policy: PolicyConfig,
        config: TrainConfig,
        *,
        keep_bytes: int,
    ) -> "TrainData":
        found = EpisodeDataset(
            directory,
            policy.horizon,
            policy.observation_steps,
            policy.action_steps,
            observation_keys=policy.frame_keys,
            keep_bytes=keep_bytes,
            skip_corrupt=True,
            with_approach=config.with_approach,
        )
        measured = measure_episodes(
            found,
            ("action", *policy.frame_keys, *policy.stage_keys),
            relative_joints=policy.relative_joints,
        )
        whole = measured.dataset
        count = len(whole.episodes)
        train, validation = np.arange(count), np.arange(0)
        if config.validation_share > 0 and count > 1:  # One episode is all to be trained on.
            train, validation = split_episodes(count, config.validation_share, config.split_seed)
        held_out = whole.select(validation) if len(validation) else None
        if held_out is not None:
            held_out.keep_bytes = 0  # A few windows now and then: the memory is for training.
        return cls(
            train=whole.select(train),
            validation=held_out,
            ranges=join_ranges([measured.ranges[number] for number in train]),
            refused=(*found.refused, *measured.refused),
            tasks=tuple(sorted({episode.task for episode in whole.episodes})),
        )

    def describe(self) -> dict[str, Any]:
        """Name what a run learns from."""
        parts = {"episodes": self.train, "validation_episodes": self.validation}
        names = {
            key: [] if part is None else [episode.path.name for episode in part.episodes]
            for key, part in parts.items()
        }
        return {
            "tasks": list(self.tasks),
            "cloud": self.train.episodes[0].cloud,
            "windows": len(self.train),
            "longest": [
                max(part.frames for part in stage)
                for stage in zip(*(episode.stages for episode in self.train.episodes), strict=True)
            ],
            **names,
        }


@dataclass(frozen=True, kw_only=True)
class Batches:
    """Batches of a run, with the share of one process; each epoch has its own order.

    Windows come in groups of one part of the dataset, such as one stage of one episode.
    """

    counts: np.ndarray
    """Number of windows of each part of the dataset, shape (P,)."""
    config: TrainConfig
    process: int = 0
    processes: int = 1

    @property
    def in_epoch(self) -> int:
        """Batches in an epoch."""
        return -(-self._groups * self.config.group // self.config.batch)

    @property
    def steps(self) -> int:
        """Batches in all."""
        return self.in_epoch * self.config.epochs

    def get_share(self, step: int) -> Share:
        """Return which rows of the batch of a step, from 0, the process has."""
        most = self.config.batch // self.config.group
        groups = min(most, self._groups - step % self.in_epoch * most)
        return Share.of(groups, self.process, self.processes).multiply(self.config.group)

    def iterate(self, start: int) -> Iterator[list[int]]:
        """Iterate over the process's windows of each batch, from the batch of step `start` on."""
        firsts = np.cumsum(self.counts) - self.counts
        for epoch in range(start // self.in_epoch, self.config.epochs):
            rng = np.random.default_rng([self.config.seed, ORDER, epoch])
            groups = [
                self._divide(first + rng.permutation(count))
                for first, count in zip(firsts, self.counts, strict=True)
            ]
            order = rng.permutation(np.concatenate(groups)).ravel().tolist()
            before = epoch * self.in_epoch
            for step in range(max(start, before), before + self.in_epoch):
                share = self.get_share(step)
                first = (step - before) * self.config.batch
                yield order[first + share.start : first + share.stop]

    @property
    def _groups(self) -> int:
        return int((-(-self.counts // self.config.group)).sum())

    def _divide(self, windows: np.ndarray) -> np.ndarray:
        """Divide windows, shape (W,), into groups; the first ones fill up the last group."""
        group = self.config.group
        return np.resize(windows, (-(-len(windows) // group), group))


def collate_windows(windows: Sequence[Mapping[str, np.ndarray]], group: int) -> dict[str, Tensor]:
    """Stack windows; of what is stored once in a stage, a row for each group of them."""
    kept = [
        window if number % group == 0 else {k: v for k, v in window.items() if k not in STATIC_KEYS}
        for number, window in enumerate(windows)
    ]
    return {
        key: torch.from_numpy(np.stack([window[key] for window in kept if key in window]))
        for key in windows[0]
    }
