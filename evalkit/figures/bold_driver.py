"""The bold driver of the paper's search: where it ends and what it costs.

Above: median distance of the end from the minimum, mm; below: median calls of the objective; each plus or minus half
of its 95 % interval, for factors by which a step grows after success (rows) and shrinks after failure (columns) and a
first step of the size above. Takes of 200 frames, start 100 mm from the pivot. Darker is worse.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import PAGE_IN, canvas, heat, lettered, shades
from evalkit.figures.table import Table
from evalkit.studies.bold_driver import DRIVERS
from evalkit.study.description import Budget

NAME = "bold-driver"
STUDY = "bold-driver"
SMALL = Budget(seeds=2, axes={"step_mm": (1.0, 100.0)})

PANELS = {"median distance to the minimum": "{:.2f}", "evaluations": "{:.0f}"}


def draw(table: Table) -> Any:
    """The figure."""
    steps = sorted(table.rows["step_mm"].unique())
    growths = sorted({d["growth"] for d in DRIVERS.values()})
    shrinks = sorted({d["shrink"] for d in DRIVERS.values()})
    made, panels = canvas(PAGE_IN, 3.8, nrows=2, ncols=len(steps), sharex=True, sharey=True, squeeze=False)
    for row, (statistic, text) in enumerate(PANELS.items()):
        found = table.of(statistic).set_index(["step_mm", "method"])
        shape = (len(steps), len(growths), len(shrinks))
        values, reach = np.full(shape, np.nan), np.full(shape, np.nan)
        for (step, method), entry in found.iterrows():
            driver = DRIVERS[method]
            at = steps.index(step), growths.index(driver["growth"]), shrinks.index(driver["shrink"])
            values[at], reach[at] = entry["value"], (entry["high"] - entry["low"]) / 2
        colours = shades(values)
        for k, step in enumerate(steps):
            heat(panels[row, k], values[k], [f"{g:g}" for g in growths], [f"{s:g}" for s in shrinks], colours[k], text,
                 reach[k])  # fmt: skip
            panels[0, k].set_title(f"first step {step:g} mm")
            panels[1, k].set_xlabel("shrinks by $\\sigma$")
    panels[0, 0].set_ylabel("distance, mm\ngrows by $\\rho$")
    panels[1, 0].set_ylabel("calls\ngrows by $\\rho$")
    lettered(panels.ravel())
    return made
