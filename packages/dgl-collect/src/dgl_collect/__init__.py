"""Collection of garment-manipulation demonstrations: recording, episode files, parallel runs."""

from dgl_collect.attempts import AttemptFactory as AttemptFactory
from dgl_collect.attempts import AttemptRunner as AttemptRunner
from dgl_collect.episodes import Episode as Episode
from dgl_collect.episodes import StageRecord as StageRecord
from dgl_collect.episodes import read_episode as read_episode
from dgl_collect.episodes import write_episode as write_episode
from dgl_collect.errors import CollectionError as CollectionError
from dgl_collect.errors import CorruptEpisodeError as CorruptEpisodeError
from dgl_collect.errors import DemonstrationError as DemonstrationError
from dgl_collect.errors import NotReplayableError as NotReplayableError
from dgl_collect.errors import OutputFolderError as OutputFolderError
from dgl_collect.errors import UnknownTaskError as UnknownTaskError
from dgl_collect.errors import WorkerError as WorkerError
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
from dgl_tasks.observation import Observation as Observation
