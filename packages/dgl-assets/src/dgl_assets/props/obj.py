"""Write a prop as OBJ with its materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dgl_assets.props.prop import Prop
from dgl_files.whole import write_text


def save_obj(prop: Prop, path: Path) -> Path:
    """Write a prop's mesh as OBJ and its plain colours as MTL beside it; both appear whole.

    Args:
        prop: A prop; each part becomes one group.
        path: Path of the file, ending in ".obj".

    Returns:
        The path.
    """
    if path.suffix != ".obj":
        raise ValueError(f"path must end in .obj; got {path}")
    lines, first = [f"mtllib {path.with_suffix('.mtl').name}"], 1
    for part in prop.parts:
        lines += [f"g {part.name}", f"usemtl {part.finish.name}"]
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in part.vertices.tolist()]
        lines += [f"vt {u:.5f} {v:.5f}" for u, v in part.uvs.tolist()]
        lines += [f"vn {x:.5f} {y:.5f} {z:.5f}" for x, y, z in part.normals.tolist()]
        lines += [
            "f " + " ".join(f"{i}/{i}/{i}" for i in face) for face in (part.faces + first).tolist()
        ]
        first += len(part.vertices)
    finishes = {part.finish.name: part.finish for part in prop.parts}
    materials: list[str] = []
    for name, finish in finishes.items():
        r, g, b = (c ** (1 / 2.2) for c in finish.colour)  # MTL's colours are taken for sRGB
        materials += [
            f"newmtl {name}",
            f"Kd {r:.4f} {g:.4f} {b:.4f}",
            f"Ns {np.clip(2 / finish.roughness**4 - 2, 1, 1000):.1f}",
            f"Pr {finish.roughness:.3f}",
            f"Pm {finish.metallic:.3f}",
        ]
    write_text(path.with_suffix(".mtl"), "\n".join(materials) + "\n")
    write_text(path, "\n".join(lines) + "\n")
    return path
