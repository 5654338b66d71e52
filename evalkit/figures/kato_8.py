"""Expressions that are like none of the four examples, as in Fig. 8 of Kato et al. (2014).

One side of the face against the other, and a mouth that opens with closed lids under raised brows; the same face,
examples, colours and numbers as in the figure of its other expressions. Where no example tells, the methods can only
do what the examples do in part.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.compared import columns, rows_of, sheet
from evalkit.figures.table import Table

NAME = "kato-8"
EXPRESSIONS = ("smirk", "yawn")
COLUMNS = columns(EXPRESSIONS)


def measure(budget: str) -> list[dict[str, Any]]:
    """Shapes of two expressions that are unlike the examples."""
    return rows_of(EXPRESSIONS)


def draw(table: Table) -> Any:
    """The figure."""
    return sheet(table, EXPRESSIONS)
