"""The 2.5D head, as Fig. 3 of Huang et al.

(a) The head with its texture: half a head, and a plate behind it with the outline of the hair. (b) Its wireframe,
with the hair in the plate.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.scenes import built_in_head
from evalkit.figures.table import Table
from evalkit.render.face_figures import beside, head_model, plate_wireframe

NAME = "huang-3"
COLUMNS = ("panel", "part", "vertices", "triangles")


def measure(budget: str) -> list[dict[str, Any]]:
    """The parts of the head that are in either panel, and their sizes."""
    from evalkit.render.head_views import WIRE_PARTS

    head = built_in_head()
    return [
        {
            "panel": panel, "part": part, "vertices": len(head.part_vertices(part)),
            "triangles": len(head.part_triangles(part)),
        }
        for panel, shown in (("a", tuple(head.parts)), ("b", (*WIRE_PARTS, "plate")))
        for part in shown
    ]  # fmt: skip


def draw(table: Table) -> Any:
    """The figure."""
    rows, head = table.rows, built_in_head()
    model, wires = (rows.loc[rows["panel"] == panel, "part"].tolist() for panel in "ab")
    return beside(head_model(head, model), plate_wireframe(head, wires))
