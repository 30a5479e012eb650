"""Collection of garment-manipulation demonstrations: recording, episode files, parallel runs."""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

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
    from dgl_tasks.success import Criterion as Criterion
__all__, __getattr__ = export_lazily(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
