"""Hangers, hooks, platforms, stands and tables, generated in code."""

from dgl_assets.props.hanger import CoatHangerParameters as CoatHangerParameters
from dgl_assets.props.hanger import HangerParameters as HangerParameters
from dgl_assets.props.meshes import WOODS as WOODS
from dgl_assets.props.obj import save_obj as save_obj
from dgl_assets.props.person import PersonParameters as PersonParameters
from dgl_assets.props.prop import Finish as Finish
from dgl_assets.props.prop import Prop as Prop
from dgl_assets.props.prop import PropPart as PropPart
from dgl_assets.props.registry import PROP_KINDS as PROP_KINDS
from dgl_assets.props.registry import PropParameters as PropParameters
from dgl_assets.props.registry import make_prop as make_prop
from dgl_assets.props.shapes import PropShape as PropShape
from dgl_assets.props.stands import GloveStandParameters as GloveStandParameters
from dgl_assets.props.stands import HatStandParameters as HatStandParameters
from dgl_assets.props.stands import PothookParameters as PothookParameters
from dgl_assets.props.tables import PlatformParameters as PlatformParameters
from dgl_assets.props.tables import TableParameters as TableParameters
