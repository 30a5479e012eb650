"""Export of episodes to formats of other projects: LeRobot, Diffusion Policy's zarr, robomimic."""

from dgl_collect.exporting.export import Exported as Exported
from dgl_collect.exporting.export import export_episodes as export_episodes
from dgl_collect.exporting.trajectory import Trajectory as Trajectory
from dgl_collect.options import ExportOptions as ExportOptions
