"""Fabrics, floors and woods in code: parameters drawn from a seed, rendered to seamless maps."""

from dgl_assets.materials.colours import PALE as PALE
from dgl_assets.materials.colours import YARNS as YARNS
from dgl_assets.materials.fabric import WEAVES as WEAVES
from dgl_assets.materials.fabric import FabricMaterial as FabricMaterial
from dgl_assets.materials.fabric import sample_fabric_material as sample_fabric_material
from dgl_assets.materials.floor import FLOOR_KINDS as FLOOR_KINDS
from dgl_assets.materials.floor import FloorMaterial as FloorMaterial
from dgl_assets.materials.floor import sample_floor_material as sample_floor_material
from dgl_assets.materials.maps import MaterialMaps as MaterialMaps
from dgl_assets.materials.sheet import draw_material_sheet as draw_material_sheet
from dgl_assets.materials.sheet import sample_materials as sample_materials
from dgl_assets.materials.weaves import Weave as Weave
from dgl_assets.materials.wood import SPECIES as SPECIES
from dgl_assets.materials.wood import WoodMaterial as WoodMaterial
