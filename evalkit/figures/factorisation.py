"""Head pose apart from deformation: factorisation against alignment on rigid markers.

Root mean square over the takes, 95 % intervals, over the noise per axis; 63 markers, seven of them rigid: above the
error of the head's rotation, below that of the shape. Localised: fixed fields over parts of the face; nonlinear: speech
as well, the jaw turning about its joint; Gaussian: every marker moves at random by each of four shapes, none is rigid.
Where a factorisation is refused, as in all faces, it has no sign; the dotted curve is what it would have given. Without
noise what is laid on rigid markers is exact but for rounding, far below the panels.
"""

from __future__ import annotations

from typing import Any

from evalkit.figures.grid import Row, grid
from evalkit.figures.style import keyed, plain_log
from evalkit.figures.table import Table
from evalkit.study.description import Budget

NAME = "factorisation"
STUDY = "factorisation"
SMALL = Budget(seeds=1, axes={"layout": ("dense-63",), "noise_mm": (0.25, 0.5)})

COLUMNS = {title: {"layout": "dense-63", "bases": title.lower()} for title in ("Localised", "Nonlinear", "Gaussian")}


def draw(table: Table) -> Any:
    """The figure."""
    # Refused everywhere in a panel, a method has no ends that the grid's own axis could be made of.
    rows = (Row("rotation", "rotation error, deg rms", log=False), Row("shape", "shape error, mm rms", log=False))
    made, panels = grid(table, "noise_mm", "noise, mm per axis", rows, COLUMNS, 5.0, log_x=False)
    plain_log(panels[0, 0].yaxis, 0.08, 200.0)
    plain_log(panels[1, 0].yaxis, 0.3, 200.0)
    keyed(made, table, panels[0], ncols=3)
    return made
