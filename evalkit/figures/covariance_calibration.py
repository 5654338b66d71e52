"""Whether stated uncertainties are honest.

(a) Share of the takes in which the true pivot lies in the stated 95 % ellipsoid, with Wilson's 95 % interval; dashed:
0.95. (b) Mean squared error over what is stated, and (c) rotation error over what is predicted, with bootstrap 95 %
intervals; dashed: 1. (d) Of all takes in which the model holds, and (e) of the two in which it does not, sway of 20 mm
and sliding skin: share of the takes whose error is below the stated quantile; honest is the diagonal. Grey: the 95 %
band of Dvoretzky, Kiefer, Wolfowitz and Massart about it for the number of seeds, since takes of one seed share their
noise. A smoothed pose has the pivot of joint and is in (c) alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evalkit.figures.style import LOOKS, PAGE_IN, canvas, dots, keyed, lettered, lines, look, looked, plain_log
from evalkit.figures.table import Table, shares
from evalkit.geometry import Array
from evalkit.render.colours import GREY
from evalkit.studies.takes import SMOOTHED
from evalkit.study.description import Budget

NAME = "covariance-calibration"
STUDY = "covariance-calibration"
SMALL = Budget(seeds=3)

BROKEN = ("sway 20 mm", "skin 2 mm")
"""Takes that the model of the joint estimate does not describe."""

MOVING = ("sway 5 mm", *BROKEN)
"""Takes for which a pivot that rests is no model either."""

BLACK = LOOKS["bound"].colour


def draw(table: Table) -> Any:
    """The figure."""
    from matplotlib.gridspec import GridSpec

    made, _ = canvas(PAGE_IN, 5.6)
    made.clear()
    grid = GridSpec(2, 6, figure=made, height_ratios=(1.5, 1))
    a, b, c = (made.add_subplot(grid[0, 2 * k : 2 * k + 2]) for k in range(3))
    d, e = (made.add_subplot(grid[1, 3 * k : 3 * k + 3]) for k in range(2))
    takes = list(dict.fromkeys(table.rows["take"]))
    stated = [m for m in looked(table.methods) if table.rows[table.rows["method"] == m]["inside_95"].notna().any()]
    for k, method in enumerate(stated):
        shift = 0.7 * (k / max(1, len(stated) - 1) - 0.5)
        if method != SMOOTHED:
            dots(a, shares(table.of("inside 95 %, honest 0.95", method)), "take", takes, method, shift)
            dots(b, table.of("normalised error², honest 1", method), "take", takes, method, shift)
        dots(c, table.of("rotation error over stated", method), "take", takes, method, shift)
    a.axvline(0.95, color=BLACK, linestyle="--", linewidth=0.8)
    for panel in (b, c):
        panel.axvline(1.0, color=BLACK, linestyle="--", linewidth=0.8)
    for panel in (a, b, c):
        lines(panel, takes if panel is a else [""] * len(takes))
    squares = table.of("normalised error², honest 1").dropna(subset=["value"])
    plain_log(b.xaxis, 0.5 * squares["value"].min(), 2.0 * squares["value"].max())
    a.set_xlim(0.0, 1.02)
    a.set_xlabel("share in the 95 % ellipsoid")
    b.set_xlabel("error² over stated")
    c.set_xlabel("rotation error over predicted")
    a.set_ylabel("take")
    held = table.rows[~table.rows["take"].isin(MOVING)]
    for panel, rows, words in (
        (d, held, "model holds, neck at rest"), (e, table.rows[table.rows["take"].isin(BROKEN)], "model broken")
    ):  # fmt: skip
        _quantiles(panel, rows, [method for method in stated if method != SMOOTHED])
        panel.set_title(words)
        panel.set_xlabel("stated quantile of the error")
        panel.set_ylabel("share of takes below")
    lettered((a, b, c, d, e))
    keyed(made, table, (a, c), ncols=4)
    return made


def _quantiles(panel: Any, rows: Any, methods: list[str]) -> None:
    """The distribution of the quantile at which each truth lies, method by method."""
    from scipy.stats import chi2

    count = 0
    for method in methods:
        part = rows[(rows["method"] == method) & rows["normalised"].notna()]
        if not len(part):
            continue
        freedoms = part["axes"].to_numpy(dtype=float)
        found = np.sort(chi2.cdf(part["normalised"].to_numpy(dtype=float) * freedoms, freedoms))
        count = max(count, part["seed"].nunique())
        how = look(method)
        panel.step([0.0, *found, 1.0], [0.0, *_shares(found), 1.0], where="post", color=how.colour, linestyle=how.line)
    if count:
        width = float(np.sqrt(np.log(2.0 / 0.05) / (2.0 * count)))
        x = np.linspace(0.0, 1.0, 201)
        panel.fill_between(x, np.maximum(x - width, 0), np.minimum(x + width, 1), color=GREY, alpha=0.2, linewidth=0)
    panel.plot([0, 1], [0, 1], color=BLACK, linestyle="--", linewidth=0.8)
    panel.set(xlim=(0, 1), ylim=(0, 1.02))


def _shares(found: ArrayLike) -> Array:
    count = len(np.asarray(found))
    return np.arange(1, count + 1) / count
