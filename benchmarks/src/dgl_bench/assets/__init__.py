"""The proof of dgl-assets: garments of every category are measured, dropped and looked at."""

from dgl_bench.assets.attempts import Attempt as Attempt
from dgl_bench.assets.report import count_pictures as count_pictures
from dgl_bench.assets.report import write_report as write_report
from dgl_bench.assets.rows import make_rows as make_rows
from dgl_bench.assets.run import RunConfig as RunConfig
from dgl_bench.assets.run import drop_garments as drop_garments
from dgl_bench.assets.run import load_run as load_run
from dgl_bench.assets.selection import select_ids as select_ids

__all__ = [
    "Attempt",
    "RunConfig",
    "count_pictures",
    "drop_garments",
    "load_run",
    "make_rows",
    "select_ids",
    "write_report",
]
