"""One artist's expressions from a few sculpts and another artist's shapes, over how many were sculpted.

ICT-FaceKit and MakeHuman both have the same named expressions by hand: error of what one artist's shapes become on the
other's head, against what the other sculpted, over that of Deformation Transfer alone ("rough"). Root mean square of
all vertices and of parts; 95 % intervals over random choices of the examples. Below the dashed line a method is better
than none.
"""

from __future__ import annotations

from typing import Any

from evalkit.errors import EvalkitError
from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed
from evalkit.figures.table import Table

NAME = "two-artists"
STUDY = "two-artists"

ROWS = (
    Row("all over rough", "all vertices,\nover rough"),
    Row("lips over rough", "lips,\nover rough"),
    Row("lids over rough", "lids,\nover rough"),
    Row("brows over rough", "brows,\nover rough"),
)


def draw(table: Table) -> Any:
    """The figure.

    Raises
    ------
    EvalkitError
        If the heads were not there when it was measured.
    """
    rows = table.rows
    if not (rows["status"] == "ok").any():
        raise EvalkitError(f"figure {NAME}: {rows['message'].dropna().iloc[0]}")
    columns = {f"{direction}": {"direction": direction} for direction in dict.fromkeys(rows["direction"])}
    made, panels = grid(table, "examples", "sculpted examples", ROWS, columns, 7.2)
    keyed(made, table, panels.ravel(), ncols=3)
    return made
