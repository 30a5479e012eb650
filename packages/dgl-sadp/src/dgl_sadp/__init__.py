"""Structure-aware diffusion policies for garments, baselines, and their data."""

from dgl_sadp.checkpoint import find_policy as find_policy
from dgl_sadp.checkpoint import load_policy as load_policy
from dgl_sadp.checkpoint import read_card as read_card
from dgl_sadp.checkpoint import save_policy as save_policy
from dgl_sadp.config import PolicyConfig as PolicyConfig
from dgl_sadp.config import get_policy_config as get_policy_config
from dgl_sadp.dataset import EpisodeDataset as EpisodeDataset
from dgl_sadp.dataset import split_episodes as split_episodes
from dgl_sadp.errors import CheckpointError as CheckpointError
from dgl_sadp.errors import DamagedEpisodeError as DamagedEpisodeError
from dgl_sadp.errors import EpisodeAccessError as EpisodeAccessError
from dgl_sadp.errors import ObservationError as ObservationError
from dgl_sadp.errors import SadpError as SadpError
from dgl_sadp.errors import TrainingDivergedError as TrainingDivergedError
from dgl_sadp.errors import TrainingProcessError as TrainingProcessError
from dgl_sadp.errors import UnsuitableEpisodeError as UnsuitableEpisodeError
from dgl_sadp.policy import DiffusionPolicy as DiffusionPolicy
from dgl_sadp.runner import PolicyRunner as PolicyRunner
from dgl_sadp.train import TrainProgress as TrainProgress
from dgl_sadp.train import TrainResult as TrainResult
from dgl_sadp.train import train_policy as train_policy
from dgl_sadp.train_config import TrainConfig as TrainConfig
from dgl_sadp.train_config import get_train_config as get_train_config

__all__ = [
    "CheckpointError",
    "DamagedEpisodeError",
    "DiffusionPolicy",
    "EpisodeAccessError",
    "EpisodeDataset",
    "ObservationError",
    "PolicyConfig",
    "PolicyRunner",
    "SadpError",
    "TrainConfig",
    "TrainProgress",
    "TrainResult",
    "TrainingDivergedError",
    "TrainingProcessError",
    "UnsuitableEpisodeError",
    "find_policy",
    "get_policy_config",
    "get_train_config",
    "load_policy",
    "read_card",
    "save_policy",
    "split_episodes",
    "train_policy",
]
