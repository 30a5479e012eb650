"""The example runs, and so does every code block of the README."""

import importlib.util
import re
from pathlib import Path

import pytest

from dgl_physics import ClothMaterial

PACKAGE = Path(__file__).parent.parent
BLOCKS = re.findall(
    r"^## ([^\n]*)\n\n```python\n(.*?)^```",
    (PACKAGE / "README.md").read_text(encoding="utf-8"),
    re.MULTILINE | re.DOTALL,
)


def test_drape_sheet():
    spec = importlib.util.spec_from_file_location("drape", PACKAGE / "examples/drape_sheet.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    heights = module.main(frames=90, side=0.4)
    rest = ClothMaterial().rest_offset
    assert heights.max() == pytest.approx(2 * module.RADIUS + rest, abs=2e-3)  # on the sphere's top
    assert rest - 1e-4 < heights.min() < 0.1  # the hem hangs down, and not into the ground


def test_the_readme_has_its_examples():
    assert [title for title, _ in BLOCKS] == ["Drop a sheet", "In a SAPIEN scene"]


@pytest.mark.parametrize(("title", "code"), BLOCKS, ids=[title for title, _ in BLOCKS])
def test_code_of_the_readme(title, code, capsys):
    if "SAPIEN" in title:
        pytest.importorskip("sapien")
    exec(compile(code, f"README.md, {title}", "exec"), {"__name__": "readme"})
    printed = [float(word) for word in capsys.readouterr().out.split()[-1:]]
    assert printed[0] == pytest.approx(0.204, abs=0.004)  # the top of what the sheet lies on


def test_the_readme_lists_every_parameter_with_its_default():
    text = (PACKAGE / "README.md").read_text(encoding="utf-8")
    import dataclasses

    from dgl_physics import SolidMaterial, SolverConfig

    for kind in (ClothMaterial, SolidMaterial, SolverConfig):
        for field in dataclasses.fields(kind):
            row = re.search(rf"^\|[^|]*`{field.name}` \| ([^|]+) \|", text, re.MULTILINE)
            assert row, f"{field.name} is missing"
            if isinstance(field.default, (int, float)) and not isinstance(field.default, bool):
                value = eval(row[1].replace("`", ""))
                assert value == pytest.approx(field.default), field.name
