"""Commands of the first hour's page, run in their order; snippets of Python, as they stand."""

import re
import shlex
import socket
import subprocess
import sys
import urllib.request
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from dgl_assets.garments.catalogue import load_garment

ROOT = Path(__file__).parents[1]
DGL = Path(sys.executable).with_name("dgl")


def read(page):
    return (ROOT / "docs" / page).read_text(encoding="utf-8")


def find_blocks(text, language):
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


def find_commands(text, port):
    """Words of each `dgl` command, with one episode and a free port."""
    for line in "".join(find_blocks(text, "bash")).splitlines():
        if line.startswith("dgl "):
            line = re.sub(r"--episodes \d+", "--episodes 1", line.replace("8000", str(port)))
            yield shlex.split(line, comments=True)[1:]


def find_free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


@contextmanager
def started(words, folder):
    """Start a command that runs until it is stopped; give the address that it prints."""
    with subprocess.Popen([DGL, *words], cwd=folder, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        told = next((line for line in process.stdout if "://" in line), "")
        try:
            yield told.split(";")[0].split()[-1]
        finally:
            process.terminate()


@pytest.fixture
def folder(tmp_path):
    """A folder with a mesh and a policy of one's own."""
    garment = load_garment("Tops_LongSleeve/000001")
    lines = [f"v {x} {y} {z}" for x, y, z in garment.vertices]
    lines += ["f {} {} {}".format(*face) for face in garment.faces + 1]
    (tmp_path / "my_shirt.obj").write_text("\n".join(lines))
    own = read("eval.md").partition("## A policy of your own")[2]
    (tmp_path / "my_module.py").write_text(find_blocks(own, "python")[0])
    return tmp_path


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_first_hour(folder):
    text = read("start.md").partition("## A policy on garments")[2]
    before, _, rest = text.partition("## Demonstrations for LeRobot")
    look = rest.partition("## Look at it")[2]
    commands = list(find_commands(before + look, find_free_port()))
    assert len(commands) == 11
    with ExitStack() as servers:
        for words in commands:
            if words[0] == "serve":
                address = servers.enter_context(started(words, folder))
                assert address.startswith("ws://")
            elif words[0] == "view":
                words += ["--port", str(find_free_port())]
                with started(words, folder) as address, urllib.request.urlopen(address) as page:
                    assert page.status == 200
            else:
                subprocess.run([DGL, *words], cwd=folder, check=True)
    for shown in ("out/primitive/index.html", "out/mine/index.html", "match.png"):
        assert (folder / shown).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("page", ["start.md", "environments.md", "episode_format.md", "assets.md"])
def test_snippets_of_python_run(page, folder):
    if page == "episode_format.md":
        collect = ["collect", "FoldTops-v1", "--episodes", "1", "--rounds", "1", "--out", "out"]
        subprocess.run([DGL, *collect], cwd=folder, check=True)
    for block in find_blocks(read(page), "python"):
        block = block.replace("shirt.glb", "my_shirt.obj")
        subprocess.run([sys.executable, "-c", block], cwd=folder, check=True)
