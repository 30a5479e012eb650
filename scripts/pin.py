"""Write the exact versions of all dependencies into `[tool.uv] constraint-dependencies`.

Of the workspace, and of each project that has an environment of its own.

The resolution covers every supported Python version and platform, so a package may appear more than
once, each time with the marker under which that version applies.

Example: uv run --no-sync python scripts/pin.py
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PROJECTS = (ROOT, ROOT / "packages/lerobot_env_dexgarmentlab")
_LIST = re.compile(r"^constraint-dependencies = \[\n(?:.*\n)*?\]\n", re.MULTILINE)


def resolve(project: Path) -> list[str]:
    """Return what uv resolves a project to, one requirement a line, sorted."""
    command = ["uv", "export", "--all-groups", "--all-extras", "--no-hashes"]
    command += ["--no-emit-local", "--no-annotate", "--no-header"]
    command += ["--all-packages"] if project == ROOT else []
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"uv could not resolve {project.name}:\n{done.stderr}")
    lines = [line.strip() for line in done.stdout.splitlines()]
    return sorted(line for line in lines if line and not line.startswith(("#", "-")))


def replace_pins(text: str, pins: list[str]) -> str:
    """Return the text of a `pyproject.toml` with its list of constraints replaced."""
    if not _LIST.search(text):
        raise SystemExit("pyproject.toml has no line `constraint-dependencies = [`")
    entries = "".join(f'  "{pin}",\n' for pin in pins)
    return _LIST.sub(lambda _: f"constraint-dependencies = [\n{entries}]\n", text, count=1)


def main() -> int:
    """Rewrite the pins; return 1 with `--check` if they were not up to date."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--upgrade", action="store_true", help="drop the pins and resolve anew")
    parser.add_argument("--check", action="store_true", help="write nothing; fail if they differ")
    arguments = parser.parse_args()
    statuses = [pin(project, arguments) for project in PROJECTS]
    return max(statuses)


def pin(project: Path, arguments: argparse.Namespace) -> int:
    """Rewrite the pins of a project; return 1 with `--check` if they were not up to date."""
    path = project / "pyproject.toml"
    before = path.read_text(encoding="utf-8")
    if arguments.upgrade:
        path.write_text(replace_pins(before, []), encoding="utf-8")
        try:
            subprocess.run(["uv", "lock", "--upgrade"], cwd=project, check=True)
        except BaseException:
            path.write_text(before, encoding="utf-8")
            raise
    pins = resolve(project)
    after = replace_pins(before, pins)
    if arguments.check:
        if after != before:
            print(f"the pins in {path} are not up to date; run scripts/pin.py")
        return int(after != before)
    path.write_text(after, encoding="utf-8")
    print(f"pinned {len(pins)} requirements of {project.name}; run `make setup`")
    return 0


if __name__ == "__main__":
    sys.exit(main())
