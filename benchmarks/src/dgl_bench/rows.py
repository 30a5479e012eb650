"""One measured number, what it should be, and how it is written."""

from dataclasses import KW_ONLY, dataclass

__all__ = ["NO_CUDA", "Reading", "format_value"]

NO_CUDA = "no CUDA device; run this where nvidia-smi shows one"


@dataclass(frozen=True)
class Reading:
    """One measured number."""

    name: str
    value: float | None
    """None when it could not be measured; `note` says why."""
    unit: str
    _: KW_ONLY
    bar: str = ""
    """Threshold of the value, such as "<= 10"; empty if it has none."""
    note: str = ""
    """Remark on the method of measurement, or the reason why there is no value."""
    is_skipped: bool = False
    """Not measured because this machine cannot; what failed is not skipped."""

    def __post_init__(self) -> None:
        if self.bar:
            relation, _, bound = self.bar.partition(" ")
            if relation not in ("<=", ">="):
                raise ValueError(f"bar must start with <= or >=; got {self.bar!r}")
            float(bound)

    @classmethod
    def skip(cls, name: str, unit: str, why: str, *, bar: str = "") -> "Reading":
        """Make the row of what this machine cannot measure."""
        return cls(name, None, unit, bar=bar, note=why, is_skipped=True)

    @property
    def limit(self) -> float | None:
        """The number in `bar`."""
        return float(self.bar.split()[1]) if self.bar else None

    @property
    def ok(self) -> bool | None:
        """True if the value meets its threshold; None without a threshold, or if it was skipped."""
        if not self.bar or self.is_skipped:
            return None
        if self.value is None:
            return False
        bound = float(self.bar.split()[1])
        return self.value <= bound if self.bar.startswith("<") else self.value >= bound

    @property
    def shown(self) -> str:
        """Value as text."""
        return format_value(self.value)

    def to_dict(self) -> dict[str, object]:
        """Return the row as `name, value, unit, bar, ok, note`."""
        return {
            "name": self.name,
            "value": self.value,
            "unit": self.unit,
            "bar": self.bar or None,
            "ok": self.ok,
            "note": self.note or None,
        }


def format_value(value: float | None) -> str:
    """Write a value with three significant digits."""
    if value is None:
        return "-"
    return f"{value:.3g}" if abs(value) < 1e3 else f"{value:,.0f}"
