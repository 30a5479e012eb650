"""Draw the dome of `dgl_tasks.studio` with SAPIEN's blurred copies, and write its file.

Needed after a change of the dome's colours. The blur takes SAPIEN 11 s on a processor, so the
result is kept.

Example: uv run --no-sync python scripts/make_dome.py
"""

import tempfile
from pathlib import Path

import imageio.v3 as iio
import sapien

from dgl_tasks.studio import DOME_PATH, paint_dome


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
