"""People with a skeleton and a smooth skin, made in code, for garments to be put on.

A person stands on z = 0 and faces -y, towards the robots; the person's own left is +x.
"""

from dgl_assets.people.measures import PEOPLE as PEOPLE
from dgl_assets.people.measures import PersonMeasures as PersonMeasures
from dgl_assets.people.measures import sample_person as sample_person
from dgl_assets.people.person import POSES as POSES
from dgl_assets.people.person import Person as Person
from dgl_assets.people.person import make_person as make_person
from dgl_assets.people.skeleton import Skeleton as Skeleton
