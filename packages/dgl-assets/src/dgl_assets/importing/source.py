"""Find the mesh, its key points and what is known about it, in a file or a folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dgl_assets.importing.categories import CATEGORIES
from dgl_assets.importing.clothesnet import ClothesNetName, read_clothesnet_name
from dgl_assets.importing.errors import UnreadableFileError, UnsafePathError
from dgl_assets.importing.paths import KINDS, read_json

KEYPOINTS_FILE, META_FILE = "keypoints.json", "meta.json"
_MAX_MODELS = 20_000
_TEXTS = ("category", "subtype", "source", "source_id", "licence", "units", "up")


@dataclass(frozen=True, kw_only=True)
class Source:
    """A garment to import."""

    mesh: Path
    name: str
    """Of the file or the folder."""
    keypoints: Path | None = None
    meta: Mapping[str, str] = field(default_factory=dict)
    """Texts of meta.json."""
    clothesnet: ClothesNetName | None = None


def list_models(folder: Path) -> tuple[Path, ...]:
    """Find the models below a folder, such as all of ClothesNet.

    Args:
        folder: Where to look.

    Returns:
        Mesh files, or folders of {mesh, keypoints, meta}, sorted.

    Raises:
        UnreadableFileError: If there are none, or more than 20,000.
    """
    found: list[Path] = []
    for path in sorted(folder.rglob("*")):
        if _is_mesh(path) and path.is_file():
            has_more = (path.parent / KEYPOINTS_FILE).is_file() or (
                path.parent / META_FILE
            ).is_file()
            found.append(path.parent if has_more else path)
        if len(found) > _MAX_MODELS:
            raise UnreadableFileError(f"{folder} holds more than {_MAX_MODELS:,} models")
    if not found:
        raise UnreadableFileError(f"{folder} holds no mesh ({', '.join(sorted(KINDS))})")
    return tuple(dict.fromkeys(found))


def find_source(path: Path) -> Source:
    """Find what belongs to one garment.

    Args:
        path: A mesh file, or a folder with one mesh and perhaps keypoints.json and meta.json.

    Raises:
        UnreadableFileError: If there is no such path, no mesh or several, or meta.json is broken.
        UnsafePathError: If a file of a folder is a link out of it.
    """
    if not path.exists():
        raise UnreadableFileError(f"{path} does not exist")
    if not path.is_dir():
        return Source(mesh=path, name=path.stem, clothesnet=read_clothesnet_name(path))
    folder = path
    try:
        mesh = _find_mesh(folder)
        for _ in range(4):  # archives often hold one folder
            inner = [item for item in folder.iterdir() if item.is_dir() and not item.is_symlink()]
            if mesh is not None or len(inner) != 1:
                break
            folder = inner[0]
            mesh = _find_mesh(folder)
    except OSError as err:
        raise UnreadableFileError(f"{folder.name} cannot be read: {err.strerror or err}") from err
    if mesh is None:
        raise UnreadableFileError(f"{path.name} holds no mesh ({', '.join(sorted(KINDS))})")
    files = {name: folder / name for name in (KEYPOINTS_FILE, META_FILE)}
    for file in (mesh, *files.values()):
        if file.is_symlink() and not file.resolve().is_relative_to(folder.resolve()):
            raise UnsafePathError(f"{file.name} in {folder.name} is a link out of the folder")
    return Source(
        mesh=mesh,
        name=folder.name,
        keypoints=files[KEYPOINTS_FILE] if files[KEYPOINTS_FILE].is_file() else None,
        meta=_read_meta(files[META_FILE]) if files[META_FILE].is_file() else {},
        clothesnet=read_clothesnet_name(mesh),
    )


def _is_mesh(path: Path) -> bool:
    is_hidden = path.name.startswith(".") or "__MACOSX" in path.parts
    return not is_hidden and KINDS.get(path.suffix.lower(), "zip") != "zip"


def _find_mesh(folder: Path) -> Path | None:
    meshes = sorted(path for path in folder.iterdir() if _is_mesh(path) and not path.is_dir())
    if len(meshes) > 1:
        named = [path for path in meshes if path.stem in ("mesh", folder.name)]
        if len(named) != 1:
            names = ", ".join(path.name for path in meshes[:5])
            raise UnreadableFileError(
                f"{folder.name} holds {len(meshes)} meshes ({names}{', ...' if len(meshes) > 5 else ''}); name one of them"
            )
        return named[0]
    return meshes[0] if meshes else None


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
        if not isinstance(value, str) or len(value) > 500:
            raise UnreadableFileError(f"{path.name}: {key} must be a text; got {str(value)[:60]}")
        meta[key] = value
    if meta.get("category", next(iter(CATEGORIES))) not in CATEGORIES:
        raise UnreadableFileError(
            f"{path.name}: category must be one of {sorted(CATEGORIES)}; got {meta['category'][:60]!r}"
        )
    return meta
