"""What each further sculpted expression brings, from one to eight.

Error of all vertices over that of the rough shapes, root mean square over the same new expressions for any number of
examples, which are drawn at random; 95 % intervals over the draws. Below the dashed line a method is better than none.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table

NAME = "training-size"
STUDY = "training-size"


def draw(table: Table) -> Any:
    """The figure."""
    columns = {str(name): {"character": name} for name in dict.fromkeys(table.rows["character"])}
    rows = (Row("all over rough", "error over that of rough shapes", log=False),)
    made, panels = grid(table, "examples", "sculpted examples", rows, columns, 3.0, log_x=False)
    keyed(made, table, panels.ravel(), ncols=3)
    return made
