"""The bold driver: growth, shrinking and first step of the paper's search.

Question: how do rho, sigma and the first step, which the paper leaves open, change where its search ends and its cost?

Finding: -

Command: ``evalkit study run bold-driver --budget full``.
"""

from __future__ import annotations

from typing import Any

from evalkit.pivot import Pivot
from evalkit.studies.optimisers import COLUMNS, FIGURES, Search, score_search, search_from, searched
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
    figures=FIGURES,
    full=Budget(seeds=8),
    small=Budget(seeds=2, axes={"step_mm": (10.0,)}),
)

if __name__ == "__main__":
    script(study)
