"""The validation of dgl-physics: experiments with theory beside measurement, their rows and figures."""

from dexgarmentlab.bench_physics.experiment import Bench as Bench
from dexgarmentlab.bench_physics.experiment import Experiment as Experiment
from dexgarmentlab.bench_physics.experiment import Result as Result
from dexgarmentlab.bench_physics.registry import EXPERIMENTS as EXPERIMENTS
from dexgarmentlab.bench_physics.registry import run as run
from dexgarmentlab.bench_physics.registry import select as select
from dexgarmentlab.bench_physics.report import write_report as write_report
from dexgarmentlab.bench_physics.rows import Row as Row

__all__ = ["EXPERIMENTS", "Bench", "Experiment", "Result", "Row", "run", "select", "write_report"]
