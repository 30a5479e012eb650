"""Time of attempts made as `dgl collect` makes them, by component."""

from dgl_bench.collect.measure import Plan as Plan
from dgl_bench.collect.measure import make_attempts as make_attempts
from dgl_bench.collect.measure import measure_collection as measure_collection

__all__ = ["Plan", "make_attempts", "measure_collection"]
