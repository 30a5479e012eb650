"""One attempt on a page: its film, its figures, its stages."""

import html
import re
from collections.abc import Mapping, Sequence

from dexgarmentlab.reports import figures
from dexgarmentlab.reports.page import outcome_badge
from dexgarmentlab.reports.words import DRAWN, MEASURED, Words, find_words
from dgl_collect.previews import StagePreview
from dgl_collect.results import AttemptResult
from dgl_collect.video import FRAME_RATE

__all__ = ["attempt_card", "split_words"]


def split_words(task: str) -> str:
    """Give `FoldTops-v1` as `Fold Tops`."""
    name = re.sub(r"-v\d+$", "", task)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)


def attempt_card(
    result: AttemptResult,
    media: Mapping[str, str | None],
    *,
    name: str,
    heading: str = "",
    stages: Sequence[StagePreview] = (),
    fault: str = "",
) -> str:
    """Show an attempt: its film, what was measured, and its stages.

    Args:
        result: What became of it.
        media: Addresses of its "video" and "picture", HTML; None where there is none.
        name: Anchor on the page.
        heading: Plain text; none where the page has no other attempt, and the film plays by itself
            then.
        stages: What its episode file shows.
        fault: Why it shows nothing, if it should.
    """
    title = ""
    if heading:
        title = f"<h3>{html.escape(heading)} {outcome_badge(success=result.success)}</h3>"
    reason = ""
    if result.reason is not None:
        detail = f"<br>{html.escape(result.detail)}" if result.detail else ""
        reason = f'<p class="reason"><b>{html.escape(result.reason)}</b>{detail}</p>'
    criteria = "".join(figures.meter(criterion) for criterion in result.criteria)
    told = f'<p class="reason">{html.escape(fault)}</p>' if fault else ""
    facts = {"garment": result.garment_id or "none", "seed of the attempt": result.seed}
    return (
        f'<article id="{name}">{title}<div class="card">'
        f'<div class="media">{reason}{_film(media, is_single=not heading)}{_time(result)}</div>'
        f'<div class="facts">{criteria}{_picture(media)}</div></div><div class="lists">'
        f"{_facts('Attempt', facts)}{_facts('Measured', result.measurements, MEASURED)}"
        f"{_facts('Drawn at random', result.randomisation, DRAWN)}</div>"
        f"{_stages(stages)}{told}</article>"
    )


def _film(media: Mapping[str, str | None], *, is_single: bool) -> str:
    video, picture = media["video"], media["picture"]
    if video is None:
        return '<p class="quiet">This attempt left no film.</p>'
    poster = "" if picture is None else f' poster="{picture}"'
    play = " autoplay" if is_single else ' preload="none"'
    return (
        f'<figure><video src="{video}"{poster}{play} controls loop muted playsinline></video>'
        f"<figcaption>The whole attempt, {FRAME_RATE} pictures a second, at its own speed; three "
        "times "
        "as fast while the arms come and go</figcaption></figure>"
    )


def _time(result: AttemptResult) -> str:
    if not result.stage_seconds:
        return ""
    return f"<div><h4>Time</h4>{figures.time_bar(result.stage_seconds, result.seconds)}</div>"


def _picture(media: Mapping[str, str | None]) -> str:
    if media["picture"] is None:
        return ""
    return (
        f'<h4>When it was judged</h4><img src="{media["picture"]}" '
        'alt="the garment when the attempt was judged" loading="lazy">'
    )


def _stages(stages: Sequence[StagePreview]) -> str:
    if not stages:
        return ""
    rows = "".join(_stage(number, stage) for number, stage in enumerate(stages, start=1))
    heights = figures.hand_heights([(stage.name, stage.ee_pose) for stage in stages])
    legend = "".join(f'<span class="key {side}">{side} hand</span>' for side in figures.SIDES)
    return (
        f"<h4>Stages</h4><div class='stages'>{rows}</div>"
        f'<h4>Height of the hands <span class="quiet">metres</span> {legend}'
        f'<span class="quiet"> (faint: parked)</span></h4>{heights}'
    )


def _stage(number: int, stage: StagePreview) -> str:
    name = stage.name.replace("_", " ")
    hands = figures.find_hands(stage.ee_pose)
    wanted = figures.find_wanted(
        stage.garment_point_cloud, stage.points_affordance_feature, stage.points, hands=hands
    )
    first = figures.picture_with_points(
        stage.first_image, stage.points, alt=f"{name}, start", wanted=wanted
    )
    last = figures.picture_with_points(stage.last_image, {}, alt=f"{name}, end")
    cloud = figures.cloud_figure(
        stage.garment_point_cloud,
        stage.points_affordance_feature,
        stage.points,
        alt=f"{name}, the garment's points coloured by affordance",
        hands=hands,
    )
    return (
        f'<div class="stage"><p><b>{number} · {html.escape(name)}</b> '
        f'<span class="quiet">{len(stage.ee_pose)} frames</span></p>'
        f"<figure>{cloud}<figcaption>{_legend(stage, hands)}</figcaption></figure>"
        f"<figure>{first}<figcaption>Start</figcaption></figure>"
        f"<figure>{last}<figcaption>End</figcaption></figure></div>"
    )


def _legend(stage: StagePreview, hands: Sequence[str]) -> str:
    """Say whose affordance the colours of a cloud show."""
    shown = {side: f"{side} hand" for side in hands}
    for_both = stage.points_affordance_feature.min(axis=1) >= figures.NAMED_FROM
    if len(hands) > 1 and for_both.any():
        shown["both"] = "both"
    keys = "".join(f'<span class="key {kind}">{text}</span>' for kind, text in shown.items())
    return f"Where to grasp: {keys}"


def _facts(
    title: str, facts: Mapping[str, object], known: Mapping[str, Words] | None = None
) -> str:
    if not facts:
        return ""
    rows = "".join(_fact(find_words(name, known or {}), value) for name, value in facts.items())
    return f"<div><h4>{title}</h4><dl>{rows}</dl></div>"


def _fact(words: Words, value: object) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool) and words.factor != 1.0:
        value = float(value) * words.factor
    unit = f" {words.unit}" if words.unit else ""
    return f"<dt>{html.escape(words.text)}</dt><dd>{html.escape(_value(value) + unit)}</dd>"


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
