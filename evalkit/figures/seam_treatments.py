"""Treatments of the seam between the fields of the face and of the lips.

For three kernels: (a) largest jump across an edge beside the corners of the mouth, over all takes, and (b) error of the
lips, root mean square over the takes with its 95 % interval, at the template's own resolution (filled signs) and with
3,000 vertices (open). Dotted: the jump that is aimed at.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.style import LOOKS, PAGE_IN, canvas, keyed, lettered, lines, look, looked, plain_log, reach
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "seam-treatments"
STUDY = "regions"
SMALL = Budget(seeds=1, axes={"head": ("template 3000",), "kernel": ("exponential", "thin-plate")})

PANELS = {"jump at the corners": "largest jump, mm", "lips": "error of the lips, mm rms"}
COARSE = "template 3000"


def draw(table: Table) -> Any:
    """The figure."""
    kernels = list(dict.fromkeys(table.rows["kernel"]))
    made, panels = canvas(PAGE_IN, 2.9, ncols=2, sharey=True)
    methods = looked(table.methods)
    for panel, (statistic, label) in zip(panels, PANELS.items(), strict=True):
        for k, method in enumerate(methods):
            for head in dict.fromkeys(table.rows["head"]):
                found = table.of(statistic, method, head=head)
                how = look(method)
                at = [
                    kernels.index(name) + 0.2 * (k - 1.5) + (0.07 if head == COARSE else 0) for name in found["kernel"]
                ]
                panel.errorbar(
                    found["value"], at, xerr=reach(found), color=how.colour, marker=how.marker, linestyle="",
                    elinewidth=0.8, markerfacecolor="white" if head == COARSE else how.colour,
                    label=how.name + (", 3,000 vertices" if head == COARSE else ""),
                )  # fmt: skip
        lines(panel, [look(name).name for name in kernels])
        panel.set_xlabel(label)
        ends = table.of(statistic)[["value", "low", "high"]]
        plain_log(panel.xaxis, 0.7 * ends.min(axis=None), 1.4 * ends.max(axis=None))
    assert table.study is not None
    (limit,) = table.study.expected
    panels[0].axvline(limit.limit, color=LOOKS["bound"].colour, linestyle=":")
    panels[0].set_ylabel("kernel")
    lettered(panels)
    keyed(made, table, (panels[0],), ncols=4)
    return made
