"""Correspondence without canonical coordinates: learned key points and registration."""

from dgl_gam.skeleton.dataset import SkeletonResult as SkeletonResult
from dgl_gam.skeleton.dataset import measure_registration as measure_registration
from dgl_gam.skeleton.dataset import write_registered as write_registered
from dgl_gam.skeleton.fit import SkeletonConfig as SkeletonConfig
from dgl_gam.skeleton.fit import find_key_points as find_key_points
from dgl_gam.skeleton.fit import fit_skeleton as fit_skeleton
from dgl_gam.skeleton.merger import SkeletonMerger as SkeletonMerger
from dgl_gam.skeleton.merger import compute_composite_chamfer as compute_composite_chamfer
from dgl_gam.skeleton.register import Template as Template
from dgl_gam.skeleton.register import register as register

__all__ = [
    "SkeletonConfig",
    "SkeletonMerger",
    "SkeletonResult",
    "Template",
    "compute_composite_chamfer",
    "find_key_points",
    "fit_skeleton",
    "measure_registration",
    "register",
    "write_registered",
]
