"""Robot files go where the user says, and what is wrong with that place is told."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dgl_tasks import TaskError, get_task
from dgl_tasks.control import ArmKinematics
from dgl_tasks.errors import RobotFilesError
from dgl_tasks.robot import BimanualUR10eShadow
from dgl_tasks.robot_files import (
    DEFAULT_ROBOT_DIRECTORY,
    find_robot_directory,
    writing_robot_files,
)


def test_the_folder_is_below_the_cache_of_the_user(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert find_robot_directory() == tmp_path / "dexgarmentlab" / "robots"
    for unset in (None, ""):
        if unset is None:
            monkeypatch.delenv("XDG_CACHE_HOME")
        else:
            monkeypatch.setenv("XDG_CACHE_HOME", unset)
        assert find_robot_directory() == Path.home() / ".cache" / "dexgarmentlab" / "robots"


@pytest.mark.slow
def test_environment_and_kinematics_write_there(tmp_path):
    code = (
        "import gymnasium, dgl_tasks\n"
        "from dgl_tasks.motion import BimanualMotion\n"
        "from dgl_tasks.robot import DEFAULT_ROBOT_DIRECTORY\n"
        "BimanualMotion(dgl_tasks.get_task('FoldTops-v1'), DEFAULT_ROBOT_DIRECTORY)\n"
        "gymnasium.make('FoldTops-v1', obs_mode='state', render_backend='none')\n"
    )
    cache = {"WARP_CACHE_PATH": os.environ.get("WARP_CACHE_PATH", str(Path.home() / ".cache/warp"))}
    surroundings = {**os.environ, **cache, "XDG_CACHE_HOME": str(tmp_path)}
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, env=surroundings)
    names = {path.name for path in (tmp_path / "dexgarmentlab" / "robots").rglob("*.urdf")}
    assert names == {"bimanual_ur10e_shadow.urdf", "left_ur10e.urdf", "right_ur10e.urdf"}


def test_a_folder_that_cannot_be_written_is_named(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("")
    base = get_task("FoldTops-v1").left_base
    with pytest.raises(
        RobotFilesError, match=rf"{blocked}/robots, which failed: Not a directory"
    ) as e:
        ArmKinematics("left", base, blocked / "robots")
    assert e.value.errno == errno.ENOTDIR
    assert not isinstance(e.value, TaskError)  # the machine is at fault
    agent = type("Blocked", (BimanualUR10eShadow,), {"directory": blocked / "robots"})
    with pytest.raises(RobotFilesError, match="set the directory of robot files to a folder"):
        agent._load_articulation(agent.__new__(agent))


def test_the_default_folder_is_told_with_the_variable_that_moves_it():
    err = PermissionError(errno.EACCES, "Permission denied", "somewhere")
    with (
        pytest.raises(RobotFilesError, match="set XDG_CACHE_HOME to a folder") as caught,
        writing_robot_files(DEFAULT_ROBOT_DIRECTORY),
    ):
        raise err
    assert str(DEFAULT_ROBOT_DIRECTORY) in str(caught.value)
    assert (caught.value.errno, caught.value.filename) == (errno.EACCES, "somewhere")
