"""Find the mesh of a garment, its landmarks and its facts, in a file or a folder."""

from __future__ import annotations

import os
import reprlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dgl_assets.importing.bounds import MAX_MODELS, MAX_TEXT, check_count
from dgl_assets.importing.categories import CATEGORIES
from dgl_assets.importing.clothesnet import ClothesNetName, read_clothesnet_name
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_assets.importing.frame import AXES
from dgl_assets.importing.paths import KINDS, is_inside, read_json
from dgl_assets.importing.scale import UNITS

KEYPOINTS_FILE, META_FILE = "keypoints.json", "meta.json"
_MAX_FILES = 200_000  # below a folder that are looked at
_TEXTS = ("category", "subtype", "source", "source_id", "licence", "units", "up")
_LISTED = 8  # names in a message
_OTHERS = (".fbx", ".blend", ".dae", ".3ds", ".max", ".ma", ".mb", ".abc", ".zprj", ".rar", ".7z")
"""Models that are not read: people have them beside or instead of one that is."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """A garment to import."""

    mesh: Path
    name: str
    """Of the file or the folder."""
    root: Path | None = None
    """Folder that references of the mesh must not leave; that of the mesh when None."""
    keypoints: Path | None = None
    meta: Mapping[str, str] = field(default_factory=dict)
    """Texts of meta.json."""
    clothesnet: ClothesNetName | None = None

    @property
    def subtype(self) -> str:
        """Kind of garment in words; empty if nothing tells it."""
        return self.meta.get("subtype") or (self.clothesnet.subtype if self.clothesnet else "")


def list_models(folder: Path) -> tuple[Path, ...]:
    """Find the models below a folder, such as all of ClothesNet.

    Args:
        folder: Folder to search.

    Returns:
        Mesh files, or folders of {mesh, keypoints, meta}, sorted.

    Raises:
        UnreadableFileError: If there are none, or more than 20,000.
    """
    found: list[Path] = []
    for path in _list_files(folder):
        if _is_mesh(path, folder):
            has_more = any((path.parent / name).is_file() for name in (KEYPOINTS_FILE, META_FILE))
            found.append(path.parent if has_more else path)
        check_count(len(found), MAX_MODELS, "models", str(folder))
    if not found:
        raise UnreadableFileError(_describe_nothing(folder))
    return tuple(dict.fromkeys(found))


def list_archives(folder: Path) -> tuple[Path, ...]:
    """Find zip archives below a folder, sorted."""
    return tuple(path for path in _list_files(folder) if path.suffix.lower() == ".zip")


def has_mesh(folder: Path) -> bool:
    """Test that a folder or one below holds a mesh file."""
    return any(_is_mesh(path, folder) for path in _list_files(folder))


def find_source(path: Path, *, mesh: str | None = None) -> Source:
    """Find the files of one garment.

    Args:
        path: A mesh file, or a folder with one mesh in it or in any folder below, and perhaps
            keypoints.json and meta.json beside it.
        mesh: Name or path of the mesh in a folder of several.

    Raises:
        UnreadableFileError: If there is no such path, no mesh or several, or meta.json is broken.
        UnsafePathError: If a file of a folder is a link out of it.
    """
    try:
        is_folder, is_there = path.is_dir(), path.exists()
    except OSError as err:
        raise UnreadableFileError(f"{path.name[:120]} cannot be read: {err.strerror}") from err
    if not is_folder:
        if not is_there:
            raise UnreadableFileError(f"{path} does not exist")
        if mesh is not None and mesh != path.name:
            raise UnreadableFileError(
                f"{path.name} is one mesh; `mesh` is for folders and archives, got {mesh[:60]!r}"
            )
        return Source(mesh=path, name=path.stem, clothesnet=read_clothesnet_name(path))
    chosen = _find_mesh(path, mesh)
    folder = chosen.parent
    # Beside the mesh, else on top.
    files = {
        name: next((f / name for f in (folder, path) if (f / name).is_file()), folder / name)
        for name in (KEYPOINTS_FILE, META_FILE)
    }
    for file in (chosen, *files.values()):
        if file.is_symlink() and not is_inside(file, path):
            raise UnsafePathError(
                f"{file.name} in {folder.name} is a link out of the folder, or to nothing"
            )
    return Source(
        mesh=chosen,
        name=path.resolve().name,
        root=path,
        keypoints=files[KEYPOINTS_FILE] if files[KEYPOINTS_FILE].is_file() else None,
        meta=_read_meta(files[META_FILE]) if files[META_FILE].is_file() else {},
        clothesnet=read_clothesnet_name(chosen),
    )


def _list_files(folder: Path) -> Iterator[Path]:
    """Files below a folder in the order of their names; links to folders are not followed."""

    def refuse(err: OSError) -> None:
        raise UnreadableFileError(f"{folder} cannot be read: {err.strerror or err}") from err

    found: list[Path] = []
    for here, folders, names in os.walk(folder, onerror=refuse):
        folders.sort()
        found += [Path(here) / name for name in names]
        check_count(len(found), _MAX_FILES, "files", str(folder))
    yield from sorted(found)


def _is_mesh(path: Path, folder: Path) -> bool:
    """Test that a path below a folder is a mesh file by its name."""
    inside = path.relative_to(folder).parts
    is_hidden = any(part.startswith(".") for part in inside) or "__MACOSX" in inside
    kind = KINDS.get(path.suffix.lower(), "zip")
    return not is_hidden and kind != "zip" and (path.is_file() or path.is_symlink())


def _find_mesh(folder: Path, wanted: str | None) -> Path:
    """Find the mesh of a folder: the wanted one, the only one, or the one named like the folder."""
    meshes = [path for path in _list_files(folder) if _is_mesh(path, folder)]
    if not meshes:
        raise UnreadableFileError(_describe_nothing(folder))
    names = {path: path.relative_to(folder).as_posix() for path in meshes}
    if wanted is not None:
        found = [path for path in meshes if wanted in (names[path], path.name, path.stem)]
    else:
        top = [path for path in meshes if path.parent == folder]
        found = meshes if len(meshes) == 1 else [p for p in top if p.stem in ("mesh", folder.name)]
        found = top if len(top) == 1 else found
    if len(found) == 1:
        return found[0]
    listed = ", ".join(list(names.values())[:_LISTED]) + (", ..." if len(names) > _LISTED else "")
    problem = "" if wanted is None else f", {len(found) or 'none'} of them called {wanted[:60]!r}"
    raise UnreadableFileError(
        f"{folder.name} holds {len(meshes)} meshes{problem}; choose one with `mesh`: {listed}"
    )


def _describe_nothing(folder: Path) -> str:
    text = f"{folder.name} holds no mesh ({', '.join(sorted(KINDS))})"
    others = [path.name for path in _list_files(folder) if path.suffix.lower() in _OTHERS]
    if others:
        text += f"; {others[0][:80]} is not read, export it as GLB or OBJ"
    return text


def _read_meta(path: Path) -> dict[str, str]:
    tree = read_json(path)
    if not isinstance(tree, dict):
        raise UnreadableFileError(f"{path.name} must be a JSON object")
    if "license" in tree:
        tree.setdefault("licence", tree["license"])
    meta = {}
    for key in _TEXTS:
        value = tree.get(key)
        if value is None:
            continue
        if not isinstance(value, str) or len(value) > MAX_TEXT:
            raise UnreadableFileError(
                f"{path.name}: {key} must be a text of at most {MAX_TEXT} characters; got "
                f"{reprlib.repr(value)}"
            )
        meta[key] = value
    for key, valid in (("category", CATEGORIES), ("units", UNITS), ("up", AXES)):
        if key in meta and meta[key] not in valid:
            raise UnreadableFileError(
                f"{path.name}: {key} must be one of {list(valid)}; got {meta[key][:60]!r}"
            )
    return meta
