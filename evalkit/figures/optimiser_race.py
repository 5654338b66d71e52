"""How fast searches come to the minimum of the paper's objective.

Distance of the best point so far to the minimum near the pivot, over the calls of the objective, from starts (a) 30 mm
and (b) 100 mm off the pivot: median over the takes, with the quartiles as a band for the paper's search and L-BFGS.
Takes of 200 frames, all terms; below, (c) and (d), the error of the pivot at that point. A search that has ended keeps
its end. L-BFGS, MMA and SLSQP minimise the squared variant and are held against its own minimum. Dotted: the distance
at which a minimum counts as found.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from evalkit.figures.style import LOOKS, PAGE_IN, canvas, keyed, lettered, look, looked, plain_log
from evalkit.figures.table import Table
from evalkit.geometry import Array
from evalkit.studies.optimisers import REACHED_MM, SEARCHES, SQUARED, search_from, searched

NAME = "optimiser-race"
COLUMNS = ("start_mm", "method", "seed", "evaluations", "minimum_mm", "pivot_mm")

STARTS_MM = (30.0, 100.0)
SEEDS = {"small": 3, "full": 20}
LIMIT = 2000
CALLS = np.unique(np.round(np.geomspace(1, LIMIT, 60)).astype(int))
"""Calls of the objective at which searches are looked at."""

BANDS = ("six-directions", "nlopt-lbfgs")


def measure(budget: str) -> list[dict[str, Any]]:
    """A row per start, search, take and number of calls."""
    # Two thousand calls of the global search would take half of the time.
    searches = SEARCHES if budget == "full" else tuple(name for name in SEARCHES if name != "nlopt-direct")
    rows = []
    for start in STARTS_MM:
        for seed in range(SEEDS[budget]):
            data = search_from(seed, "all", start)
            for method in searches:
                found = searched(data, method)
                # One row of trace per call, or one per round of six calls: evenly many.
                calls = np.linspace(1, found.evaluations, len(found.trace))
                off, error = (
                    _distance(found.trace[:, 1:4], calls, place)
                    for place in (data.minima[method in SQUARED], data.head.truth.pivot)
                )
                keys = {"start_mm": start, "method": method, "seed": seed}
                rows += [
                    {**keys, "evaluations": int(n), "minimum_mm": _five(a), "pivot_mm": _five(b)}
                    for n, a, b in zip(CALLS, off, error, strict=True)
                ]
    return rows


def _five(value: float) -> float:
    """Five digits: with all of them the table would be a megabyte."""
    return float(f"{value:.5g}")


def _distance(path: Array, calls: Array, place: Array) -> Array:
    """Distance of the best point so far from a place, after each of :data:`CALLS`."""
    at = np.searchsorted(calls, CALLS, side="right") - 1
    return np.asarray(np.linalg.norm(path[np.maximum(at, 0)] - place, axis=1))


def draw(table: Table) -> Any:
    """The figure."""
    made, panels = canvas(PAGE_IN, 5.2, nrows=2, ncols=2, sharex=True, sharey="row")
    starts = sorted(table.rows["start_mm"].unique())
    for row, (column, label) in enumerate(
        (("minimum_mm", "distance to the minimum, mm"), ("pivot_mm", "pivot error, mm"))
    ):
        for panel, start in zip(panels[row], starts, strict=False):
            part = table.rows[table.rows["start_mm"] == start]
            for method in looked(list(dict.fromkeys(part["method"]))):
                _one(panel, part[part["method"] == method], column, method)
            if row == 0:
                panel.set_title(f"start {start:g} mm from the pivot")
                panel.axhline(REACHED_MM, color=LOOKS["bound"].colour, linestyle=":", linewidth=0.8)
            else:
                panel.set_xlabel("calls of the objective")
        panels[row, 0].set_ylabel(label)
        values = table.rows[column]
        plain_log(panels[row, 0].yaxis, max(1e-3, 0.5 * values.quantile(0.02)), 2.0 * values.quantile(0.99))
    plain_log(panels[0, 0].xaxis, 1, CALLS[-1])
    lettered(panels.ravel())
    keyed(made, table, (panels[0, 0],), ncols=4)
    return made


def _one(panel: Any, part: Any, column: str, method: str) -> None:
    """Median of a search over its takes, and quartiles."""
    how = look(method)
    found = part.groupby("evaluations")[column]
    middle = found.median()
    panel.plot(middle.index, middle, color=how.colour, linestyle=how.line, marker=how.marker, markevery=9, markersize=3,
               label=how.name)  # fmt: skip
    if method in BANDS:
        panel.fill_between(middle.index, found.quantile(0.25), found.quantile(0.75), color=how.colour, alpha=0.15,
                           linewidth=0)  # fmt: skip
