"""The episodes of a training, divided, and the order of their windows."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dgl_sadp._random import ORDER, Share
from dgl_sadp.config import PolicyConfig
from dgl_sadp.dataset import EpisodeDataset, split_episodes
from dgl_sadp.errors import DamagedEpisodeError
from dgl_sadp.ranges import join_ranges, measure_episodes
from dgl_sadp.train_config import TrainConfig

__all__ = ["Batches", "TrainData"]


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
        stage: int,
        *,
        keep_bytes: int,
    ) -> "TrainData":
        found = EpisodeDataset(
            directory,
            stage,
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
            "stage": self.train.stage,
            "tasks": list(self.tasks),
            "cloud": self.train.episodes[0].cloud,
            "windows": len(self.train),
            "longest": max(episode.frames for episode in self.train.episodes),
            **names,
        }


@dataclass(frozen=True, kw_only=True)
class Batches:
    """Batches of a run, with the share of one process; each epoch has its own order."""

    windows: int
    config: TrainConfig
    process: int = 0
    processes: int = 1

    @property
    def in_epoch(self) -> int:
        """Batches in an epoch."""
        return -(-self.windows // self.config.batch)

    @property
    def steps(self) -> int:
        """Batches in all."""
        return self.in_epoch * self.config.epochs

    def get_share(self, step: int) -> Share:
        """Return which rows of the batch of a step, from 0, the process has."""
        before = step % self.in_epoch * self.config.batch
        return Share.of(min(self.config.batch, self.windows - before), self.process, self.processes)

    def iterate(self, start: int) -> Iterator[list[int]]:
        """Iterate over the process's windows of each batch, from the batch of step `start` on."""
        for epoch in range(start // self.in_epoch, self.config.epochs):
            rng = np.random.default_rng([self.config.seed, ORDER, epoch])
            order = rng.permutation(self.windows).tolist()
            before = epoch * self.in_epoch
            for step in range(max(start, before), before + self.in_epoch):
                share = self.get_share(step)
                first = (step - before) * self.config.batch
                yield order[first + share.start : first + share.stop]
