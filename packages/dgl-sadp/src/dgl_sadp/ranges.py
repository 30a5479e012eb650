"""Ranges of recorded data, found in one pass that also finds damage and copies."""

import hashlib
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dgl_sadp._episode_file import (
    FRAME_KEYS,
    EpisodeFile,
    FrameSlice,
    StageFile,
    read_frames,
    read_static,
)
from dgl_sadp.dataset import EpisodeDataset
from dgl_sadp.errors import DamagedEpisodeError, UnsuitableEpisodeError
from dgl_sadp.normalizer import Range

__all__ = ["EpisodeRanges", "join_ranges", "measure_episodes"]

logger = logging.getLogger(__name__)

_FRAMES = 32  # Read at a time: 1.6 MB of an environment cloud, 30 MB of pictures.


@dataclass(frozen=True, kw_only=True)
class EpisodeRanges:
    """Result of a pass over a dataset."""

    dataset: EpisodeDataset
    """The episodes that are whole."""
    ranges: tuple[dict[str, Range], ...]
    """Range of each array, an entry for each of its episodes."""
    refused: tuple[DamagedEpisodeError, ...]
    """Errors of the other episodes, by file."""


def measure_episodes(
    dataset: EpisodeDataset,
    keys: Sequence[str],
    *,
    relative_joints: Sequence[int] = (),
    on_progress: Callable[[int, int], None] | None = None,
) -> EpisodeRanges:
    """Read every episode once; leave out damaged ones and copies of others.

    Args:
        dataset: The episodes.
        keys: Arrays to measure, of frames and of the stage; `image` is read, but has no range.
        relative_joints: Joints whose actions are measured relative to where they were when the
            stage began.
        on_progress: Called with the number of episodes done and the number of all.

    Raises:
        ValueError: If no episode is whole, or a key is not recorded.
    """
    whole: list[int] = []
    names: dict[bytes, str] = {}
    ranges: list[dict[str, Range]] = []
    refused: list[DamagedEpisodeError] = []
    for number, episode in enumerate(dataset.episodes):
        try:
            found, digest = _measure_episode(episode, keys, list(relative_joints))
            first = names.setdefault(digest, episode.path.name)
            if first != episode.path.name:
                raise UnsuitableEpisodeError(episode.path, f"it is the same episode as {first}")
            ranges.append(found)
            whole.append(number)
        except DamagedEpisodeError as error:
            logger.warning("left out: %s", error)
            refused.append(error)
        if on_progress is not None:
            on_progress(number + 1, len(dataset.episodes))
    if not whole:
        raise ValueError(f"none of the {len(refused)} episode(s) is whole; the first: {refused[0]}")
    return EpisodeRanges(
        dataset=dataset.select(whole), ranges=tuple(ranges), refused=tuple(refused)
    )


def join_ranges(ranges: Sequence[dict[str, Range]]) -> dict[str, Range]:
    """Return the ranges that cover those of several episodes."""
    joined = dict(ranges[0])
    for other in ranges[1:]:
        joined = {key: found.join(other[key]) for key, found in joined.items()}
    return joined


def _measure_episode(
    episode: EpisodeFile, keys: Sequence[str], relative_joints: list[int]
) -> tuple[dict[str, Range], bytes]:
    """Measure the ranges of arrays over all stages, and the digest of their values."""
    digest = hashlib.blake2b()
    found = [_measure_stage(part, keys, digest) for part in episode.stages]
    if relative_joints and "action" in keys:
        for part, ranges in zip(episode.stages, found, strict=True):
            ranges["action"] = _measure_relative(part, relative_joints)
    return join_ranges(found), digest.digest()


def _measure_stage(
    part: StageFile, keys: Sequence[str], digest: "hashlib.blake2b"
) -> dict[str, Range]:
    found: dict[str, Range] = {}

    def measure(key: str, values: np.ndarray) -> None:
        digest.update(np.ascontiguousarray(values).data)
        if key == "image":
            return
        if values.size == 0:
            raise DamagedEpisodeError(part.path, f"stage_{part.stage}/{key} is empty")
        if not np.isfinite(values).all():
            raise DamagedEpisodeError(
                part.path, f"stage_{part.stage}/{key} has values that are not finite"
            )
        measured = Range.of(values)
        found[key] = found[key].join(measured) if key in found else measured

    of_frames = [key for key in keys if key in FRAME_KEYS]
    for start in range(0, part.frames, _FRAMES):
        frames = FrameSlice(start, min(start + _FRAMES, part.frames))
        for key, values in read_frames(part, dict.fromkeys(of_frames, frames)).items():
            measure(key, values)
    static = read_static(part)
    for key in keys:
        if key in FRAME_KEYS:
            continue
        if key not in static:
            raise ValueError(
                f"{part.path.name} has no {key}, which this policy observes; it has "
                f"{sorted(static)}"
            )
        measure(key, static[key])
    return found


def _measure_relative(part: StageFile, joints: list[int]) -> Range:
    """Measure actions, some joints relative to the start of the stage."""
    whole, first = FrameSlice(0, part.frames), FrameSlice(0, 1)
    frames = read_frames(part, {"action": whole, "joint_state": first})
    actions = frames["action"]
    actions[:, joints] -= frames["joint_state"][:, joints]
    return Range.of(actions)
