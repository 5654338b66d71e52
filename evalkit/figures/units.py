"""The same head in millimetres, centimetres and metres.

(a) Largest difference of a weight from that of the default map in mm; a difference of exactly nothing is drawn at the
left edge. (b) Median condition number of the system as it is solved here (filled signs) and as the paper writes it
(open). (c) Error of the lips, root mean square. 95 % intervals over the takes; the length of the kernel is a fraction
of the distance between the eyes, or 64 of whatever unit the head is in.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, keyed, lettered, lines, plain_log, reach
from evalkit.figures.table import Table
from evalkit.render.colours import BLUE, VERMILION
from evalkit.studies.units import DEFAULT, LITERAL
from evalkit.study.description import Budget

NAME = "units"
STUDY = "units"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",)})

SIGNS = {DEFAULT: (BLUE, "o", -0.15), LITERAL: (VERMILION, "X", 0.15)}
NOTHING = 1e-17
"""Where a difference of nothing is drawn: below the spacing of double precision at a weight of 0.1."""

PANELS = {
    "difference from mm": "largest difference of a weight",
    "condition number": "condition number",
    "lips": "error of the lips, mm rms",
}


def draw(table: Table) -> Any:
    """The figure."""
    units = list(dict.fromkeys(table.rows["model_unit"]))
    made, panels = canvas(PAGE_IN, 2.3, ncols=3, sharey=True)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        for method, (colour, sign, shift) in SIGNS.items():
            for name in (statistic, *(("condition of the paper's system",) if statistic == "condition number" else ())):
                found = table.of(name, method)
                at = [units.index(unit) + shift for unit in found["model_unit"]]
                panel.errorbar(
                    found["value"].clip(lower=NOTHING), at, xerr=reach(found), color=colour, marker=sign,
                    linestyle="", elinewidth=0.8, markerfacecolor=colour if name == statistic else "white",
                    label=method + (", the paper's system" if name != statistic else ""),
                )  # fmt: skip
        lines(panel, units)
        panel.set_xlabel(label)
    plain_log(panels[0].xaxis, NOTHING / 3, 10.0)
    panels[0].set_xticks([1e-16, 1e-12, 1e-8, 1e-4, 1.0])
    plain_log(panels[1].xaxis, 10.0, 1e6)
    panels[2].set_xlim(0.0, 1.15 * table.of("lips")["value"].max())
    panels[0].set_ylabel("unit of the head")
    lettered(panels)
    keyed(made, table, panels, ncols=4)
    return made
