"""The Python code of the README runs."""

import re
from pathlib import Path

README = Path(__file__).parents[1] / "README.md"


def test_the_code_of_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("dgl_assets.people.make_person", lambda *_, scale: _Standing())
    blocks = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) >= 4
    for block in blocks:
        exec(compile(block, str(README), "exec"), {})
    assert list((tmp_path / "robots").glob("*/*.urdf"))


class _Standing:
    """In place of a person, who takes seconds to make; `test_people` makes one."""

    def pose(self, angles: str) -> None:
        assert angles == "standing"
