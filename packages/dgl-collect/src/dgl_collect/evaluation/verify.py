"""Check of the folder of an evaluation."""

from collections.abc import Iterator
from pathlib import Path

from dgl_collect.errors import CollectionError
from dgl_collect.evaluation.results import RESULTS_FILE, ResultsRecord
from dgl_collect.results import read_results
from dgl_collect.run_folder import ATTEMPTS_FILE
from dgl_collect.verify import verify_run
from dgl_files.fields import read_json_file

__all__ = ["verify_evaluation"]


def verify_evaluation(folder: Path) -> Iterator[tuple[Path, str]]:
    """Check an evaluation: the runs of its seeds, and `results.json` against their lines.

    Args:
        folder: Of the evaluation.

    Yields:
        Each checked file with its fault; empty where it is whole.
    """
    path = folder / RESULTS_FILE
    try:
        content = read_json_file(ResultsRecord, path)
    except (ValueError, OSError) as err:
        yield path, str(err)
        return
    told = {(run.seed, run.episode): (run.episode_seed, run.success) for run in content.runs}
    counted = {}
    for run in sorted(folder.glob("seed-*")):
        yield from verify_run(run)
        seed = run.name.removeprefix("seed-")
        try:
            results = read_results(run / ATTEMPTS_FILE) if seed.isdecimal() else []
        except CollectionError:
            continue  # told above
        counted |= {(int(seed), result.index): (result.seed, result.success) for result in results}
    for seed, episode in sorted(told.keys() | counted.keys()):
        ours, its = told.get((seed, episode)), counted.get((seed, episode))
        if ours != its:
            where = f"{path}: episode {episode} of seed {seed}"
            told_there = f"{ATTEMPTS_FILE} of seed-{seed} says {_describe(its)}"
            yield path, f"{where} is {_describe(ours)}; {told_there}"
            return
    yield path, ""


def _describe(told: tuple[int, bool] | None) -> str:
    if told is None:
        return "not there"
    return f"a {'success' if told[1] else 'failure'} with the seed {told[0]}"
