"""Validation of dgl-physics: experiments with theory beside measurement, as rows and figures."""

from dgl_bench.physics.experiment import Bench as Bench
from dgl_bench.physics.experiment import Experiment as Experiment
from dgl_bench.physics.experiment import Result as Result
from dgl_bench.physics.registry import EXPERIMENTS as EXPERIMENTS
from dgl_bench.physics.registry import run as run
from dgl_bench.physics.registry import select as select
from dgl_bench.rows import Reading as Reading

__all__ = ["EXPERIMENTS", "Bench", "Experiment", "Reading", "Result", "run", "select"]
