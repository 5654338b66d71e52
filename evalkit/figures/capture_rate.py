"""What frame rate and length of a take are worth.

Over the frame rate, a column for every length: rotation error, expression error and pivot error, root mean square over
the takes with 95 % intervals. Three rigid markers, 0.3 mm of noise in each frame, a neck at rest. The automatic
weighting was not asked of the longest takes.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "capture-rate"
STUDY = "capture-rate"
SMALL = Budget(seeds=1, axes={"rate_hz": (30, 120), "length_s": (3, 10)})

ROWS = (
    Row("rotation", "rotation error, deg rms"),
    Row("expression", "expression error, mm rms"),
    Row("pivot", "pivot error, mm rms"),
)


def draw(table: Table) -> Any:
    """The figure."""
    columns = {f"{length:g} s": {"length_s": length} for length in sorted(table.rows["length_s"].unique())}
    made, panels = grid(table, "rate_hz", "frame rate, Hz", ROWS, columns, 5.8)
    keyed(made, table, panels[0])
    return made
