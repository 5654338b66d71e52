"""Head motion left in the rough shapes, with the mapping on either side of the new shape's gradient.

Error of all vertices after turning back, root mean square, in cm where the inner corners of the eyes are 50 cm apart,
over the angle by which all new rough shapes are turned; 95 % intervals over the seeds. With the coefficients from
before turning (dashed) the mapping's own share is left.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table

NAME = "left-or-right-mapping"
STUDY = "left-or-right-mapping"


def draw(table: Table) -> Any:
    """The figure."""
    columns = {str(name): {"character": name} for name in dict.fromkeys(table.rows["character"])}
    rows = (Row("all", "error of all vertices, cm", log=False),)
    made, panels = grid(table, "turn_deg", "head motion left, deg", rows, columns, 2.9, log_x=False)
    keyed(made, table, panels.ravel(), ncols=3)
    return made
