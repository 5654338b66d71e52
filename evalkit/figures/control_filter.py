"""The data-driven filter of control parameters against filters that know no database.

Root mean square error of the parameters in spreads of the database, over Gaussian noise: left of the break a clean
signal, which shows what a filter does to it by itself; the dashed line is half of the noise. Below: other kinds of
noise at 0.3 spreads. In database: the signal is a part of it. Held out: another performance of the same performer.
Unseen: emotions that the database does not have. Captures: a database from one real take, the signal from another.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, curve, dots, keyed, lettered, lines, looked, plain_log
from evalkit.figures.table import Table

NAME = "filter"
STUDY = "filter"

KINDS = ("drift", "outliers", "dropouts")
BREAK = 0.3
"""Where a clean signal stands on the axis of noise: at this part of the least level."""

LEAST, MOST = 3e-3, 3.0


def draw(table: Table) -> Any:
    """The figure."""
    motions, methods = list(dict.fromkeys(table.rows["motion"])), looked(table.methods)
    made, panels = canvas(PAGE_IN, 5.2, nrows=2, ncols=len(motions), sharex="row", sharey="row", squeeze=False)
    known = table.rows[table.rows["kind"] == "gaussian"]["level"]
    for top, bottom, motion in zip(*panels, motions, strict=True):
        levels = sorted(set(known))
        top.set_xscale("log")
        for method in methods:
            clean = table.of("error", method, motion=motion, kind="clean")
            clean = clean[clean["value"] > 0].assign(level=BREAK * levels[0])
            curve(top, clean, "level", method, label=None)
            curve(top, table.of("error", method, motion=motion, kind="gaussian"), "level", method)
        ends = [BREAK * levels[0] / 1.3, levels[-1] * 1.3]
        top.plot(levels, [level / 2 for level in levels], color="black", linestyle="--", linewidth=0.8)
        top.axvline(0.55 * levels[0], color="#e4e4e4", linewidth=2.0)
        top.set_xlim(*ends)
        top.set_xticks([BREAK * levels[0], *levels], ["clean", *(f"{level:g}" for level in levels)])
        top.minorticks_off()
        plain_log(top.yaxis, LEAST, MOST)
        top.set_title(motion)
        top.set_xlabel("noise, spreads")
        for number, method in enumerate(methods):
            found = table.of("error", method, motion=motion)
            found = found[found["kind"].isin(KINDS)]
            dots(bottom, found, "kind", KINDS, method, 0.7 * (number / max(len(methods) - 1, 1) - 0.5))
        lines(bottom, KINDS)
        plain_log(bottom.xaxis, 0.05, 1.5)
        bottom.set_xlabel("error, spreads")
    panels[0, 0].set_ylabel("error, spreads")
    panels[1, 0].set_ylabel("kind of fault")
    lettered(panels.ravel())
    keyed(made, table, panels[0], ncols=4)
    return made
