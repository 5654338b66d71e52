"""Takes without truth: how far a marker still moves that the head motion was not estimated from.

Root mean square distance of the marker left out from its mean place, in the reference pose, one panel per take; what is
left is its own motion over the skull, the same for all methods, and the error of the estimate. Nothing in it is random
and there are no intervals.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, dots, keyed, lettered, lines, looked
from evalkit.figures.table import Table

NAME = "real-takes"
STUDY = "real-takes"


def draw(table: Table) -> Any:
    """The figure."""
    takes = list(dict.fromkeys(table.rows["take"]))
    held = {take: list(dict.fromkeys(table.rows[table.rows["take"] == take]["held_out"])) for take in takes}
    most = max(map(len, held.values()))
    made, panels = canvas(PAGE_IN, 1.2 + 0.33 * most, ncols=len(takes), squeeze=False, sharex=True)
    methods = looked(table.methods)
    for panel, take in zip(panels[0], takes, strict=True):
        for k, method in enumerate(methods):
            found = table.of("motion left", method, take=take)
            dots(panel, found, "held_out", held[take], method, 0.6 * (k / max(1, len(methods) - 1) - 0.5))
        lines(panel, held[take])
        panel.set_title(str(take))
        panel.set_xlim(0.0, 1.05 * table.of("motion left")["value"].max())
        panel.set_xlabel("motion left, mm rms")
        panel.set_ylabel("marker left out")
    lettered(panels[0])
    keyed(made, table, panels[0], ncols=4)
    return made
