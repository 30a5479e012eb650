"""Garments with exact correspondence, generated in code.

Robots live in the submodule `dgl_assets.robots`, which is imported explicitly.
"""

from dgl_assets.errors import AssetError as AssetError
from dgl_assets.errors import AssetNotFoundError as AssetNotFoundError
from dgl_assets.errors import MeshingError as MeshingError
from dgl_assets.garments.catalogue import garment_ids as garment_ids
from dgl_assets.garments.catalogue import list_categories as list_categories
from dgl_assets.garments.catalogue import load_garment as load_garment
from dgl_assets.garments.correspondence import correspond as correspond
from dgl_assets.garments.garment import Garment as Garment
from dgl_assets.garments.tops.parameters import TopParameters as TopParameters
from dgl_assets.garments.tops.sampling import sample_top as sample_top
from dgl_assets.garments.tops.garment import make_top as make_top
