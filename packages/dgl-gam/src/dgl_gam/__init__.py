"""Garment Affordance Model: where on one garment is the point that was shown on another.

What exists so far is what surrounds the model: the contract that a matcher fulfils, the normal form of the clouds
that it sees, and the affordance channels made from its similarities.
"""

from dgl_gam.affordance import compute_affordance as compute_affordance
from dgl_gam.errors import GamError as GamError
from dgl_gam.matcher import Matcher as Matcher
from dgl_gam.normalize import Normalization as Normalization
from dgl_gam.normalize import normalize_cloud as normalize_cloud

__all__ = ["GamError", "Matcher", "Normalization", "compute_affordance", "normalize_cloud"]
