"""A row of the speed study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any


@dataclass(frozen=True)
class Row:
    """One measured figure beside its bar and aim.

    Attributes
    ----------
    figure, unit
        What is measured, in which unit; "x" for a ratio.
    measured, bar, aim
        In that unit; a bar of 0: there is none, or its baseline is not installed.
    others
        What other passes have measured.
    less
        Whether less is better.
    note
        The absolute numbers behind a ratio, or what is missing.
    """

    figure: str
    unit: str
    measured: float
    bar: float = 0.0
    aim: float = 0.0
    less: bool = False
    note: str = ""
    others: tuple[float, ...] = ()

    def share(self, value: float) -> float:
        """How many times better than the bar a value is."""
        return self.bar / value if self.less else value / self.bar

    @property
    def least(self) -> float:
        """The least of all passes."""
        return min((self.measured, *self.others))

    @property
    def most(self) -> float:
        """The most of all passes."""
        return max((self.measured, *self.others))

    @property
    def reached(self) -> str:
        """What is reached: aim, bar or no; nothing where there is no bar."""
        if not self.bar:
            return ""
        if self.share(self.measured) >= self.share(self.aim):
            return "aim"
        return "bar" if self.share(self.measured) >= 1.0 else "no"

    def entry(self) -> dict[str, Any]:
        """The row for the table and the JSON file."""
        return {
            "figure": self.figure, "measured": self.measured, "least": self.least, "most": self.most, "unit": self.unit,
            "bar": self.bar or "", "aim": self.aim or "", "reached": self.reached, "note": self.note,
        }  # fmt: skip


def median(rows: Sequence[Row]) -> Row:
    """Of the same figure in an odd number of passes, the median one, which knows the others."""
    middle = sorted(rows, key=lambda row: row.measured)[len(rows) // 2]
    return replace(middle, others=tuple(row.measured for row in rows if row is not middle))
