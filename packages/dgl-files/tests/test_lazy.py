"""Public names of a package are imported when they are first used."""

import subprocess
import sys

import pytest

PACKAGE = """
from typing import TYPE_CHECKING
from dgl_files.lazy import export_lazily
if TYPE_CHECKING:
    from made_up.heavy import weigh as weigh
__all__, __getattr__ = export_lazily(__name__, __file__)
"""


def test_a_name_is_imported_when_it_is_used(tmp_path):
    folder = tmp_path / "made_up"
    folder.mkdir()
    (folder / "__init__.py").write_text(PACKAGE)
    (folder / "heavy.py").write_text("def weigh():\n    return 3\n")
    code = (
        "import sys, made_up; assert made_up.__all__ == ['weigh']\n"
        "assert 'made_up.heavy' not in sys.modules\n"
        "from made_up import weigh; assert weigh() == 3\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True)


def test_other_names_do_not_exist(tmp_path, monkeypatch):
    (tmp_path / "made_up.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path)
    import made_up

    with pytest.raises(AttributeError, match="module 'made_up' has no attribute 'pull'"):
        made_up.pull  # noqa: B018
