"""One attempt on a page: its film, its figures, its stages."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from dexgarmentlab.reports import figures
from dexgarmentlab.reports.page import format_number, part
from dexgarmentlab.reports.words import DRAWN, MEASURED, Words, find_words
from dgl_collect.previews import StagePreview
from dgl_collect.results import AttemptResult
from dgl_collect.video import FRAME_RATE

if TYPE_CHECKING:
    from markupsafe import Markup

__all__ = ["make_card"]


def make_card(
    result: AttemptResult,
    media: Mapping[str, str | None],
    *,
    name: str,
    heading: str = "",
    stages: Sequence[StagePreview] = (),
    fault: str = "",
) -> dict[str, object]:
    """Prepare an attempt for the macro `attempt`.

    Args:
        result: Outcome of the attempt.
        media: Addresses of its "video" and "picture"; None where there is none.
        name: Anchor on the page.
        heading: Empty where the page has no other attempt; the film plays by itself then.
        stages: Previews of its episode file.
        fault: Reason why its episode file has no previews.
    """
    own = {"garment": result.garment_id or "none", "seed of the attempt": result.seed}
    return {
        "name": name,
        "heading": heading,
        "success": result.success,
        "reason": result.reason,
        "detail": result.detail,
        **media,
        "frame_rate": FRAME_RATE,
        "stage_seconds": result.stage_seconds,
        "rest_seconds": max(0.0, result.seconds - sum(result.stage_seconds.values())),
        "meters": [figures.meter(criterion) for criterion in result.criteria],
        "lists": [
            _facts("Attempt", own),
            _facts("Measured", result.measurements, MEASURED),
            _facts("Drawn at random", result.randomisation, DRAWN),
        ],
        "stages": [_show_stage(stage) for stage in stages],
        "heights": figures.hand_heights([(s.name, s.ee_pose) for s in stages]) if stages else "",
        "fault": fault,
    }


def _show_stage(stage: StagePreview) -> dict[str, object]:
    name, cloud = stage.name.replace("_", " "), stage.garment_point_cloud
    affordance, hands = stage.points_affordance_feature, figures.find_hands(stage.ee_pose)
    wanted = figures.find_wanted(cloud, affordance, stage.points, hands=hands)
    keys = [(side, f"{side} hand") for side in hands]
    if len(hands) > 1 and (affordance.min(axis=1) >= figures.NAMED_FROM).any():
        keys.append(("both", "both"))
    return {
        "name": name,
        "frames": len(stage.ee_pose),
        "legend": keys,
        "cloud": figures.cloud_figure(
            cloud,
            affordance,
            stage.points,
            alt=f"{name}, the garment's points coloured by affordance",
            hands=hands,
        ),
        "first": figures.picture_with_points(
            stage.first_image, stage.points, alt=f"{name}, start", wanted=wanted
        ),
        "last": figures.picture_with_points(stage.last_image, {}, alt=f"{name}, end"),
    }


def _facts(
    title: str, facts: Mapping[str, object], known: Mapping[str, Words] | None = None
) -> "Markup":
    rows = [_fact(find_words(name, known or {}), value) for name, value in facts.items()]
    return part("facts", title, rows)


def _fact(words: Words, value: object) -> tuple[str, str]:
    if isinstance(value, int | float) and not isinstance(value, bool) and words.factor != 1.0:
        value = float(value) * words.factor
    return words.text, _value(value) + (f" {words.unit}" if words.unit else "")


def _value(value: object) -> str:
    if isinstance(value, float):
        return format_number(value)
    if isinstance(value, Mapping):
        return ", ".join(f"{key} {_value(item)}" for key, item in value.items())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_value(item) for item in value)
    return str(value)
