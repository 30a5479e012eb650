"""Random actions over every task, for a long time: what goes wrong, and does memory grow?"""

from dgl_bench.soak.rows import make_rows as make_rows
from dgl_bench.soak.run import SoakConfig as SoakConfig
from dgl_bench.soak.run import list_requests as list_requests
from dgl_bench.soak.run import soak as soak
from dgl_bench.soak.spell import Spell as Spell
