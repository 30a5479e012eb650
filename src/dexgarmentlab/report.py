"""The report of a collection run: one HTML page that needs nothing but the run's folder."""

import html
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from dexgarmentlab import _report_figures as figures
from dgl_collect.files import written_beside
from dgl_collect.previews import StagePreview, read_previews
from dgl_collect.results import AttemptResult, read_results
from dgl_collect.run_folder import ATTEMPTS_FILE, RUN_FILE, SUMMARY_FILE
from dgl_collect.video import FRAME_RATE

__all__ = ["REPORT_FILE", "write_report"]

REPORT_FILE = "index.html"
SHOWN_EACH = 12
"""How many successes, and how many failures, are shown with pictures; the table has them all."""


@dataclass(frozen=True, kw_only=True)
class _Run:
    folder: Path
    commands: Sequence[str]
    summary: Mapping
    results: Sequence[AttemptResult]
    is_embedding: bool

    def media(self, result: AttemptResult, kind: str) -> str | None:
        """Give the address of an attempt's film or picture, if it has one."""
        if kind not in result.files:
            return None
        name = result.files[kind]
        return figures.file_uri(self.folder / name) if self.is_embedding else html.escape(name)


def write_report(out_dir: Path | str, *, embed_media: bool = False) -> Path:
    """Write the report of a run, replacing an older one.

    Args:
        out_dir: A run's folder, as `dgl collect` writes it.
        embed_media: Put films and pictures into the page, so that it can be sent as one file;
            otherwise it refers to those beside it.

    Returns:
        The page, `index.html` in the folder.

    Raises:
        FileNotFoundError: If the folder holds no run.
        CorruptEpisodeError: If an episode that is to be shown cannot be read.
    """
    folder = Path(out_dir)
    for name in (RUN_FILE, SUMMARY_FILE):
        if not (folder / name).is_file():
            raise FileNotFoundError(f"{folder} holds no run to report ({name} is missing)")
    run = _Run(
        folder=folder,
        commands=json.loads((folder / RUN_FILE).read_text(encoding="utf-8"))["commands"],
        summary=json.loads((folder / SUMMARY_FILE).read_text(encoding="utf-8")),
        results=read_results(folder / ATTEMPTS_FILE),
        is_embedding=embed_media,
    )
    path = folder / REPORT_FILE
    with written_beside(path) as partial:
        partial.write_text(_page(run), encoding="utf-8")
    return path


def _page(run: _Run) -> str:
    title = _title(str(run.summary["task"]))
    style = resources.files("dexgarmentlab").joinpath("report.css").read_text(encoding="utf-8")
    shown = _shown(run.results)
    is_single = len(run.results) == 1
    body = [_header(run, title), _notice(run), _failures(run)]
    if not is_single:
        body.append(_table(run))
    if shown and not is_single:
        note = "" if len(shown) == len(run.results) else f" of {len(run.results)}, see the table"
        body.append(f'<h2>In pictures <span class="quiet">{len(shown)}{note}</span></h2>')
    body += [_card(run, result, is_single=is_single) for result in shown]
    body.append(_provenance(run))
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(title)} · dexgarmentlab</title>\n<style>\n{style}</style>\n</head>\n"
        f"<body>\n<main>\n{chr(10).join(part for part in body if part)}\n</main>\n</body>\n</html>\n"
    )


def _shown(results: Sequence[AttemptResult]) -> list[AttemptResult]:
    """Choose the attempts that are shown with pictures."""
    chosen = [result for result in results if result.success][:SHOWN_EACH]
    chosen += [result for result in results if not result.success][:SHOWN_EACH]
    return sorted(chosen, key=lambda result: result.index)


def _header(run: _Run, title: str) -> str:
    summary = run.summary
    attempted, succeeded = summary["attempted"], summary["succeeded"]
    low, high = summary["success_interval"]
    if attempted == 0:
        headline = '<p class="headline">No attempts yet</p>'
    elif attempted == 1:
        word = "Success" if succeeded else "Failed"
        headline = f'<p class="headline {"good" if succeeded else "bad"}">{word}</p>'
    else:
        rate = succeeded / attempted
        headline = (
            f'<p class="headline">{rate:.0%}<span class="quiet"> success</span></p>'
            f"{figures.interval_bar(rate, low, high)}"
            f'<p class="quiet">95 % interval {low:.1%} to {high:.1%} (Wilson)</p>'
        )
    return (
        '<header><p class="overline">dexgarmentlab · collected demonstrations</p>'
        f"<h1>{html.escape(title)}</h1>"
        f'<div class="summary"><div>{headline}</div>{_tiles(run)}</div></header>'
    )


def _tiles(run: _Run) -> str:
    summary = run.summary
    attempted = summary["attempted"]
    tiles = []
    if attempted != 1:
        tiles.append((f"{summary['succeeded']} of {attempted}", "attempts succeeded"))
    median = summary["seconds_per_attempt"]["median"]
    if median is not None:
        tiles.append((_duration(median), "an attempt" if attempted == 1 else "median per attempt"))
    if attempted != 1:
        tiles.append((str(len(summary["garments"])), "different garments"))
    tiles.append((str(sum(result.frames for result in run.results)), "recorded frames"))
    tiles.append((str(summary["seed"]), "seed of the run"))
    items = "".join(f"<li><b>{value}</b>{label}</li>" for value, label in tiles)
    return f'<ul class="tiles">{items}</ul>'


def _notice(run: _Run) -> str:
    summary = run.summary
    if summary["status"] == "complete":
        return ""
    return (
        f'<p class="notice">This run was {html.escape(summary["status"])} after '
        f"{summary['attempted']} of {summary['requested']} attempts. The same command with "
        "<code>--resume</code> makes the rest.</p>"
    )


def _failures(run: _Run) -> str:
    reasons = run.summary["reasons"]
    if not reasons or len(run.results) == 1:
        return ""
    most = max(reasons.values())
    rows = "".join(
        f'<li><span>{html.escape(reason)}</span><i style="width:{count / most:.1%}"></i>'
        f"<b>{count}</b></li>"
        for reason, count in reasons.items()
    )
    return f'<section><h2>Why attempts failed</h2><ul class="reasons">{rows}</ul></section>'


def _table(run: _Run) -> str:
    shown = {result.index for result in _shown(run.results)}
    rows = "".join(_row(result, is_shown=result.index in shown) for result in run.results)
    squares = "".join(
        f'<i class="{"good" if result.success else "bad"}" title="attempt {result.index}"></i>'
        for result in run.results
    )
    return (
        f'<section><h2>Attempts</h2><div class="squares" aria-hidden="true">{squares}</div>'
        '<div class="scroll"><table><thead><tr><th>#</th><th>outcome</th><th>garment</th>'
        '<th class="number">value</th><th class="number">frames</th><th class="number">time</th>'
        f"<th>seed</th></tr></thead><tbody>{rows}</tbody></table></div></section>"
    )


def _row(result: AttemptResult, *, is_shown: bool) -> str:
    number = f'<a href="#a{result.index}">{result.index}</a>' if is_shown else str(result.index)
    value = "" if result.value is None else figures.format_number(result.value)
    frames = str(result.frames) if result.frames else ""
    return (
        f"<tr><td>{number}</td><td>{_badge(result)} "
        f'<span class="quiet">{html.escape(result.reason or "")}</span></td>'
        f'<td>{html.escape(result.garment_id or "")}</td><td class="number">{value}</td>'
        f'<td class="number">{frames}</td><td class="number">{_duration(result.seconds)}</td>'
        f'<td class="quiet">{result.seed}</td></tr>'
    )


def _card(run: _Run, result: AttemptResult, *, is_single: bool) -> str:
    stages = read_previews(run.folder / result.files["episode"]) if result.success else ()
    heading = "" if is_single else f"<h3>Attempt {result.index} {_badge(result)}</h3>"
    reason = ""
    if result.reason is not None:
        detail = f"<br>{html.escape(result.detail)}" if result.detail else ""
        reason = f'<p class="reason"><b>{html.escape(result.reason)}</b>{detail}</p>'
    criteria = "".join(figures.meter(criterion) for criterion in result.criteria)
    facts = {"garment": result.garment_id or "none", "attempt's seed": result.seed}
    return (
        f'<article id="a{result.index}">{heading}<div class="card">'
        f'<div class="media">{reason}{_film(run, result, is_single=is_single)}'
        f"<div><h4>Time</h4>{figures.time_bar(result.stage_seconds, result.seconds)}</div></div>"
        f'<div class="facts">{criteria}{_facts("Attempt", facts)}'
        f"{_facts('Measured', result.measurements)}"
        f"{_facts('Drawn at random', result.randomisation)}{_picture(run, result)}</div></div>"
        f"{_stages(stages)}</article>"
    )


def _film(run: _Run, result: AttemptResult, *, is_single: bool) -> str:
    video, picture = run.media(result, "video"), run.media(result, "picture")
    if video is None:
        return '<p class="quiet">This attempt left no film.</p>'
    poster = "" if picture is None else f' poster="{picture}"'
    play = " autoplay" if is_single else ' preload="none"'
    return (
        f'<figure><video src="{video}"{poster}{play} controls loop muted playsinline></video>'
        f"<figcaption>The whole attempt, {FRAME_RATE} pictures a second, at its own speed; three times "
        "as fast while the arms come and go</figcaption></figure>"
    )


def _picture(run: _Run, result: AttemptResult) -> str:
    picture = run.media(result, "picture")
    if picture is None:
        return ""
    return (
        f'<h4>When it was judged</h4><img src="{picture}" '
        'alt="the garment when the attempt was judged" loading="lazy">'
    )


def _stages(stages: Sequence[StagePreview]) -> str:
    if not stages:
        return ""
    rows = "".join(_stage(number, stage) for number, stage in enumerate(stages, start=1))
    heights = figures.hand_heights([(stage.name, stage.ee_pose) for stage in stages])
    legend = '<span class="key left">left hand</span><span class="key right">right hand</span>'
    return (
        f"<h4>Stages {legend}</h4><div class='stages'>{rows}</div>"
        f'<h4>Height of the hands <span class="quiet">metres</span> {legend}</h4>{heights}'
    )


def _stage(number: int, stage: StagePreview) -> str:
    name = stage.name.replace("_", " ")
    first = figures.picture_with_points(stage.first_image, stage.points, alt=f"{name}, start")
    last = figures.picture_with_points(stage.last_image, {}, alt=f"{name}, end")
    cloud = figures.cloud_figure(
        stage.garment_point_cloud,
        stage.points_affordance_feature,
        stage.points,
        alt=f"{name}, the garment's points coloured by affordance",
    )
    return (
        f'<div class="stage"><p><b>{number} · {html.escape(name)}</b> '
        f'<span class="quiet">{len(stage.ee_pose)} frames</span></p>'
        f"<figure>{cloud}<figcaption>Where each hand may grasp</figcaption></figure>"
        f"<figure>{first}<figcaption>Start</figcaption></figure>"
        f"<figure>{last}<figcaption>End</figcaption></figure></div>"
    )


def _facts(title: str, facts: Mapping[str, object]) -> str:
    if not facts:
        return ""
    rows = "".join(
        f"<dt>{html.escape(name.replace('_', ' '))}</dt><dd>{html.escape(_value(value))}</dd>"
        for name, value in facts.items()
    )
    return f"<h4>{title}</h4><dl>{rows}</dl>"


def _provenance(run: _Run) -> str:
    commands = "\n".join(command for command in run.commands if command)
    versions = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(version)}</dd>"
        for name, version in run.summary["versions"].items()
    )
    shown = f"<pre><code>{html.escape(commands)}</code></pre>" if commands else ""
    return f'<footer><h2>How this was made</h2>{shown}<dl class="versions">{versions}</dl></footer>'


def _badge(result: AttemptResult) -> str:
    word, kind = ("success", "good") if result.success else ("failed", "bad")
    return f'<span class="badge {kind}">{word}</span>'


def _title(task: str) -> str:
    """Give `FoldTops-v1` as `Fold Tops`."""
    name = re.sub(r"-v\d+$", "", task)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)


def _duration(seconds: float) -> str:
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def _value(value: object) -> str:
    if isinstance(value, bool | int | str) or value is None:
        return str(value)
    if isinstance(value, float):
        return figures.format_number(value)
    if isinstance(value, Sequence):
        return ", ".join(_value(item) for item in value)
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    return str(value)
