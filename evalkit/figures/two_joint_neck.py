"""A neck that nods about one centre and turns about another, under methods that know of one.

Over the distance of the two centres, with three (paper-23) and seven (dense-63) rigid markers: expression error over
that of each frame by itself; distance of the pivot from the centre of the turn, root mean square; and the mean of its
squared error over what its covariance states, where 1 (dashed) is honest. 95 % intervals over the takes.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import LOOKS, keyed
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "two-joint-neck"
STUDY = "two-joint-neck"
SMALL = Budget(seeds=2, axes={"gap_mm": (0, 20)})

COLUMNS = {layout: {"layout": layout} for layout in ("paper-23", "dense-63")}
ROWS = (
    Row("expression over svd", "expression over SVD"),
    Row("pivot", "pivot error, mm rms"),
    Row("normalised error", "error² over stated"),
)


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = grid(table, "gap_mm", "distance of the centres, mm", ROWS, COLUMNS, 5.6, log_x=False)
    for panel in (*panels[0], *panels[2]):
        panel.axhline(1.0, color=LOOKS["bound"].colour, linestyle="--", linewidth=0.8)
    keyed(made, table, panels[0], ncols=4)
    return made
