"""Workers: processes of this machine or of a cluster, for the jobs of a run."""

from dgl_collect.workers.dispatch import Dispatcher as Dispatcher
from dgl_collect.workers.dispatch import Limits as Limits
from dgl_collect.workers.dispatch import check_workers as check_workers
from dgl_collect.workers.dispatch import stop_signals as stop_signals
from dgl_collect.workers.engine import Machine as Machine
from dgl_collect.workers.engine import Workers as Workers
from dgl_collect.workers.jobs import Failure as Failure
from dgl_collect.workers.jobs import Job as Job
from dgl_collect.workers.jobs import JobOutcome as JobOutcome
from dgl_collect.workers.jobs import JobRunner as JobRunner
from dgl_collect.workers.jobs import Work as Work
from dgl_collect.workers.local import end_unguarded_import as end_unguarded_import
