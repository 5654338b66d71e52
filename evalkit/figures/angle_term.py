"""Where the angle term of the paper's objective diverges.

Takes of 200 frames, starts at random directions from the pivot. Above: share of the searches that end more than a
metre off, with (a) all terms and (b) the angle term alone; below, (c) and (d), their median pivot error. 95 %
intervals over the takes, of shares by Wilson; signs stand side by side. DIRECT searches a box and cannot leave it.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, at_values, canvas, curve, keyed, lettered, looked, plain_log
from evalkit.figures.table import Table, shares
from evalkit.study.description import Budget

NAME = "angle-term"
STUDY = "optimisers"
SMALL = Budget(
    seeds=3,
    axes={"start_mm": (30.0, 300.0)},
    methods=("six-directions", "nlopt-neldermead", "nlopt-sbplx", "nlopt-bobyqa", "nlopt-lbfgs"),
)

ASIDE = 0.045


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 4.8, nrows=2, ncols=2, sharex=True, sharey="row")
    methods = looked(table.methods)
    for column, terms in enumerate(("all", "angle alone")):
        above, below = panels[:, column]
        at_values(below, table.rows["start_mm"])
        for k, method in enumerate(methods):
            aside = ASIDE * (k - len(methods) / 2)
            curve(above, shares(table.of("share astray", method, terms=terms)), "start_mm", method, aside)
            curve(below, table.of("median error", method, terms=terms), "start_mm", method, aside)
        above.set_title("all terms" if terms == "all" else terms)
        below.set_xlabel("distance of the start from the pivot, mm")
    values = table.of("median error")
    ends = values[["low", "high", "value"]]
    plain_log(panels[1, 0].yaxis, 0.7 * ends.min(axis=None), 1.5 * ends.max(axis=None))
    panels[0, 0].set_ylim(-0.03, 1.03)
    panels[0, 0].set_ylabel("share astray")
    panels[1, 0].set_ylabel("median pivot error, mm")
    lettered(panels.ravel())
    keyed(made, table, (panels[0, 0],), ncols=4)
    return made
