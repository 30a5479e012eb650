"""Warp starts without noise, and real warnings of its start are kept."""

import os
import subprocess
import sys

import pytest
import warp as wp

from dgl_physics import quiet

NOISE = b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver. GPU ...\n"
FAULT = b"Warp CUDA error: out of memory\n"


@pytest.mark.parametrize("has_gpu", [False, True])
def test_a_missing_driver_is_told_where_there_is_a_gpu_alone(has_gpu, monkeypatch, capfd, tmp_path):
    monkeypatch.setattr(quiet, "_GPU_FILES", (tmp_path if has_gpu else tmp_path / "none",))
    monkeypatch.setattr(wp, "init", lambda: os.write(2, NOISE + FAULT))
    quiet._start_warp.__wrapped__()
    assert capfd.readouterr().err.encode() == (NOISE * has_gpu) + FAULT
    os.write(2, b"afterwards\n")
    assert capfd.readouterr().err == "afterwards\n"


@pytest.mark.skipif(
    any(file.exists() for file in quiet._GPU_FILES), reason="there is an NVIDIA GPU"
)
def test_the_first_use_of_warp_writes_nothing():
    code = (
        "from dgl_physics.quiet import quiet_warp\n"
        "import warp as wp\n"
        "with quiet_warp():\n"
        "    wp.zeros(1, device='cpu')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    assert (done.stdout, done.stderr) == (b"", b"")
