"""Tables and verdicts of the benchmarks."""

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """A limit and what was measured against it.

    Attributes:
        name: What was measured, and where.
        unit: Unit of both numbers.
        value: What was measured.
        limit: What it should stay at or below.
    """

    name: str
    unit: str
    value: float
    limit: float

    @property
    def met(self) -> bool:
        """Whether the limit is kept."""
        return self.value <= self.limit


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """A Markdown table with aligned columns: names to the left, numbers to the right."""
    widths = [max(len(row[k]) for row in (header, *rows)) for k in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        padded = (cell.rjust(w) if k else cell.ljust(w) for k, (cell, w) in enumerate(zip(cells, widths, strict=True)))
        return f"| {' | '.join(padded)} |"

    rule = ["-" * (w + 1) + ":" if k else "-" * (w + 2) for k, w in enumerate(widths)]
    return [line(header), f"|{'|'.join(rule)}|", *map(line, rows)]


def three_digits(number: float) -> str:
    """A number with three digits, or as many as its whole part has; never with an exponent."""
    return f"{number:.3g}" if abs(number) < 999.5 else f"{number:.0f}"


def targets_lines(targets: Sequence[Target]) -> list[str]:
    """One line per target: met or not."""
    return [f"{'met ' if t.met else 'MISS'}  {t.name}: {t.value:.3g} {t.unit} (limit {t.limit:g})" for t in targets]
