"""What the paper's objective is compared with: frame 0, the mean or the median of the markers.

Pivot error (root mean square over the takes, 95 % interval) with the terms and scales of the objective as named, w1 =
w2 = w3 = 1 and l = C = 100 mm where nothing else is said, in the minimum found by (a) the paper's search, (b) Subplex
and, of the squared variant, (c) L-BFGS. Dashed: Cramér-Rao bound. Three rigid markers, 0.3 mm of noise.
"""

from __future__ import annotations

import re
from typing import Any

from evalkit.figures.style import LOOKS, PAGE_IN, canvas, keyed, lettered, lines, plain_log, reach
from evalkit.figures.table import Table
from evalkit.render.colours import BLUE, GREEN, VERMILION
from evalkit.study.description import Budget

NAME = "reference"
STUDY = "objective-terms"
SMALL = Budget(seeds=2, axes={"terms": ("all", "length alone", "angle alone", "l 1000", "C 0.01")})

SEARCHES = {"six-directions": "six-directions", "nlopt-sbplx": "Subplex", "nlopt-lbfgs": "L-BFGS, squared"}
SIGNS = {"frame 0": (VERMILION, "X", -0.2), "mean": (BLUE, "o", 0.0), "median": (GREEN, "^", 0.2)}
"""Reference to colour, sign and place on its line."""


def draw(table: Table) -> Any:
    """The figure."""
    terms = list(dict.fromkeys(table.rows["terms"]))
    made, panels = canvas(PAGE_IN, 2.9, ncols=len(SEARCHES), sharex=True, sharey=True)
    for panel, (search, name) in zip(panels, SEARCHES.items(), strict=True):
        for reference, (colour, sign, shift) in SIGNS.items():
            found = table.of("pivot error", f"{search}, {reference}")
            at = [terms.index(value) + shift for value in found["terms"]]
            panel.errorbar(found["value"], at, xerr=reach(found), color=colour, marker=sign, linestyle="",
                           elinewidth=0.8, label=reference)  # fmt: skip
        bound = float((table.rows["bound_mm"].astype(float) ** 2).mean() ** 0.5)
        panel.axvline(bound, color=LOOKS["bound"].colour, linestyle="--", label="Cramér-Rao bound")
        panel.set_title(name)
        panel.set_xlabel("pivot error, mm rms")
    values = table.of("pivot error")
    ends = values[["low", "high", "value"]]
    plain_log(panels[0].xaxis, 0.7 * ends.min(axis=None), 1.5 * ends.max(axis=None))
    names = [re.sub(r"^([lC]) (.*)", r"$\1$ = \2 mm", name) for name in terms]
    for panel in panels:
        lines(panel, names)
    panels[0].set_ylabel("terms of the objective")
    lettered(panels)
    keyed(made, table, panels, ncols=4)
    return made
