"""Garments with exact correspondence, generated in code.

Robots live in the submodule `dgl_assets.robots`, which is imported explicitly.
"""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

if TYPE_CHECKING:
    from dgl_assets.errors import AssetError as AssetError
    from dgl_assets.errors import AssetNotFoundError as AssetNotFoundError
    from dgl_assets.errors import CacheError as CacheError
    from dgl_assets.errors import MeshingError as MeshingError
    from dgl_assets.garments.building import BuiltGarment as BuiltGarment
    from dgl_assets.garments.building import build_garments as build_garments
    from dgl_assets.garments.catalogue import choose_categories as choose_categories
    from dgl_assets.garments.catalogue import garment_ids as garment_ids
    from dgl_assets.garments.catalogue import list_categories as list_categories
    from dgl_assets.garments.catalogue import load_garment as load_garment
    from dgl_assets.garments.correspondence import correspond as correspond
    from dgl_assets.garments.dresses.parameters import DressParameters as DressParameters
    from dgl_assets.garments.garment import Garment as Garment
    from dgl_assets.garments.gloves.parameters import GloveParameters as GloveParameters
    from dgl_assets.garments.hats.bowl_parameters import BowlHatParameters as BowlHatParameters
    from dgl_assets.garments.hats.cap_parameters import CapParameters as CapParameters
    from dgl_assets.garments.registry import make_garment as make_garment
    from dgl_assets.garments.registry import sample_measures as sample_measures
    from dgl_assets.garments.scarves.garment import ScarfParameters as ScarfParameters
    from dgl_assets.garments.sheet import draw_contact_sheet as draw_contact_sheet
    from dgl_assets.garments.sheet import draw_garment as draw_garment
    from dgl_assets.garments.sheet import save_picture as save_picture
    from dgl_assets.garments.tops.parameters import FrontOpenParameters as FrontOpenParameters
    from dgl_assets.garments.tops.parameters import SleevelessParameters as SleevelessParameters
    from dgl_assets.garments.tops.parameters import TopParameters as TopParameters
    from dgl_assets.garments.trousers.parameters import TrousersParameters as TrousersParameters
    from dgl_assets.garments.uppers.parameters import Armhole as Armhole
    from dgl_assets.garments.uppers.parameters import Body as Body
    from dgl_assets.garments.uppers.parameters import Neck as Neck
    from dgl_assets.garments.uppers.parameters import Opening as Opening
    from dgl_assets.garments.uppers.parameters import Sleeve as Sleeve

__all__, __getattr__ = export_lazily(__name__, __file__)  # pyright: ignore[reportUnsupportedDunderAll]
