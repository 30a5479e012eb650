"""The proof of dgl-assets: garments of every category are measured, dropped and looked at."""

from dexgarmentlab.bench_assets.attempts import Attempt as Attempt
from dexgarmentlab.bench_assets.report import count_pictures as count_pictures
from dexgarmentlab.bench_assets.report import write_report as write_report
from dexgarmentlab.bench_assets.rows import make_rows as make_rows
from dexgarmentlab.bench_assets.run import RunConfig as RunConfig
from dexgarmentlab.bench_assets.run import drop_garments as drop_garments
from dexgarmentlab.bench_assets.run import load_run as load_run
from dexgarmentlab.bench_assets.selection import select_ids as select_ids

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
