"""Collection of garment-manipulation demonstrations: recording, episode files, parallel runs."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dgl_collect.attempt_jobs import AttemptFactory as AttemptFactory
    from dgl_collect.attempt_jobs import AttemptRunner as AttemptRunner
    from dgl_collect.episodes import Episode as Episode
    from dgl_collect.episodes import StageRecord as StageRecord
    from dgl_collect.episodes import read_episode as read_episode
    from dgl_collect.episodes import write_episode as write_episode
    from dgl_collect.errors import CollectionError as CollectionError
    from dgl_collect.errors import CorruptEpisodeError as CorruptEpisodeError
    from dgl_collect.errors import DemonstrationError as DemonstrationError
    from dgl_collect.errors import EngineError as EngineError
    from dgl_collect.errors import MachineError as MachineError
    from dgl_collect.errors import NotReplayableError as NotReplayableError
    from dgl_collect.errors import OutputFolderError as OutputFolderError
    from dgl_collect.errors import WorkerError as WorkerError
    from dgl_collect.options import RecordOptions as RecordOptions
    from dgl_collect.options import RunOptions as RunOptions
    from dgl_collect.recording import EpisodeRecorder as EpisodeRecorder
    from dgl_collect.recording import StageRecorder as StageRecorder
    from dgl_collect.results import AttemptResult as AttemptResult
    from dgl_collect.results import Criterion as Criterion
    from dgl_collect.results import Summary as Summary
    from dgl_collect.results import package_versions as package_versions
    from dgl_collect.results import wilson_interval as wilson_interval
    from dgl_collect.runner import CollectConfig as CollectConfig
    from dgl_collect.runner import Progress as Progress
    from dgl_collect.runner import collect as collect
    from dgl_collect.video import VideoWriter as VideoWriter
    from dgl_collect.video import save_png as save_png
    from dgl_collect.workers import Limits as Limits
    from dgl_collect.workers import Workers as Workers
    from dgl_tasks.observation import Observation as Observation

_MODULES = {
    "AttemptFactory": "dgl_collect.attempt_jobs",
    "AttemptRunner": "dgl_collect.attempt_jobs",
    "Episode": "dgl_collect.episodes",
    "StageRecord": "dgl_collect.episodes",
    "read_episode": "dgl_collect.episodes",
    "write_episode": "dgl_collect.episodes",
    "CollectionError": "dgl_collect.errors",
    "CorruptEpisodeError": "dgl_collect.errors",
    "DemonstrationError": "dgl_collect.errors",
    "EngineError": "dgl_collect.errors",
    "MachineError": "dgl_collect.errors",
    "NotReplayableError": "dgl_collect.errors",
    "OutputFolderError": "dgl_collect.errors",
    "WorkerError": "dgl_collect.errors",
    "RecordOptions": "dgl_collect.options",
    "RunOptions": "dgl_collect.options",
    "EpisodeRecorder": "dgl_collect.recording",
    "StageRecorder": "dgl_collect.recording",
    "AttemptResult": "dgl_collect.results",
    "Criterion": "dgl_collect.results",
    "Summary": "dgl_collect.results",
    "package_versions": "dgl_collect.results",
    "wilson_interval": "dgl_collect.results",
    "CollectConfig": "dgl_collect.runner",
    "Progress": "dgl_collect.runner",
    "collect": "dgl_collect.runner",
    "VideoWriter": "dgl_collect.video",
    "save_png": "dgl_collect.video",
    "Limits": "dgl_collect.workers",
    "Workers": "dgl_collect.workers",
    "Observation": "dgl_tasks.observation",
}
__all__ = list(_MODULES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: options are needed without the simulation."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)
