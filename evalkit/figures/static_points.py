"""Centres that never move, on the rear of the head and the neck.

Over their number: (a) drift of the rim of the mask, (b) error of the face, root mean square over the takes with 95 %
intervals. 23 markers, no noise.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "static-points"
STUDY = "static-points"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",), "static": (0, 10, 40)})

PANELS = {"drift of the rim": "drift of the rim, mm rms", "face": "error of the face, mm rms"}


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 2.9, ncols=2)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        at_values(panel, table.rows["static"], log=False)
        for method in looked(table.methods):
            curve(panel, table.of(statistic, method), "static", method)
        panel.set_xlabel("static centres")
        panel.set_ylabel(label)
        ends = table.of(statistic)[["value", "low", "high"]]
        plain_log(panel.yaxis, 0.8 * ends.min(axis=None), 1.25 * ends.max(axis=None))
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made
