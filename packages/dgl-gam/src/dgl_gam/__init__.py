"""Garment Affordance Model: where on one garment is the point that was shown on another.

The contract that a matcher fulfils, the normal form of the clouds that it sees, the affordance
channels made from its similarities, and the files that it is trained on (`dgl_gam.data`).
"""

from dgl_gam.affordance import compute_affordance as compute_affordance
from dgl_gam.confidence import Calibration as Calibration
from dgl_gam.errors import DataError as DataError
from dgl_gam.errors import GamCheckpointError as GamCheckpointError
from dgl_gam.errors import GamError as GamError
from dgl_gam.errors import WeightsNotFoundError as WeightsNotFoundError
from dgl_gam.matcher import Matcher as Matcher
from dgl_gam.model import GarmentAffordanceModel as GarmentAffordanceModel
from dgl_gam.model import Matches as Matches
from dgl_gam.normalize import Normalization as Normalization
from dgl_gam.normalize import normalize_cloud as normalize_cloud
from dgl_gam.pairs import choose_pair as choose_pair
from dgl_gam.tracking import restrict_to_places as restrict_to_places

__all__ = [
    "Calibration",
    "DataError",
    "GamCheckpointError",
    "GamError",
    "GarmentAffordanceModel",
    "Matcher",
    "Matches",
    "Normalization",
    "WeightsNotFoundError",
    "choose_pair",
    "compute_affordance",
    "normalize_cloud",
    "restrict_to_places",
]
