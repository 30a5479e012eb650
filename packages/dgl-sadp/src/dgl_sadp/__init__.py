"""Structure-aware diffusion policies for garments: so far, the data that they will learn from."""

from dgl_sadp.dataset import EpisodeDataset as EpisodeDataset
from dgl_sadp.dataset import split_episodes as split_episodes
from dgl_sadp.errors import CorruptEpisodeError as CorruptEpisodeError
from dgl_sadp.errors import SadpError as SadpError

__all__ = ["CorruptEpisodeError", "EpisodeDataset", "SadpError", "split_episodes"]
