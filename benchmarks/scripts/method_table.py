"""Make the table of all tasks and methods from finished evaluations, and the picture of a table.

    python benchmarks/scripts/method_table.py out/table
    python benchmarks/scripts/method_table.py docs/results.md --picture docs/images/methods.png

The folder holds TASK/METHOD, the folders of `dgl eval TASK-v1 --policy METHOD`. The table counts
successes at the first try and with retries, with McNemar's exact p of the expert and the primitive
on the starts that both have run, with retries. A page's table may hold rows of several runs.
"""

import argparse
import re
from pathlib import Path

from dgl_collect.evaluation.comparison import compare, read_evaluation
from dgl_collect.evaluation.results import RESULTS_FILE, ResultsRecord, count
from dgl_collect.results import wilson_interval
from dgl_tasks import get_task, task_ids

METHODS = {"expert": "#8f96a3", "primitive": "#e86b3f", "halo": "#2d7fd1", "blind": "#d8dbe1"}
"""Methods in the order of the table, with the colours of their bars."""


def read(folder: Path) -> dict[str, dict[str, ResultsRecord]]:
    """Read the results of each method of each task that is there."""
    found: dict[str, dict[str, ResultsRecord]] = {}
    for task in task_ids():
        for method in METHODS:
            path = folder / task.partition("-")[0] / method
            if (path / RESULTS_FILE).is_file():
                found.setdefault(task, {})[method] = read_evaluation(path)
    return found


def format_table(found: dict[str, dict[str, ResultsRecord]]) -> str:
    """Write the table in Markdown: successes at the first try; with retries."""
    lines = [
        f"| task | {' | '.join(f'`{method}`' for method in METHODS)} | p |",
        "|---|" + "--:|" * (len(METHODS) + 1),
    ]
    for task, methods in found.items():
        counts = {method: count(results.runs) for method, results in methods.items()}
        cells = [
            f"{each.first_try}; {each.succeeded} of {each.episodes}" if each else ""
            for each in map(counts.get, METHODS)
        ]
        two = {Path(name): methods[name] for name in ("expert", "primitive") if name in methods}
        p = f"{compare(two).pairs[0].p_value:.2g}" if len(two) == 2 else ""
        lines.append(f"| {get_task(task).title} | {' | '.join(cells)} | {p} |")
    return "\n".join(lines)


def read_table(text: str) -> dict[str, dict[str, tuple[int, int, int]]]:
    """Read first tries, successes and episodes of each method of each task from a page."""
    found: dict[str, dict[str, tuple[int, int, int]]] = {}
    titles = {get_task(task).title for task in task_ids()}
    for line in text.partition(f"| task | `{next(iter(METHODS))}`")[2].splitlines()[2:]:
        title, *cells = (cell.strip() for cell in line.strip("|").split("|"))
        if title not in titles:
            break
        numbers = {m: re.findall(r"\d+", c) for m, c in zip(METHODS, cells, strict=False) if c}
        found[title] = {
            method: (int(first), int(succeeded), int(episodes))
            for method, (first, succeeded, episodes) in numbers.items()
        }
    return found


def draw(found: dict[str, dict[str, tuple[int, int, int]]], path: Path) -> None:
    """Draw success with retries, with Wilson's intervals, and at the first try as a line."""
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(11, 3.6), layout="constrained")
    width = 0.8 / len(METHODS)
    for number, (method, colour) in enumerate(METHODS.items()):
        places, rates, errors, firsts = [], [], [], []
        for place, methods in enumerate(found.values()):
            if method in methods:
                first, succeeded, episodes = methods[method]
                low, high = wilson_interval(succeeded, episodes)
                places.append(place + (number - (len(METHODS) - 1) / 2) * width)
                rates.append(100 * succeeded / episodes)
                errors.append((rates[-1] - 100 * low, 100 * high - rates[-1]))
                firsts.append(100 * first / episodes)
        if places:
            axes.bar(places, rates, 0.9 * width, color=colour, label=method)
            axes.errorbar(places, rates, list(zip(*errors, strict=True)), fmt="none",
                          ecolor="#444", elinewidth=0.8)  # fmt: skip
            half = 0.4 * width
            left, right = [x - half for x in places], [x + half for x in places]
            axes.hlines(firsts, left, right, colors="black", linewidths=1.6)
    axes.set_xticks(range(len(found)), [title.replace(" ", "\n") for title in found])
    axes.set_ylabel("episodes that succeed [%]")
    axes.set_ylim(0, 101)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, ncols=len(METHODS), loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.savefig(path, dpi=110)


def main() -> None:
    """Print the table, and draw the picture if asked to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("source", type=Path, help="folder of evaluations, or page with a table")
    parser.add_argument("--picture", type=Path)
    arguments = parser.parse_args()
    source: Path = arguments.source
    text = format_table(read(source)) if source.is_dir() else source.read_text(encoding="utf-8")
    if source.is_dir():
        print(text)
    if arguments.picture is not None:
        draw(read_table(text), arguments.picture)


if __name__ == "__main__":
    main()
