"""Triangles that blending turns over, over a factor of all coefficients.

Mappings blended by rotation and stretch and entry by entry. Above, triangles a shape that are turned over and are not
in the sculpt; below, the share of blended mappings that reverse a triangle's orientation. 1 is the method itself; with
more it goes beyond the examples, with less than nothing against them. Right: a cheek that one example rolls by 90
degrees one way and another back. 95 % intervals over the seeds.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "blend-kinds"
STUDY = "blend-kinds"
SMALL = Budget(seeds=1, axes={"character": ("template",), "times": (1.0, 3.0)})

ROWS = (
    Row("flipped", "turned over,\ntriangles a shape", log=False),
    Row("reversed mappings", "reversed\nmappings, %", log=False),
)


def draw(table: Table) -> Any:
    """The figure."""
    blended = type(table)(table.rows[table.rows["method"] != "rough"], table.study, table.facts)
    columns = {str(name): {"character": name} for name in dict.fromkeys(table.rows["character"])}
    made, panels = grid(blended, "times", "factor of coefficients", ROWS, columns, 3.8, log_x=False)
    for line in panels:
        line[0].set_ylim(bottom=0.0)
    keyed(made, blended, panels.ravel(), ncols=2)
    return made
