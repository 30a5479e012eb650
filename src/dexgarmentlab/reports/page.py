"""Pages from the templates beside this file."""

import math
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from dgl_files.whole import written_beside

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup

__all__ = ["format_duration", "format_number", "part", "split_words", "write_page"]


def write_page(
    path: Path, template: str, *, package: str = "dexgarmentlab.reports", **content: object
) -> Path:
    """Write a page, whole or not at all.

    Args:
        path: File to write.
        template: Name of the template.
        package: Package with the folder `templates` that has it.
        content: Variables of the template.
    """
    text = _make_environment(package).get_template(template).render(content)
    with written_beside(path) as partial:
        partial.write_text(text, encoding="utf-8", errors="surrogateescape")
    return path


def part(name: str, *arguments: object, **options: object) -> "Markup":
    """Fill in a macro of `parts.html`."""
    module = _make_environment("dexgarmentlab.reports").get_template("parts.html").module
    return getattr(module, name)(*arguments, **options)


@cache
def _make_environment(package: str) -> "Environment":
    """Make an environment that escapes whatever is filled in, and knows the shared parts."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    names = dict.fromkeys([package, "dexgarmentlab.reports"])
    environment = Environment(
        loader=ChoiceLoader([PackageLoader(name) for name in names]),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "duration": format_duration,
        "number": format_number,
        "percent": lambda value, digits=1: f"{value:.{digits}%}",
        "words": lambda name: name.replace("_", " "),
    }
    return environment


def format_duration(seconds: float) -> str:
    """Write a duration [s]."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{int(seconds) // 60} min {int(seconds) % 60:02d} s"


def format_number(value: float) -> str:
    """Write a number with three significant digits, without an exponent where it is readable."""
    if value == 0 or not 1e-4 <= abs(value) < 1e6:
        return f"{value:.3g}"
    digits = max(0, 2 - math.floor(math.log10(abs(value))))
    text = f"{value:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if digits else text).replace("-", "\u2212")


def split_words(task: str) -> str:
    """Write `FoldTops-v1` as `Fold Tops`."""
    name = re.sub(r"-v\d+$", "", task)
    return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
