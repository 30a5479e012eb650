"""Draw the dome of `dgl_tasks.studio` with SAPIEN's blurred copies, and write its file.

Needed after a change of the dome's colours. The blur takes SAPIEN 11 s on a processor, so the
result is kept.

Example: uv run --no-sync python scripts/make_dome.py
"""

import tempfile
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import sapien

from dgl_tasks.studio import DOME_PATH, shine_dome


def paint_dome(pixels: int = 256) -> dict[str, np.ndarray]:
    """Paint the environment map: light by height, the same all around.

    Returns:
        Faces of the cube "side" (first row uppermost), "top" and "bottom", each of shape
        (pixels, pixels, 3), uint8, sRGB.
    """
    ramp = (np.arange(pixels) + 0.5) / pixels * 2 - 1
    across, down = np.meshgrid(ramp, ramp)
    side = -down / np.sqrt(1 + across**2 + down**2)  # sine of the height
    top = 1 / np.sqrt(1 + across**2 + down**2)
    faces = {}
    for name, sine in (("side", side), ("top", top), ("bottom", -top)):
        faces[name] = (255 * shine_dome(sine) ** (1 / 2.2) + 0.5).astype(np.uint8)
    return faces


def main() -> None:
    """Write `DOME_PATH`."""
    with tempfile.TemporaryDirectory() as folder:  # SAPIEN reads pictures from files only
        paths = {}
        for name, picture in paint_dome().items():
            paths[name] = str(Path(folder) / f"{name}.png")
            iio.imwrite(paths[name], picture)
        side, top, bottom = paths["side"], paths["top"], paths["bottom"]
        cubemap = sapien.render.RenderCubemap(side, side, top, bottom, side, side)
        cubemap.export(str(DOME_PATH))
    print(f"wrote {DOME_PATH}")


if __name__ == "__main__":
    main()
