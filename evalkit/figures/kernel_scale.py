"""The length of a kernel, as a fraction of the distance between the eyes.

(a) Error of all moving vertices of the outer skin, (b) of the lips, root mean square, and (c) median condition number
of the system, over that length; 95 % intervals over the takes. 23 markers, no noise, regions for the lips.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "kernel-scale"
STUDY = "kernel-scale"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",), "scale": (0.125, 0.5, 2.0, 8.0)})

PANELS = {
    "all moving": "error of all moving skin, mm rms",
    "lips": "error of the lips, mm rms",
    "condition number": "condition number",
}


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 3.2, ncols=3)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        at_values(panel, table.rows["scale"])
        for method in looked(table.methods):
            curve(panel, table.of(statistic, method), "scale", method)
        panel.set_xlabel("length over distance of the eyes")
        panel.set_ylabel(label)
        ends = table.of(statistic)[["value", "low", "high"]]
        plain_log(panel.yaxis, 0.8 * ends.min(axis=None), 1.25 * ends.max(axis=None))
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made
