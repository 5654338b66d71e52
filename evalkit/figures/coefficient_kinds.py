"""What the coefficients of the examples are allowed to be.

(a) Error of all vertices over that of the rough shapes and (b) the largest coefficient, with a character's own four
examples and with eight that are drawn at random; 95 % intervals over the seeds. Dashed: the error of no method, and
the coefficient with which a shape is an example itself.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import PAGE_IN, canvas, keyed, lettered, lines, look, looked, plain_log, reach
from evalkit.figures.table import Table

NAME = "coefficient-kinds"
STUDY = "coefficient-kinds"

PANELS = {"all over rough": "error over that of rough shapes", "largest coefficient": "largest coefficient"}


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows
    methods = [name for name in looked(table.methods) if name != "rough"]
    cases = list(dict.fromkeys(zip(rows["character"], rows["examples"], strict=True)))
    made, panels = canvas(PAGE_IN, 1.6 + 0.42 * len(cases), ncols=2, sharey=True)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        for k, method in enumerate(methods):
            found = table.of(statistic, method).dropna(subset=["value"])
            how = look(method)
            at = [
                cases.index(case) + 0.7 * (k / max(1, len(methods) - 1) - 0.5)
                for case in zip(found["character"], found["examples"], strict=True)
            ]
            panel.errorbar(found["value"], at, xerr=reach(found), label=how.name, color=how.colour, marker=how.marker,
                           linestyle="", elinewidth=0.8)  # fmt: skip
        lines(panel, [f"{character},\n{examples}" for character, examples in cases])
        panel.set_xlabel(label)
    ends = table.of("largest coefficient")
    ends = ends[ends["method"].isin(methods)][["value", "low", "high"]]
    plain_log(panels[1].xaxis, 0.8 * ends.min(axis=None), 1.3 * ends.max(axis=None))
    for panel in panels:
        panel.axvline(1.0, color="black", linestyle="--", linewidth=0.8)
    panels[0].set_ylabel("character, examples")
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=6)
    return made
