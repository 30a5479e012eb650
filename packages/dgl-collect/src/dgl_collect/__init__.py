"""Collection of garment-manipulation demonstrations: recording, episode files, parallel runs."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dgl_collect.attempt_jobs import AttemptRequest as AttemptRequest
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
    from dgl_collect.workers import JobRunner as JobRunner
    from dgl_collect.workers import Limits as Limits
    from dgl_collect.workers import Workers as Workers

_NAMES = {
    "attempt_jobs": ("AttemptRequest",),
    "episodes": ("Episode", "StageRecord", "read_episode", "write_episode"),
    "errors": (
        "CollectionError", "CorruptEpisodeError", "DemonstrationError", "EngineError",
        "MachineError", "NotReplayableError", "OutputFolderError", "WorkerError",
    ),
    "options": ("RecordOptions", "RunOptions"),
    "recording": ("EpisodeRecorder", "StageRecorder"),
    "results": ("AttemptResult", "Criterion", "Summary", "package_versions", "wilson_interval"),
    "runner": ("CollectConfig", "Progress", "collect"),
    "video": ("VideoWriter", "save_png"),
    "workers": ("JobRunner", "Limits", "Workers"),
}  # fmt: skip
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = list(_MODULES)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used: options are needed without the simulation."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
