"""Meshes of all robot links as binary glTF, generated in code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from dgl_assets.robots._solids import Solid, shade
from dgl_assets.robots.hand import HAND_MASS
from dgl_assets.robots.tree import Side
from dgl_assets.robots.visual_arm import build_arm_solids, build_pedestal_solids
from dgl_assets.robots.visual_hand import build_hand_solids

if TYPE_CHECKING:
    from trimesh.visual.material import PBRMaterial


FINISHES: dict[str, tuple[tuple[float, float, float], float, float]] = {
    "aluminium": ((0.52, 0.54, 0.56), 0.35, 0.42),
    "tube": ((0.62, 0.63, 0.65), 0.35, 0.35),
    "cap": ((0.12, 0.36, 0.52), 0.0, 0.45),
    "seal": ((0.015, 0.015, 0.017), 0.0, 0.8),
    "dark": ((0.035, 0.036, 0.040), 0.1, 0.55),
    "steel": ((0.46, 0.47, 0.49), 0.5, 0.30),
    "plate": ((0.58, 0.59, 0.60), 0.4, 0.38),
    "shell": ((0.030, 0.031, 0.035), 0.05, 0.45),
    "trim": ((0.11, 0.115, 0.125), 0.2, 0.45),
    "pad": ((0.60, 0.42, 0.38), 0.0, 0.75),
    "pedestal": ((0.10, 0.105, 0.115), 0.1, 0.6),
}
"""Base colour (linear), metallic (1 is bare metal) and roughness (1 is chalk), by material."""


@dataclass(frozen=True, kw_only=True)
class LinkMeshes:
    """Mesh files by link, in link frames."""

    files: dict[str, bytes]
    """Content by file name: binary glTF, and the hulls of collision meshes."""
    by_link: dict[str, tuple[str, ...]]
    """Names of the binary glTF files that a link shows."""

    def with_prefix(self, prefix: str) -> LinkMeshes:
        """Give the same files to links whose names have a prefix."""
        by_link = {f"{prefix}{link}": names for link, names in self.by_link.items()}
        return LinkMeshes(files=self.files, by_link=by_link)

    def __or__(self, other: LinkMeshes) -> LinkMeshes:
        """Join two; a link of both shows the files of both."""
        by_link = dict(self.by_link)
        for link, names in other.by_link.items():
            by_link[link] = by_link.get(link, ()) + names
        clash = [n for n in self.files.keys() & other.files if self.files[n] != other.files[n]]
        if clash:
            raise ValueError(f"files of equal names must be equal; these differ: {sorted(clash)}")
        return LinkMeshes(files=self.files | other.files, by_link=by_link)


@lru_cache(maxsize=1)
def build_ur10e_meshes() -> LinkMeshes:
    """Build the meshes of the arm, link names without a side."""
    links = build_arm_solids()
    return _select({link: (f"{link}.glb",) for link in links})


def build_shadow_meshes(side: Side) -> LinkMeshes:
    """Build the meshes of a hand, link names without a side.

    Fingers share files; the left palm, thumb and forearm are reflections of the right ones.
    """
    return _select({link: (_hand_file(side, link),) for link in HAND_MASS})


@lru_cache(maxsize=8)
def build_pedestal_mesh(base_link: str, height: float) -> LinkMeshes:
    """Build the pedestal of an arm, shown with its base; nothing for a base on the ground.

    Args:
        base_link: Name of the arm's first link.
        height: Height of the base above the ground [m].
    """
    pedestal = build_pedestal_solids(height)
    if not pedestal:
        return LinkMeshes(files={}, by_link={})
    name = f"pedestal_{round(height * 1000)}mm.glb"
    return LinkMeshes(files={name: _encode(pedestal)}, by_link={base_link: (name,)})


def _select(by_link: dict[str, tuple[str, ...]]) -> LinkMeshes:
    every = _robot_files()
    names = [name for files in by_link.values() for name in files]
    return LinkMeshes(files={name: every[name] for name in names}, by_link=by_link)


def _hand_file(side: Side, link: str) -> str:
    finger, _, part = link.partition("_")
    if finger in {"ff", "mf", "rf", "lf"} and part != "metacarpal":
        return f"finger_{part}.glb"
    return f"{side}_{link}.glb"


@lru_cache(maxsize=1)
def _robot_files() -> dict[str, bytes]:
    files = {f"{link}.glb": _encode(solids) for link, solids in build_arm_solids().items()}
    for link, solids in build_hand_solids().items():
        if link.startswith("finger_"):
            files[f"{link}.glb"] = _encode(solids)
            continue
        files[f"right_{link}.glb"] = _encode(solids)
        files[f"left_{link}.glb"] = _encode([s.mirrored_x() for s in solids])
    return files


def _encode(solids: list[Solid]) -> bytes:
    """Write solids as one glTF scene with one mesh per material."""
    import trimesh  # takes longer than all else that a robot's description needs
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual import TextureVisuals

    scene = trimesh.Scene()
    for material in sorted({s.material for s in solids}):
        vertices, normals, faces, start = [], [], [], 0
        for solid in solids:
            if solid.material != material:
                continue
            v, n, f = shade(solid)
            vertices.append(v)
            normals.append(n)
            faces.append(f + start)
            start += len(v)
        scene.add_geometry(
            trimesh.Trimesh(
                vertices=np.vstack(vertices),
                faces=np.vstack(faces),
                vertex_normals=np.vstack(normals),
                visual=TextureVisuals(material=_pbr(material)),
                process=False,
            ),
            geom_name=material,
            node_name=material,
        )
    return bytes(export_glb(scene, include_normals=True))


def _pbr(name: str) -> PBRMaterial:
    from trimesh.visual.material import PBRMaterial

    rgb, metallic, roughness = FINISHES[name]
    return PBRMaterial(
        name=name,
        baseColorFactor=[*rgb, 1.0],
        metallicFactor=metallic,
        roughnessFactor=roughness,
    )
