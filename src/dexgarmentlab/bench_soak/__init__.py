"""Random actions over every task, for a long time: what goes wrong, and does memory grow?"""

from dexgarmentlab.bench_soak.rows import make_rows as make_rows
from dexgarmentlab.bench_soak.run import SoakConfig as SoakConfig
from dexgarmentlab.bench_soak.run import list_requests as list_requests
from dexgarmentlab.bench_soak.run import soak as soak
from dexgarmentlab.bench_soak.spell import Spell as Spell
