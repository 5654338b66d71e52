"""Error of the pivot against the Cramér-Rao bound over the noise of the markers.

A talking head whose neck rests, three rigid markers on the forehead; root mean square over the takes with its 95 %
interval: (a) in mm, (b) over that of the bound. Grey: other packages.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import COLUMN_IN, LOOKS, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "pivot-noise"
STUDY = "pivot-noise"
SMALL = Budget(seeds=4)
# In 40 takes luck alone puts an efficient estimator up to a quarter below the bound or above it.
FULL = Budget(seeds=150)


def draw(table: Table) -> Any:
    """The figure."""
    return against_bound(table, "noise_mm", "noise of a marker, mm per axis")


def against_bound(table: Table, axis: str, label: str) -> Any:
    """Pivot error in mm and over the bound's, over an axis of a study."""
    made, (above, below) = canvas(COLUMN_IN, 5.0, nrows=2, sharex=True)
    at_values(below, table.rows[axis])
    for panel, statistic in ((above, "pivot error"), (below, "error over bound")):
        for method in looked(table.methods):
            curve(panel, table.of(statistic, method), axis, method)
        found = table.of(statistic)
        plain_log(panel.yaxis, 0.6 * found["value"].min(), 1.6 * found["high"].fillna(found["value"]).max())
    # How much of a sway was modelled differs; the bound of a neck at rest is that of joint told so.
    curve(above, table.of("bound", "joint none"), axis, "bound")
    below.axhline(1.0, color=LOOKS["bound"].colour, linestyle="--")
    below.set_xlabel(label)
    above.set_ylabel("pivot error, mm rms")
    below.set_ylabel("error over bound")
    lettered((above, below))
    keyed(made, table, (above,), ncols=2)
    return made
