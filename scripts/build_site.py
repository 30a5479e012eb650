"""Build the site into out/site/html: the pages of docs/, and those that are made from the code.

Each task has a page, and each package one of its README and its public names. A warning is an
error.

Example: python scripts/build_site.py
"""

import os
import re
import shutil
import sys
from pathlib import Path

from sphinx.cmd.build import build_main

from dexgarmentlab.cli.tasks import describe_task
from dgl_collect.demonstration import load_demonstration
from dgl_tasks import get_task, task_ids

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
OUT = ROOT / "out/site"
PACKAGES = ("dgl-physics", "dgl-assets", "dgl-tasks", "dgl-collect", "dgl-gam", "dgl-sadp")
PLUGIN = "lerobot_env_dexgarmentlab"
"""Installed in an environment of its own; its page has no docstrings."""
PUBLIC_NAMES = """
## Public names

```{{eval-rst}}
.. automodule:: {}
```
"""
RESULTS = "## Automatic collection"
"""Heading of the results whose table has a row for each task."""


def main() -> int:
    """Build the site; return Sphinx's status."""
    shutil.rmtree(OUT, ignore_errors=True)
    pages = OUT / "pages"
    shutil.copytree(DOCS, pages, ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in make_pages().items():
        path = pages / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
    command = ["-q", "-W", "--keep-going", "-b", "html", str(pages), str(OUT / "html")]
    return build_main(command)


def make_pages() -> dict[str, str]:
    """Make all pages by their place in the site."""
    sources = {str(path.relative_to(DOCS)): path for path in DOCS.glob("*.md")}
    sources |= {"changes.md": ROOT / "CHANGELOG.md", "contributing.md": ROOT / "CONTRIBUTING.md"}
    sources |= {
        f"api/{name.replace('-', '_')}.md": ROOT / "packages" / name / "README.md"
        for name in (*PACKAGES, PLUGIN)
    }
    places = {path: DOCS / name for name, path in sources.items()}
    places |= {path.parent: place for path, place in places.items() if path.name == "README.md"}
    places[ROOT / "README.md"] = DOCS / "index.md"
    pages = {
        name: move_links(path.read_text(encoding="utf-8"), path, places)
        for name, path in sources.items()
    }
    for name in PACKAGES:
        module = name.replace("-", "_")
        pages[f"api/{module}.md"] += PUBLIC_NAMES.format(module)
    rows = read_rows(pages["results.md"])
    for task_id in task_ids():
        name = task_id.partition("-")[0]
        pages[f"task/{name}.md"] = write_task(task_id, rows)
    return pages


def read_rows(results: str) -> list[dict[str, str]]:
    """Read the tables of rates and of failures: the title of a task to its table of one row."""
    section = results.partition(RESULTS)[2].partition("\n## ")[0]
    tables = re.findall(r"(?:^\|.*\n)+", section, re.MULTILINE)
    return [_split_rows(table.splitlines()) for table in tables]


def _split_rows(lines: list[str]) -> dict[str, str]:
    return {
        title: "\n".join((*lines[:2], line))
        for line in lines[2:]
        for title in _split_titles(line.split("|")[1].strip())
    }


def _split_titles(cell: str) -> list[str]:
    """Name the tasks of a row, such as `Hang Tops; Dress`."""
    first, *others = cell.split("; ")
    return [first, *(f"{first.split()[0]} {other}" for other in others)]


def write_task(task_id: str, rows: list[dict[str, str]]) -> str:
    """Write the page of a task: film, rule, stages, numbers, and how often it succeeds."""
    task, facts = get_task(task_id), describe_task(get_task(task_id))
    demonstration = load_demonstration(task)
    lines = [f"# {task.title}", "", task.description, ""]
    film = DOCS / "films" / f"{task_id.partition('-')[0]}.mp4"
    if film.is_file():
        lines += [
            "```{raw} html",
            f'<video src="../_static/{film.name}" autoplay loop muted playsinline controls '
            'style="width: 100%; max-width: 40rem"></video>',
            "```",
            "",
        ]
    lines += [f"**Success:** {task.success_text}.", ""]
    link = "[All results](../results.md#automatic-collection)."
    found = [table[task.title] for table in rows if task.title in table]
    lines += ["## Success in simulation", "", link, "", "\n\n".join(found), ""]
    lines += ["## Stages", "", "| stage | left hand grasps | right hand grasps |", "|---|---|---|"]
    for stage in facts["stages"]:
        hands = (_show_grasp(stage["grasp"].get(side)) for side in ("left", "right"))
        lines.append(f"| `{stage['name']}` | {' | '.join(hands)} |")
    if demonstration.parameters:
        lines += ["", "## Numbers that `dgl tune` searches", ""]
        lines += ["| name | value | range | meaning |", "|---|--:|--:|---|"]
        for name, p in demonstration.parameters.items():
            low, high = p.range
            lines.append(f"| `{name}` | {p.value:g} | {low:g} to {high:g} | {p.meaning} |")
    lines += [
        "",
        "## Try it",
        "",
        "```bash",
        f"dgl collect {task_id} --episodes 3 --out out/expert",
        f"dgl eval {task_id} --policy primitive --episodes 3 --seeds 0 --out out/primitive",
        f"dgl view task {task_id}",
        "```",
        "",
    ]
    return "\n".join(lines)


def _show_grasp(points: list[str] | None) -> str:
    if points is None:
        return ""
    return ", ".join(f"`{point}`" for point in points) or "a place that the shape tells"


def move_links(text: str, source: Path, places: dict[Path, Path]) -> str:
    """Change relative links of a file so that they lead to the same place from its page.

    Links to what the site does not have lose their target and keep their words.

    Args:
        text: Markdown.
        source: The file.
        places: Files and folders that are pages, with the place of each.
    """

    def move(found: re.Match[str]) -> str:
        words, target, anchor = found[1], found[2], found[3] or ""
        if ":" in target or not target:
            return found[0]
        path = (source.parent / target).resolve()
        place = places.get(path, path)
        if DOCS not in place.parents:
            return words.strip("![]")
        return f"{words}({os.path.relpath(place, places[source].parent)}{anchor})"

    return re.sub(r"(!?\[[^\]]*\])\(([^)#\s]*)(#[^)\s]*)?\)", move, text)


if __name__ == "__main__":
    sys.exit(main())
