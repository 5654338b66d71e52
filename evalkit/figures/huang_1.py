"""The 23 markers, and where they sit on the face, as Fig. 1 of Huang et al.

(a) The markers of a synthetic talking performer at rest, with lines between neighbours; the three on the forehead,
of which the head motion is estimated, and the pivot as it is estimated from the take. (b) The places of the markers
on the head; the three make the triangle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.scenes import XYZ, built_in_head, place_rows, places
from evalkit.figures.table import Table
from evalkit.render.face_figures import Window, beside, markers_in_space, markers_on_face

NAME = "huang-1"
COLUMNS = ("panel", "role", "label", *XYZ)

WINDOW = Window(np.array([0.0, 5.0, -45.0]), 115.0)
"""Of (a): does not go with the markers, so that a larger face is larger in the picture."""


def measure(budget: str) -> list[dict[str, Any]]:
    """Rest of the markers and pivot in the head's axes and size (a), marker sites of the head (b)."""
    from evalkit.animation import animate
    from evalkit.synthetic import synthesize

    take, truth = synthesize("talking", seed=0)
    head = built_in_head()
    made = animate(take, head, rigid=truth.rigid)
    assert made.pivot is not None
    rest = dict(zip(made.report["marker_order"], np.nanmedian(made.still_markers, axis=0), strict=True))
    return [
        *place_rows(rest, panel="a", role="marker"),
        *place_rows({"pivot": made.pivot}, panel="a", role="pivot"),
        *place_rows({name: head.marker_sites[name] for name in rest}, panel="b", role="marker"),
    ]


def draw(table: Table) -> Any:
    """The figure."""
    rows = table.rows
    space, face = (rows[rows["panel"] == panel] for panel in "ab")
    pivot = places(space[space["role"] == "pivot"])["pivot"]
    return beside(
        markers_in_space(places(space[space["role"] == "marker"]), pivot, WINDOW),
        markers_on_face(built_in_head(), places(face)),
    )
