"""Episode files made by hand, as small as the format allows."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

POINTS = 5


def write_episode(
    path: Path,
    *,
    frames: int = 12,
    success: bool = True,
    stages: int = 1,
    has_object: bool = False,
    offset: float = 0.0,
) -> Path:
    """Write an episode whose arrays count their frames: each value is `offset` plus the frame's number."""
    with h5py.File(path, "w") as file:
        file.attrs.update({"format_version": 1, "task": "FoldTops-v1", "success": success})
        for stage in range(1, stages + 1):
            count = (offset + 100 * (stage - 1) + np.arange(frames)).astype(np.float32)
            group = file.create_group(f"stage_{stage}")
            for key, shape in {
                "joint_state": (60,),
                "action": (60,),
                "ee_pose": (2, 7),
                "env_point_cloud": (POINTS, 6),
            }.items():
                values = np.broadcast_to(count.reshape(-1, *[1] * len(shape)), (frames, *shape)) + (
                    0.5 if key == "action" else 0.0
                )
                group.create_dataset(key, data=values.astype(np.float32))
            group.create_dataset("image", data=np.zeros((frames, 4, 6, 3), dtype=np.uint8))
            cloud = np.full((POINTS, 3), offset + stage, dtype=np.float32)
            group.create_dataset("garment_point_cloud", data=cloud)
            group.create_dataset("points_affordance_feature", data=cloud[:, :2] * 0)
            if has_object:
                group.create_dataset("object_point_cloud", data=cloud + 1)
    return path


@pytest.fixture
def make_episode() -> Callable[..., Path]:
    return write_episode
