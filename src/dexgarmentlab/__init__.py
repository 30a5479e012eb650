"""The `dgl` command line and HALO: composes the packages of this workspace."""

from typing import TYPE_CHECKING

from dgl_files.lazy import export_lazily

if TYPE_CHECKING:
    from dexgarmentlab.halo import HALO as HALO

__all__, __getattr__ = export_lazily(__name__, __file__)
