"""Robot files go where the user says, and what is wrong with that place is told."""

import errno
import os
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from dgl_tasks import TaskError, robot_files
from dgl_tasks.errors import RobotFilesError
from dgl_tasks.robot import BimanualUR10eShadow
from dgl_tasks.robot_files import ROBOT_DIRECTORY, writing_robot_files


@pytest.mark.parametrize("is_set", [True, False])
def test_the_folder_is_below_the_cache_of_the_user(tmp_path, monkeypatch, is_set):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path) if is_set else "")
    found = runpy.run_path(robot_files.__file__)["ROBOT_DIRECTORY"]
    assert found == (tmp_path if is_set else Path.home() / ".cache") / "dexgarmentlab" / "robots"


@pytest.mark.slow
def test_an_environment_writes_there_and_kinematics_write_nothing(tmp_path):
    code = (
        "import gymnasium, dgl_tasks\n"
        "from dgl_tasks.motion import BimanualMotion\n"
        "from dgl_tasks.robot_files import CACHE\n"
        "BimanualMotion(dgl_tasks.get_task('FoldTops-v1'))\n"
        "assert not CACHE.exists()\n"
        "gymnasium.make('FoldTops-v1', obs_mode='state', render_backend='none')\n"
    )
    cache = {"WARP_CACHE_PATH": os.environ.get("WARP_CACHE_PATH", str(Path.home() / ".cache/warp"))}
    surroundings = {**os.environ, **cache, "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=surroundings)
    names = {path.name for path in (tmp_path / "dexgarmentlab" / "robots").rglob("*.urdf")}
    assert names == {"bimanual_ur10e_shadow.urdf", "left_ur10e.urdf", "right_ur10e.urdf"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path, monkeypatch):
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr("dgl_tasks.robot.ROBOT_DIRECTORY", blocked / "robots")
    agent = BimanualUR10eShadow.__new__(BimanualUR10eShadow)
    with pytest.raises(RobotFilesError, match="set XDG_CACHE_HOME to a folder") as caught:
        agent._load_articulation()
    assert "failed: Not a directory" in str(caught.value)
    assert caught.value.errno == errno.ENOTDIR
    assert not isinstance(caught.value, TaskError)  # the machine is at fault


def test_the_fault_and_the_folder_are_told():
    err = PermissionError(errno.EACCES, "Permission denied", "somewhere")
    with pytest.raises(RobotFilesError) as caught, writing_robot_files():
        raise err
    assert str(ROBOT_DIRECTORY) in str(caught.value)
    assert (caught.value.errno, caught.value.filename) == (errno.EACCES, "somewhere")
