"""Markers synthesised from control parameters, against the true ones.

Root mean square distance over all markers and frames. (a) Motions that the database does not have, clean and with noise
of 0.3 spreads that the filter has taken off; (b) held-out performance, clean, when windows have 6 or 20 frames instead
of 10, 5 or 100 examples are combined instead of 30, windows are the paper's segments, or are not blended. Nearest
possible: for every frame that of the database whose markers are nearest to the true ones.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, dots, keyed, lettered, lines, looked, plain_log
from evalkit.figures.table import Table

NAME = "synthesis"
STUDY = "synthesis"

NOISE = {0.0: "clean", 0.3: "noisy, filtered"}
VARIED = {"window": "window {}", "examples": "{} examples", "blend": "{}"}


def draw(table: Table) -> Any:
    """The figure."""
    methods, rows = looked(table.methods), table.rows
    usual = {axis: rows[axis].iloc[0] for axis in VARIED}
    found = table.of("marker error").copy()
    whole = found[[*VARIED]].eq(usual).all(axis=1)
    by_motion = found[whole].assign(
        line=[f"{motion}\n{NOISE.get(noise, noise)}" for motion, noise in found.loc[whole, ["motion", "noise"]].values]
    )
    first = found[(found["motion"] == rows["motion"].iloc[0]) & (found["noise"] == rows["noise"].iloc[0])]
    varied = [first[first[[*VARIED]].eq(usual).all(axis=1)].assign(line="as in (a)")]
    for axis, words in VARIED.items():
        other = first[first[axis] != usual[axis]]
        varied.append(other.assign(line=[words.format(value) for value in other[axis]]))
    made, panels = canvas(PAGE_IN, 5.0, ncols=2)
    import pandas as pd

    for panel, part in zip(panels, (by_motion, pd.concat(varied)), strict=True):
        names = list(dict.fromkeys(part["line"]))
        for number, method in enumerate(methods):
            shift = 0.8 * (number / max(len(methods) - 1, 1) - 0.5)
            dots(panel, part[part["method"] == method], "line", names, method, shift)
        lines(panel, names)
        plain_log(panel.xaxis, 0.8 * found["value"].min(), 1.25 * found["value"].max())
        panel.set_xlabel("marker error, mm rms")
    for panel, what in zip(panels, ("motion and noise", "what is varied"), strict=True):
        panel.set_ylabel(what)
    lettered(panels)
    keyed(made, table, panels, ncols=4)
    return made
