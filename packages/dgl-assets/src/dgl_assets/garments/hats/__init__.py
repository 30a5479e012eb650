"""Hats as elastic shells: baseball caps and bowl hats.

They stand on their opening: z up, the lowest point at z = 0, centred in x and y by the bounding
box. A visor points to -y, towards the robots; "left" is at -x.
"""

from dgl_assets.garments.hats.bowl import make_bowl_hat as make_bowl_hat
from dgl_assets.garments.hats.bowl_parameters import BowlHatParameters as BowlHatParameters
from dgl_assets.garments.hats.bowl_sampling import sample_bowl_hat as sample_bowl_hat
from dgl_assets.garments.hats.cap import make_cap as make_cap
from dgl_assets.garments.hats.cap_parameters import CapParameters as CapParameters
from dgl_assets.garments.hats.cap_sampling import sample_cap as sample_cap
