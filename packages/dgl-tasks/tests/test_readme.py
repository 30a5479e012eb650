"""The code in the README runs as it stands there."""

import re
from pathlib import Path

import pytest

pytestmark = pytest.mark.usefixtures("coarse_garments")

TEXT = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
BLOCKS = {
    title: re.findall(r"```python\n(.*?)```", body, re.DOTALL)
    for title, body in (
        section.split("\n", 1) for section in re.split(r"^## ", TEXT, flags=re.M)[1:]
    )
}


@pytest.mark.parametrize(
    "title",
    [
        "Environment",
        "Objects",
        pytest.param("Pictures and clouds", marks=pytest.mark.render),
        pytest.param("Policies", marks=pytest.mark.render),
    ],
)
def test_the_code_runs(title, capsys):
    (code,) = BLOCKS[title]
    names: dict = {}
    exec(compile(code, f"README.md, {title}", "exec"), names)
    if title == "Environment":
        assert names["observation"].shape == (1, 134)
        assert "False" in capsys.readouterr().out
    elif title == "Objects":
        assert names["env"].objects["platform"].pose[:2] == pytest.approx([0.1, 1.6])
    elif title == "Policies":
        assert names["result"].reason == "below the threshold"
        assert "joint_state" in capsys.readouterr().out
    else:
        assert names["garment"].shape == (2048, 3)
        assert names["workspace"].shape == (2048, 6)


def test_no_block_is_left_out():
    assert {title for title, blocks in BLOCKS.items() if blocks} == {
        "Environment",
        "Objects",
        "Pictures and clouds",
        "Policies",
    }
