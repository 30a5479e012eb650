"""Batched cloth simulation on NVIDIA Warp, coupled to SAPIEN."""

from dgl_physics.collision_mesh import CollisionMesh as CollisionMesh
from dgl_physics.contact_material import ContactMaterial as ContactMaterial
from dgl_physics.errors import ContactOverflowError as ContactOverflowError
from dgl_physics.errors import MeshError as MeshError
from dgl_physics.errors import PhysicsError as PhysicsError
from dgl_physics.errors import SimulationDivergedError as SimulationDivergedError
from dgl_physics.errors import UnsupportedCpuError as UnsupportedCpuError
from dgl_physics.fabrics import FABRICS as FABRICS
from dgl_physics.fabrics import get_fabric as get_fabric
from dgl_physics.lattice import Skin as Skin
from dgl_physics.material import ClothMaterial as ClothMaterial
from dgl_physics.model import GarmentParticles as GarmentParticles
from dgl_physics.model import Model as Model
from dgl_physics.model import ModelBuilder as ModelBuilder
from dgl_physics.shapes import Shape as Shape
from dgl_physics.solid_material import SolidMaterial as SolidMaterial
from dgl_physics.solver import SolverXPBD as SolverXPBD
from dgl_physics.solver_config import SolverConfig as SolverConfig
from dgl_physics.state import State as State

__all__ = [
    "FABRICS",
    "ClothMaterial",
    "CollisionMesh",
    "ContactMaterial",
    "ContactOverflowError",
    "GarmentParticles",
    "MeshError",
    "Model",
    "ModelBuilder",
    "PhysicsError",
    "Shape",
    "SimulationDivergedError",
    "Skin",
    "SolidMaterial",
    "SolverConfig",
    "SolverXPBD",
    "State",
    "UnsupportedCpuError",
    "get_fabric",
]
