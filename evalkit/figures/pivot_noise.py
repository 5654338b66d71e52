"""Error of the pivot against the Cramér-Rao bound over the noise of the markers.

A talking head, three rigid markers on the forehead; root mean square over the takes with its 95 % interval: (a) in
mm, (b) over that of the bound.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import COLUMN_IN, LOOKS, canvas, curve, lettered
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "pivot-noise"
STUDY = "pivot-noise"
SMALL = Budget(seeds=4)


def draw(table: Table) -> Any:
    """The figure."""
    made, (above, below) = canvas(COLUMN_IN, 4.6, nrows=2, sharex=True)
    for method in [m for m in LOOKS if m in table.methods]:
        curve(above, table.of("pivot error", method), "noise_mm", method)
        curve(below, table.of("error over bound", method), "noise_mm", method)
    bound = table.of("bound", "joint none").sort_values("noise_mm")
    above.plot(bound["noise_mm"], bound["value"], color=LOOKS["bound"].colour, linestyle="--", label="Cramér-Rao bound")
    below.axhline(1.0, color=LOOKS["bound"].colour, linestyle="--")
    for axes in (above, below):
        axes.set(xscale="log", yscale="log")
    ticks = sorted(table.rows["noise_mm"].unique())
    below.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    below.minorticks_off()
    below.set_xlabel("noise of a marker, mm per axis")
    above.set_ylabel("pivot error, mm rms")
    below.set_ylabel("error over bound")
    lettered((above, below))
    made.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return made
