"""The bold driver: growth, shrinking and first step of the paper's search.

Question: how do rho, sigma and the first step, which the paper leaves open, change where its search ends and its cost?

Finding: with 6 seeds, takes of 200 frames and a start 100 mm off, no choice changes the error of the pivot: 1.4 to
1.65 mm (rms) in all 36 settings, and none goes astray. They differ in how near the steps along the axes creep to the
minimum, which has edges, and in their price. Halving or quartering the step gives up early on an edge, 0.06 to 0.22 mm
away (median); sigma 0.75 with rho 1.5 ends 0.04 to 0.05 mm away, for some 1900 calls of the objective where the
default, 1.2 and 0.5, takes some 900 and ends 0.06 to 0.13 mm away. Steps that never grow (rho 1) need 1000 to 2300
calls and end no nearer. The first step, 1, 10 or 100 mm, hardly matters once rho is above 1.

Command: ``evalkit study run bold-driver --budget full``.
"""

from __future__ import annotations

from typing import Any

from evalkit.pivot import Pivot
from evalkit.studies.optimisers import COLUMNS, STATISTICS, Search, score_search, search_from, searched
from evalkit.studies.takes import told
from evalkit.study.command import script
from evalkit.study.description import Budget, Study

DRIVERS: dict[str, dict[str, float]] = {
    f"rho {growth:g}, sigma {shrink:g}": {"growth": growth, "shrink": shrink}
    for growth in (1.0, 1.2, 1.5, 2.0)
    for shrink in (0.25, 0.5, 0.75)
}
"""Name to options of the search; 1.2 and 0.5 are its defaults."""


def prepare(seed: int, step_mm: float) -> Search:
    """All terms of the objective, a start 100 mm from the pivot, and a first step."""
    return search_from(seed, "all", 100.0, step_mm=step_mm)


def run(data: Search, method: str) -> Pivot:
    """The paper's search with one driver."""
    return searched(data, "six-directions", **DRIVERS[method])


def score(data: Search, result: Pivot) -> dict[str, Any]:
    """As :func:`evalkit.studies.optimisers.score_search`."""
    return score_search(data, result)


question, finding = told(__doc__)

study = Study(
    name="bold-driver",
    question=question,
    finding=finding,
    axes={"step_mm": (1.0, 10.0, 100.0)},
    methods=tuple(DRIVERS),
    prepare=prepare,
    run=run,
    score=score,
    columns=COLUMNS,
    statistics=STATISTICS,
    full=Budget(seeds=6),
    small=Budget(seeds=2, axes={"step_mm": (10.0,)}),
)

if __name__ == "__main__":
    script(study)
