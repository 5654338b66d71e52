"""Into how many regions the face is split.

Error of all vertices over that of the rough shapes, four examples; 95 % intervals over the seeds. A region that gets
too small is not split, so that the last step may change little.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table

NAME = "region-count"
STUDY = "region-count"


def draw(table: Table) -> Any:
    """The figure."""
    columns = {str(name): {"character": name} for name in dict.fromkeys(table.rows["character"])}
    rows = (Row("all over rough", "error over that of rough shapes", log=False),)
    made, panels = grid(table, "regions", "regions at most", rows, columns, 2.7)
    keyed(made, table, panels.ravel(), ncols=3)
    return made
