"""Panels of curves: a statistic per row, a part of the study per column, a curve per method."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, lettered, looked, plain_log

if TYPE_CHECKING:
    from evalkit.figures.table import Table


class Row(NamedTuple):
    """One row of panels."""

    statistic: str
    label: str
    log: bool = True


def grid(
    table: Table, axis: str, label: str, rows: Sequence[Row], columns: Mapping[str, Mapping[str, Any]],
    height_in: float, width_in: float = PAGE_IN, log_x: bool = True,
) -> tuple[Any, Any]:  # fmt: skip
    """Curves over an axis of the study in panels.

    Parameters
    ----------
    table : Table
    axis, label : str
        Axis of the study, and what is written below it.
    rows : sequence of Row
        Statistics, one row of panels each, that share their vertical axis.
    columns : mapping
        Title to the values of other axes that the column is about.
    height_in, width_in : float
    log_x : bool

    Returns
    -------
    (Figure, ndarray of Axes)
        Panels of shape (rows, columns), without a legend as yet.
    """
    made, panels = canvas(
        width_in, height_in, nrows=len(rows), ncols=len(columns), sharex=True, sharey="row", squeeze=False
    )
    for number, (line, row) in enumerate(zip(panels, rows, strict=True)):
        ends = []
        for panel, (title, where) in zip(line, columns.items(), strict=True):
            at_values(panel, table.rows[axis], log_x)
            for method in looked(table.methods):
                found = table.of(row.statistic, method, **where)
                curve(panel, found, axis, method)
                ends.append(found[["value", "low", "high"]])
            if number == 0:
                panel.set_title(title)
            if number == len(rows) - 1:
                panel.set_xlabel(label)
        if row.log:
            low = min(e.min(axis=None) for e in ends if len(e))
            plain_log(line[0].yaxis, 0.8 * low, 1.25 * max(e.max(axis=None) for e in ends if len(e)))
        line[0].set_ylabel(row.label)
    lettered(panels.ravel())
    return made, panels
