"""Policies behind a websocket: a client for other people's servers, and a server for ours.

Source:
    The wire of openpi's policy server: msgpack with NumPy arrays; the server first sends a map
    about itself, then answers each observation with actions; a text is an error.
"""

from dgl_collect.remote.client import Connection as Connection
from dgl_collect.remote.client import RemotePolicy as RemotePolicy
from dgl_collect.remote.client import check_served as check_served
from dgl_collect.remote.client import is_address as is_address
from dgl_collect.remote.client import make_remote_method as make_remote_method
from dgl_collect.remote.served import ServedSkill as ServedSkill
from dgl_collect.remote.served import ServedStages as ServedStages
from dgl_collect.remote.server import PolicyServer as PolicyServer
