"""Where the rigid markers sit, and how many there are.

(a) Rotation error with the Cramér-Rao bound of one frame by itself (bars), (b) expression error of the markers that are
not rigid, root mean square over the takes with 95 % intervals; (c) error of the regions of the face with each frame by
itself (SVD), mm rms, plus or minus half of the 95 % interval, darker is worse. 0.3 mm of noise, a neck at rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import LOOKS, PAGE_IN, canvas, dots, heat, keyed, lettered, lines, looked, shades
from evalkit.figures.table import Table
from evalkit.metrics import REGIONS
from evalkit.study.description import Budget

NAME = "marker-layout"
STUDY = "marker-layout"
SMALL = Budget(seeds=1, axes={"markers": ("3 forehead", "4 with bridge", "7 with bridge", "all 23")})


def draw(table: Table) -> Any:
    """The figure."""
    choices = list(dict.fromkeys(table.rows["markers"]))
    made, (a, b, c) = canvas(PAGE_IN, 3.2, ncols=3, width_ratios=(1, 1, 1.5))
    methods = looked(table.methods)
    for k, method in enumerate(methods):
        shift = 0.6 * (k / max(1, len(methods) - 1) - 0.5) if method != "auto" else 0.0
        dots(a, table.of("rotation", method), "markers", choices, method, shift)
        dots(b, table.of("expression", method), "markers", choices, method, shift)
    rows = table.rows.dropna(subset=["bound_deg"])
    squares = rows.groupby("markers")["bound_deg"].apply(lambda x: float(np.sqrt((x.astype(float) ** 2).mean())))
    at = np.array([choices.index(name) for name in squares.index])
    a.vlines(squares, at - 0.45, at + 0.45, color=LOOKS["bound"].colour, linestyle="--", label="bound of one frame")
    lines(a, choices)
    lines(b, [""] * len(choices))
    for panel, statistic in ((a, "rotation"), (b, "expression")):
        panel.set_xlim(0.0, 1.05 * table.of(statistic)[["value", "high"]].max(axis=None))
    a.set_xlabel("rotation error, deg rms")
    b.set_xlabel("expression error, mm rms")
    a.set_ylabel("markers used")
    named = [name for name in choices if len(table.of("rotation", "svd", markers=name))]
    cells = {(n, r): table.of(r, "svd", markers=n).iloc[0] for n in named for r in REGIONS}
    values = np.array([[cells[n, r]["value"] for n in named] for r in REGIONS])
    reach = np.array([[(cells[n, r]["high"] - cells[n, r]["low"]) / 2 for n in named] for r in REGIONS])
    heat(c, values, list(REGIONS), [name.replace(" ", "\n", 1) for name in named], shades(values), "{:.2f}", reach)
    c.set_xlabel("markers used, SVD")
    c.set_ylabel("region, error in mm rms")
    lettered((a, b, c))
    keyed(made, table, (a,))
    return made
