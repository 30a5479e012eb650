"""The `dgl` command line: composes the packages of this workspace and contains no algorithm."""

__all__: list[str] = []
