"""Meshes of all robot links as binary glTF, generated in code."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from dgl_assets.robots._solids import Solid, shade
from dgl_assets.robots.hand import HAND_MASS, SIDES
from dgl_assets.robots.visual_arm import build_arm_solids, build_pedestal_solids
from dgl_assets.robots.visual_hand import build_hand_solids


@dataclass(frozen=True, kw_only=True)
class Finish:
    """Surface of a material."""

    rgb: tuple[float, float, float]
    """Base colour, linear, each in [0, 1]."""
    metallic: float
    """0 for plastic, 1 for bare metal."""
    roughness: float
    """0 for a mirror, 1 for chalk."""


FINISHES: dict[str, Finish] = {
    "aluminium": Finish(rgb=(0.52, 0.54, 0.56), metallic=0.35, roughness=0.42),
    "tube": Finish(rgb=(0.62, 0.63, 0.65), metallic=0.35, roughness=0.35),
    "cap": Finish(rgb=(0.12, 0.36, 0.52), metallic=0.0, roughness=0.45),
    "seal": Finish(rgb=(0.015, 0.015, 0.017), metallic=0.0, roughness=0.8),
    "dark": Finish(rgb=(0.035, 0.036, 0.040), metallic=0.1, roughness=0.55),
    "steel": Finish(rgb=(0.46, 0.47, 0.49), metallic=0.5, roughness=0.30),
    "plate": Finish(rgb=(0.58, 0.59, 0.60), metallic=0.4, roughness=0.38),
    "shell": Finish(rgb=(0.030, 0.031, 0.035), metallic=0.05, roughness=0.45),
    "trim": Finish(rgb=(0.11, 0.115, 0.125), metallic=0.2, roughness=0.45),
    "pad": Finish(rgb=(0.60, 0.42, 0.38), metallic=0.0, roughness=0.75),
    "pedestal": Finish(rgb=(0.10, 0.105, 0.115), metallic=0.1, roughness=0.6),
}
"""Materials by the names that the solids use."""


@dataclass(frozen=True, kw_only=True)
class LinkMeshes:
    """Mesh files and which links show them, both at the link frame."""

    files: dict[str, bytes]
    """Binary glTF by file name."""
    by_link: dict[str, tuple[str, ...]]
    """File names by prefixed link name."""


def build_link_meshes(*, left_height: float, right_height: float) -> LinkMeshes:
    """Build the meshes of both arms, hands and pedestals.

    Args:
        left_height: Height of the left base above the ground [m], the length of its pedestal.
        right_height: Height of the right base [m].

    Returns:
        Files and their links. Arms and fingers share files; the left palm, thumb and forearm are
        reflections of the right ones.
    """
    files = dict(_robot_files())
    by_link: dict[str, tuple[str, ...]] = {}
    for side, height in zip(SIDES, (left_height, right_height), strict=True):
        for link in build_arm_solids():
            by_link[f"{side}_{link}"] = (f"{link}.glb",)
        for link in HAND_MASS:
            by_link[f"{side}_{link}"] = (_hand_file(side, link),)
        pedestal = build_pedestal_solids(height)
        if pedestal:
            name = f"pedestal_{round(height * 1000)}mm.glb"
            files[name] = _encode(pedestal)
            by_link[f"{side}_base_link"] += (name,)
    return LinkMeshes(files=files, by_link=by_link)


def _hand_file(side: str, link: str) -> str:
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
    finish = FINISHES[name]
    return PBRMaterial(
        name=name,
        baseColorFactor=[*finish.rgb, 1.0],
        metallicFactor=finish.metallic,
        roughnessFactor=finish.roughness,
    )
