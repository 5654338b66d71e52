"""Searches for the minimum of the paper's objective.

Question: does the paper's six-directions search find the minimum of its objective, how fast, and from how far away?

Finding: with 10 seeds, takes of 200 frames and all terms, six-directions gets there from 30 and from 100 mm, a median
of 0.10 and 0.05 mm from the minimum, but it takes 529 and 523 calls of the objective (medians of the runs that come
within 0.1 mm, 5 and 9 of 10), where Nelder-Mead takes 79 and 102, BOBYQA 65 and 89, NEWUOA 61 and 80, and they end
nearer. It is slow, and not what limits the accuracy: all of these end at a pivot error of 1.1 mm (rms). The minimum of
the squared variant lies nearer to the truth, 0.82 mm, and L-BFGS finds it in 12 to 15 calls. COBYLA stops 0.3 mm
short, and DIRECT, with 2000 calls for a box of 600 mm, is 4 to 8 mm off. From 300 mm one run in ten of every local
search goes more than a metre astray (Nelder-Mead two), and SLSQP misses the minimum in seven. The angle term alone has
its lowest values at infinity: from 100 mm 4 to 6 runs in ten of every local search go astray, six-directions 4, by 290
km and more; from 300 mm 9 or all. From 30 mm none does, and the error is 9 mm (median).

Command: ``evalkit study run optimisers --budget full``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from evalkit.geometry import Array
from evalkit.metrics import evaluations_to
from evalkit.pivot import Pivot, pivot_estimators
from evalkit.pivot.nlopt_search import ALGORITHMS
from evalkit.pivot.objective import Objective
from evalkit.seeds import generator
from evalkit.studies.objective_terms import ASTRAY_MM, TERMS
from evalkit.studies.takes import HeadTake, head_take, told
from evalkit.study.command import script
from evalkit.study.description import Budget, Study
from evalkit.study.statistics import mean, median, root_mean_square

SQUARED = tuple(f"nlopt-{key}" for key, (name, _) in ALGORITHMS.items() if name.startswith("LD"))
"""Searches of the squared variant, which has a minimum of its own."""

SEARCHES = ("six-directions", *(f"nlopt-{key}" for key in ALGORITHMS))

TO_THE_MINIMUM = (("nlopt-neldermead", "nlopt-sbplx", "nlopt-bobyqa"), ("nlopt-lbfgs", "nlopt-slsqp"))
"""Searches from the truth whose best result counts as the minimum: of Eq. (5), and of its squared variant."""

REACHED_MM = 0.1
"""A minimum counts as found this near: a third of what noise of 0.3 mm leaves of the pivot in such a take."""

FRAMES = 200
"""A short take: what is asked is how a search behaves, and its cost grows with the frames."""


@dataclass(frozen=True, eq=False)
class Search:
    """An objective with its minima near the pivot, and a start.

    Attributes
    ----------
    head : HeadTake
    start : ndarray, shape (3,), mm
    options : dict
        Settings of the objective and the search.
    minima : (ndarray, ndarray), each of shape (3,), mm
        Best known minimum of Eq. (5) and of its squared variant.
    """

    head: HeadTake
    start: Array
    options: dict[str, float]
    minima: tuple[Array, Array]

    def objective(self, position: Array, squared: bool) -> float:
        """Value of the objective or its squared variant at a point (3,), mm."""
        settings = {name: value for name, value in self.options.items() if name.endswith(("_weight", "_scale_mm"))}
        about = Objective(self.head.points, "mean", self.head.origin, **settings)
        return about.squared(position)[0] if squared else float(about(position[None])[0])


def search_from(seed: int, terms: str, start_mm: float, **options: float) -> Search:
    """A take, and a start this far from its pivot in a direction of the seed's own."""
    head = head_take("talking", seed, frames=FRAMES)
    direction = generator("optimisers", "start", seed=seed).standard_normal(3)
    start = head.truth.pivot + start_mm * direction / np.linalg.norm(direction)
    at_truth = Search(head, head.truth.pivot, TERMS[terms], (head.truth.pivot, head.truth.pivot))
    minima = []
    for squared, names in zip((False, True), TO_THE_MINIMUM, strict=True):
        ends = [searched(at_truth, name).position for name in names]
        minima.append(min(ends, key=lambda end, squared=squared: at_truth.objective(end, squared)))  # type: ignore[misc]
    return Search(head, start, {**TERMS[terms], **options}, (minima[0], minima[1]))


def searched(data: Search, method: str, **options: float) -> Pivot:
    """The end of one search."""
    head = data.head
    estimator = pivot_estimators[method]
    return estimator(head.points, head.free, initial=data.start, origin=head.origin, **{**data.options, **options})


COLUMNS = {
    "pivot_mm": "distance of the end from the true pivot, mm",
    "minimum_mm": "distance of the end from the best known minimum near the pivot of what the search minimises, mm",
    "excess": "relative height of the end above that minimum, E / E* - 1; below 0 where a lower place was found",
    "reached": f"1 if the end is within {REACHED_MM:g} mm of the minimum, else 0",
    "astray": f"1 if the end is more than {ASTRAY_MM:g} mm from the true pivot, else 0",
    "evaluations": "calls of the objective",
    "evaluations_to": f"calls until the best point stays within {REACHED_MM:g} mm of the minimum; empty if never",
}
"""Columns of :func:`score_search`."""

STATISTICS = (
    median("pivot_mm", "median error", "mm"),
    root_mean_square("pivot_mm", "pivot error", "mm"),
    median("minimum_mm", "median distance to the minimum", "mm"),
    median("excess", "median excess", ""),
    mean("reached", "share that reach the minimum", "", less=False),
    mean("astray", "share astray", ""),
    median("evaluations", "evaluations", ""),
    median("evaluations_to", "evaluations to the minimum", ""),
    median("seconds", "time", "s"),
)


def score_search(data: Search, pivot: Pivot, squared: bool = False) -> dict[str, Any]:
    """Where a search ended, against the truth and the minimum, and what it cost."""
    end, minimum = pivot.position, data.minima[squared]
    lowest = data.objective(minimum, squared)
    error, off = (float(np.linalg.norm(end - place)) for place in (data.head.truth.pivot, minimum))
    # One row of trace per call, or one per round of six calls: evenly many.
    calls = np.linspace(1, pivot.evaluations, len(pivot.trace))
    first = evaluations_to(pivot.trace[:, 1:4], calls, minimum, REACHED_MM)
    return {
        "pivot_mm": error,
        "minimum_mm": off,
        "excess": data.objective(end, squared) / lowest - 1.0,
        "reached": int(off <= REACHED_MM),
        "astray": int(not error <= ASTRAY_MM),
        "evaluations": pivot.evaluations,
        "evaluations_to": None if np.isnan(first) else first,
    }


def run(data: Search, method: str) -> tuple[Pivot, bool]:
    """The end of a search, and whether it minimised the squared variant."""
    return searched(data, method), method in SQUARED


def score(data: Search, result: tuple[Pivot, bool]) -> dict[str, Any]:
    """As :func:`score_search`."""
    return score_search(data, *result)


question, finding = told(__doc__)

study = Study(
    name="optimisers",
    question=question,
    finding=finding,
    axes={"terms": ("all", "angle alone"), "start_mm": (30.0, 100.0, 300.0)},
    methods=SEARCHES,
    prepare=search_from,
    run=run,
    score=score,
    columns=COLUMNS,
    statistics=STATISTICS,
    full=Budget(seeds=10),
    # Two thousand calls of the global search would take half of the time.
    small=Budget(seeds=2, axes={"start_mm": (30.0, 100.0)}, methods=tuple(m for m in SEARCHES if m != "nlopt-direct")),
)

if __name__ == "__main__":
    script(study)
