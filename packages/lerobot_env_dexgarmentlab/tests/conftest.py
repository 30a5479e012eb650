"""Two real attempts, exported once."""

import os

import pytest

os.environ.setdefault("HF_HUB_OFFLINE", "1")


@pytest.fixture(scope="session")
def dataset(tmp_path_factory):
    """A data set of two attempts at Hang Tops, in 22 numbers, with two cameras."""
    from dgl_collect import CollectConfig, RecordOptions, collect
    from dgl_collect.exporting import ExportOptions, export_episodes
    from lerobot_env_dexgarmentlab.dataset import write

    folder = tmp_path_factory.mktemp("lerobot")
    options = RecordOptions(control_mode="pd_hand_poses", rounds=1)
    collect(CollectConfig(task="HangTops-v1", episodes=2, out=folder / "run", options=options))
    files = sorted((folder / "run/episodes").glob("*.h5"))
    assert len(files) == 2
    cameras = ("environment_camera", "left_wrist_camera")
    frames = ExportOptions(
        control_mode="pd_hand_poses", cameras=cameras, size=(64, 48), matcher="exact"
    )
    exported = export_episodes(files, folder / "data", write, frames, format_name="lerobot")
    assert exported is not None
    assert exported.left_out == {}  # commands of this mode are replayed exactly
    return folder / "data"
