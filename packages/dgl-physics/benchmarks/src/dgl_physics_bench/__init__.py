"""The validation of dgl-physics: experiments with theory beside measurement, their rows and figures."""

from dgl_physics_bench.experiment import Bench as Bench
from dgl_physics_bench.experiment import Experiment as Experiment
from dgl_physics_bench.experiment import Result as Result
from dgl_physics_bench.registry import EXPERIMENTS as EXPERIMENTS
from dgl_physics_bench.registry import run as run
from dgl_physics_bench.registry import select as select
from dgl_physics_bench.rows import Row as Row

__all__ = ["EXPERIMENTS", "Bench", "Experiment", "Result", "Row", "run", "select"]
