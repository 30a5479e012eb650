"""Robots by name: the built-in arm and hand, imported ones, and any arm with any hand."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dgl_assets.errors import AssetNotFoundError
from dgl_assets.robots.errors import RobotImportError
from dgl_assets.robots.importing.folder import META_FILE, load_robot_folder, read_meta
from dgl_assets.robots.robot import (
    DEFAULT_ROBOT,
    SHADOW_HAND_PART,
    UR10E_ARM,
    ArmPart,
    HandPart,
    Robot,
)


def list_robots(folder: Path | str | None = None) -> dict[str, Mapping[str, Any]]:
    """List the robots that can be named, with what is recorded about each.

    Args:
        folder: Folder of imported robots, if any.
    """
    found: dict[str, Mapping[str, Any]] = {
        "ur10e": {"kind": "arm", "licence": "Apache-2.0", "source": "built in"},
        "shadow": {"kind": "hand", "licence": "Apache-2.0", "source": "built in"},
    }
    if folder is not None:
        folder = Path(folder)
        if not folder.is_dir():
            raise AssetNotFoundError(f"there is no folder of robots {folder}")
        for path in sorted(folder.glob(f"*/{META_FILE}")):
            found[path.parent.name] = read_meta(path.parent)
    return found


def load_robot(name: str, folder: Path | str | None = None) -> Robot:
    """Load a robot by name.

    Args:
        name: An arm and a hand, "ARM+HAND"; or one of them, with the built-in other: "ur10e" or
            "shadow"; or an arm that was imported with its hand.
        folder: Folder of imported robots; needed for names that are not built in.

    Raises:
        AssetNotFoundError: If there is no such robot.
        AssetImportError: If its files cannot be used, or arm and hand do not go together.
    """
    if name in ("", DEFAULT_ROBOT.name):
        return DEFAULT_ROBOT
    parts = [_load_parts(part, folder) for part in name.split("+")]
    if len(parts) > 2:
        raise RobotImportError(f"a robot is an arm and a hand, ARM+HAND; got {name!r}")
    if len(parts) == 1:
        arm, hand = parts[0]
        return _join(arm or UR10E_ARM, hand or SHADOW_HAND_PART)
    arm, hand = parts[0][0], parts[1][1]
    if arm is None or hand is None:
        raise RobotImportError(f"a robot is named ARM+HAND, the arm first; got {name!r}")
    return _join(arm, hand)


def _join(arm: ArmPart, hand: HandPart) -> Robot:
    if (arm, hand) == (UR10E_ARM, SHADOW_HAND_PART):
        return DEFAULT_ROBOT
    try:
        return Robot(arm=arm, hand=hand)
    except ValueError as err:
        raise RobotImportError(str(err)) from err


def _load_parts(name: str, folder: Path | str | None) -> tuple[ArmPart | None, HandPart | None]:
    if name == UR10E_ARM.name:
        return UR10E_ARM, None
    if name == SHADOW_HAND_PART.name:
        return None, SHADOW_HAND_PART
    known = list_robots(folder)
    if name not in known or folder is None:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f", did you mean {close[0]!r}?" if close else ""
        where = (
            f" in {folder}" if folder is not None else " (imported ones need their folder, robots)"
        )
        raise AssetNotFoundError(
            f"there is no robot {name!r}{where}{hint}; robots: {', '.join(known)}"
        )
    return load_robot_folder(Path(folder) / name)
