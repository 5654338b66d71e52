"""Rotation error of pose estimators over noise, white and correlated.

A talking head with three (paper-23) and seven (dense-63) rigid markers; root mean square over the takes with its 95 %
interval: above in degrees, below over the Cramér-Rao bound of one frame by itself with white noise. Dotted: that bound
with the pivot known. Correlated noise lasts six frames and is shared by neighbours to one half. Signs of methods that
give the same rotation stand side by side; grey: other packages.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import (
    LOOKS,
    PAGE_IN,
    at_values,
    canvas,
    curve,
    keyed,
    lettered,
    looked,
    plain_log,
)
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "pose-noise"
STUDY = "pose-noise"
SMALL = Budget(seeds=2)

BOUND = LOOKS["bound"].colour
SAME = ("svd", "horn", "qcp", "robust", "peer-scipy", "peer-kineticstoolkit", "translation-invariants")
"""Methods that are drawn side by side."""

ASIDE = 0.07


def draw(table: Table) -> Any:
    """The figure."""
    kinds = list(dict.fromkeys(zip(table.rows["layout"], table.rows["noise"], strict=True)))
    made, panels = canvas(PAGE_IN, 4.6, nrows=2, ncols=len(kinds), sharex=True, sharey="row", squeeze=False)
    for column, (layout, noise) in enumerate(kinds):
        where = {"layout": layout, "noise": noise}
        above, below = panels[:, column]
        above.set_title(f"{layout}, {noise}")
        at_values(below, table.rows["noise_mm"])
        for method in looked(table.methods):
            aside = ASIDE * (SAME.index(method) - len(SAME) // 2) if method in SAME else 0.0
            curve(above, table.of("rotation", method, **where), "noise_mm", method)
            curve(below, table.of("over bound of one frame", method, **where), "noise_mm", method, aside)
        _bounds(table, where, above, below)
        below.set_xlabel("noise, mm per axis")
    values = table.of("rotation")["value"]
    plain_log(panels[0, 0].yaxis, 0.6 * values.min(), 1.6 * values.max())
    panels[1, 0].set_ylim(0.0, None)
    panels[0, 0].set_ylabel("rotation error, deg rms")
    panels[1, 0].set_ylabel("over the bound of one frame")
    lettered(panels.ravel())
    keyed(made, table, (panels[0, 0],), ncols=4)
    return made


def _bounds(table: Table, where: dict[str, str], above: Any, below: Any) -> None:
    """Bounds of one frame by itself, and of one frame with the pivot known."""
    rows = table.rows
    for axis, value in where.items():
        rows = rows[rows[axis] == value]
    squares = (rows.set_index("noise_mm")[["bound_deg", "pivot_bound_deg"]].astype(float) ** 2).groupby("noise_mm")
    bounds = np.sqrt(squares.mean())
    above.plot(bounds.index, bounds["bound_deg"], color=BOUND, linestyle="--", label="bound of one frame")
    above.plot(bounds.index, bounds["pivot_bound_deg"], color=BOUND, linestyle=":", label="the same, pivot known")
    below.axhline(1.0, color=BOUND, linestyle="--")
    below.plot(bounds.index, bounds["pivot_bound_deg"] / bounds["bound_deg"], color=BOUND, linestyle=":")
