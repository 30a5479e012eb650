"""Frame, style and shared parts of all pages."""

import html
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources

__all__ = [
    "badge",
    "figure",
    "format_duration",
    "make_page",
    "outcome_badge",
    "provenance",
    "rate_headline",
    "reason_bars",
    "resume_notice",
    "table",
    "tiles",
]


def make_page(title: str, *, overline: str, header: str, body: Iterable[str]) -> str:
    """Make a whole page.

    Args:
        title: Its heading, as plain text.
        overline: What kind of page it is, in small above the heading, as plain text.
        header: What stands below the heading, HTML.
        body: What follows, HTML; empty parts are left out.
    """
    style = (
        resources.files("dexgarmentlab.reports").joinpath("page.css").read_text(encoding="utf-8")
    )
    parts = "\n".join(part for part in body if part)
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta name="color-scheme" content="light dark">\n'
        f"<title>{html.escape(title)} · dexgarmentlab</title>\n<style>\n{style}</style>\n</head>\n"
        f'<body>\n<main>\n<header><p class="overline">dexgarmentlab · {html.escape(overline)}</p>'
        f"<h1>{html.escape(title)}</h1>{header}</header>\n{parts}\n</main>\n</body>\n</html>\n"
    )


def tiles(facts: Iterable[tuple[str, str]]) -> str:
    """Show figures, each with what it is, as plain text."""
    items = "".join(f"<li><b>{html.escape(f)}</b>{html.escape(what)}</li>" for f, what in facts)
    return f'<ul class="tiles">{items}</ul>'


def table(columns: Mapping[str, str], rows: Iterable[Sequence[str]]) -> str:
    """Lay out a table.

    Args:
        columns: Heading of each column, as plain text, and the class of its cells: "", "number" or
            "note".
        rows: Cells, HTML, one for each column.
    """
    kinds = [f' class="{kind}"' if kind else "" for kind in columns.values()]
    head = "".join(
        f"<th{kind}>{html.escape(name)}</th>" for kind, name in zip(kinds, columns, strict=True)
    )
    lines = "".join(
        f"<tr>{''.join(f'<td{k}>{cell}</td>' for k, cell in zip(kinds, row, strict=True))}</tr>"
        for row in rows
    )
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{lines}</tbody>'
        "</table></div>"
    )


def figure(source: str, caption: str, *, alt: str | None = None) -> str:
    """Show a picture with its caption, as plain text; `alt` says what it shows where the caption does not."""
    shown = html.escape(caption if alt is None else alt)
    return (
        f'<figure><img src="{html.escape(source)}" alt="{shown}" loading="lazy">'
        f"<figcaption>{html.escape(caption)}</figcaption></figure>"
    )


def badge(word: str, kind: str) -> str:
    """Mark something with a word in the colour of a kind: "good", "bad" or "quiet"."""
    return f'<span class="badge {kind}">{html.escape(word)}</span>'


def outcome_badge(*, success: bool) -> str:
    """Mark an attempt as a success or as failed."""
    return badge("success", "good") if success else badge("failed", "bad")


def rate_headline(rate: float, interval: tuple[float, float]) -> str:
    """Show a success rate, large, and its 95 % interval on a line from 0 to 100 %."""
    low, high = interval
    return (
        f'<p class="headline">{rate:.0%}<span class="quiet"> success</span></p>'
        f'<div class="interval" aria-hidden="true"><i style="left:{low:.1%};width:{high - low:.1%}">'
        f'</i><u style="left:{rate:.1%}"></u><span>0</span><span>50</span><span>100 %</span></div>'
        f'<p class="quiet">95 % interval {low:.1%} to {high:.1%} (Wilson)</p>'
    )


def reason_bars(title: str, counts: Mapping[str, int]) -> str:
    """Chart how often each reason was given; nothing without any."""
    if not counts:
        return ""
    most = max(counts.values())
    rows = "".join(
        f'<li><span>{html.escape(reason)}</span><i style="width:{count / most:.1%}"></i>'
        f"<b>{count}</b></li>"
        for reason, count in counts.items()
    )
    return f'<section><h2>{html.escape(title)}</h2><ul class="reasons">{rows}</ul></section>'


def resume_notice(status: str, done: int, wanted: int, what: str) -> str:
    """Say that a run is not complete and how to go on; nothing if it is."""
    if status == "complete":
        return ""
    return (
        f'<p class="notice">This run was {html.escape(status)} after {done} of {wanted} {what}. The '
        "same command with <code>--resume</code> makes the rest.</p>"
    )


def provenance(commands: Iterable[str], versions: Mapping[str, object]) -> str:
    """Say by which commands, with which versions of packages, something was made."""
    text = "\n".join(command for command in commands if command)
    shown = f"<pre><code>{html.escape(text)}</code></pre>" if text else ""
    rows = "".join(
        f"<dt>{html.escape(name)}</dt><dd>{html.escape(str(version))}</dd>"
        for name, version in versions.items()
    )
    return f'<footer><h2>How this was made</h2>{shown}<dl class="versions">{rows}</dl></footer>'


def format_duration(seconds: float) -> str:
    """Write a duration [s]."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"
