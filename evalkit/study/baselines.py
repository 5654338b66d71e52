"""Old figures against new: what got worse, what got better, by the spread over seeds."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.geometry import Array
from evalkit.results import staged
from evalkit.study.description import Study
from evalkit.study.table import Row, Table, write_csv

SPREADS = 3.0
"""Standard errors over the seeds that a figure may get worse by: with a dozen seeds, a change that draws every error
anew without making it larger is called worse in some 5 % of figures."""

FLOOR = 0.01
"""Relative change that is never called worse: other processors round differently, and searches stop elsewhere."""

EXACT = 1e-6
"""Errors below this, in the figure's own unit, count as none: only rounding is left of them."""


@dataclass(frozen=True)
class Change:
    """One figure, old and new.

    Attributes
    ----------
    condition, method : str
    old, new : float
        Root mean square over the seeds.
    change : float
        Relative change of a typical seed's error, the mean over seeds of ``log(new / old)``.
    tolerance : float
        What that mean may reach.
    verdict : str
        ``same``, ``worse``, ``better``, ``new`` or ``gone``.
    why : str
    """

    condition: str
    method: str
    old: float
    new: float
    change: float
    tolerance: float
    verdict: str
    why: str = ""


def compare(study: Study, old: Sequence[Row], new: Sequence[Row]) -> list[Change]:
    """Every figure of either table.

    Worse is, seed by seed, a mean of ``log(new / old)`` above :data:`SPREADS` of its standard errors and above
    :data:`FLOOR`; or a root mean square over the seeds that grew by more than :data:`SPREADS` standard errors of the
    difference of two such figures, which sees a single seed that went astray; or a seed that has no answer any more.

    Parameters
    ----------
    study : Study
        Its axes name the conditions; its one column ``error`` is compared.
    old, new : sequence of dict
        Rows as in :attr:`Table.rows`.

    Returns
    -------
    list of Change
    """
    before, after = _errors(study, old), _errors(study, new)
    return [_change(key, before.get(key), after.get(key)) for key in dict.fromkeys([*before, *after])]


def _errors(study: Study, rows: Sequence[Row]) -> dict[tuple[str, str], dict[int, float]]:
    """Error of every seed by condition and method; NaN where there was no answer."""
    found: dict[tuple[str, str], dict[int, float]] = {}
    for row in rows:
        condition = ", ".join(str(row[axis]) for axis in study.axes)
        error = row["error"]
        found.setdefault((condition, row["method"]), {})[int(row["seed"])] = np.nan if error is None else float(error)
    return found


def _change(key: tuple[str, str], old: dict[int, float] | None, new: dict[int, float] | None) -> Change:
    if old is None or new is None:
        values = np.array(list((old or new or {}).values()))
        size = float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else np.nan
        numbers = (size, np.nan) if new is None else (np.nan, size)
        return Change(*key, *numbers, np.nan, np.nan, "gone" if new is None else "new")
    seeds = sorted(old.keys() & new.keys())
    a, b = (np.array([part[seed] for seed in seeds], dtype=np.float64) for part in (old, new))
    lost = np.isfinite(a) & ~np.isfinite(b)
    both = np.isfinite(a) & np.isfinite(b)
    a, b = np.where(a < EXACT, EXACT, a)[both], np.where(b < EXACT, EXACT, b)[both]
    if not len(a):
        verdict = "worse" if lost.any() else "same"
        return Change(
            *key, np.nan, np.nan, np.nan, np.nan, verdict, "no seed has an answer any more" if lost.any() else ""
        )
    steps = np.log(b / a)
    error = float(steps.std(ddof=1) / np.sqrt(len(steps))) if len(steps) > 1 else 0.0
    change, tolerance = float(steps.mean()), max(FLOOR, SPREADS * error)
    was, now = float(np.sqrt((a**2).mean())), float(np.sqrt((b**2).mean()))
    room = SPREADS * np.sqrt(2.0) * _spread(a) + FLOOR * was  # the difference of two draws
    verdict, why = "same", ""
    if lost.any():
        verdict, why = "worse", f"{lost.sum()} seeds have no answer any more"
    elif change > tolerance:
        verdict, why = "worse", f"a typical error grew by {np.expm1(change):.1%}, more than {np.expm1(tolerance):.1%}"
    elif now - was > room:
        verdict, why = "worse", f"the rms grew by {now - was:.3g}, more than {room:.3g}"
    elif change < -tolerance:
        verdict, why = "better", f"a typical error shrank by {-np.expm1(change):.1%}"
    return Change(*key, was, now, change, tolerance, verdict, why)


def _spread(errors: Array) -> float:
    """Standard error of the root mean square of errors (N,), by the delta method."""
    if len(errors) < 2:
        return 0.0
    square = errors**2
    return float(square.std(ddof=1) / np.sqrt(len(errors)) / (2.0 * np.sqrt(square.mean())))


def report(changes: Iterable[Change], every: bool = False) -> str:
    """Changes as text, one line each; those that stayed the same only if asked for."""
    changes = list(changes)
    shown = [c for c in changes if every or c.verdict != "same"]
    lines = [
        f"{c.verdict:<7}{c.condition:<14}{c.method:<34}{c.old:>11.4g} -> {c.new:<11.4g}{c.why}".rstrip() for c in shown
    ]
    count = {v: sum(c.verdict == v for c in changes) for v in ("same", "worse", "better", "new", "gone")}
    return "\n".join([*lines, ", ".join(f"{n} {v}" for v, n in count.items() if n)])


def read_baseline(path: Path) -> list[Row]:
    """Rows of a baseline file.

    Raises
    ------
    EvalkitError
        If there is none, or it is not one.
    """
    if not path.exists():
        raise EvalkitError(
            f"{path}: no baseline there; run in a checkout of evalkit, or name its folder with --baselines"
        )
    rows: list[Row] = []
    try:
        with path.open(newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                error = float(row["error"]) if row["error"] else None
                rows.append({**row, "seed": int(row["seed"]), "error": error})
    except (KeyError, ValueError, TypeError) as problem:
        raise EvalkitError(f"{path}, line {len(rows) + 2}: not a row of a baseline ({problem})") from problem
    except OSError as problem:
        raise EvalkitError(f"{path}: cannot be read ({problem.strerror})") from problem
    return rows


def write_baseline(table: Table, folder: Path) -> None:
    """The rows of a table as the new baseline, and where they come from."""
    axes = list(table.study.axes)
    rows: list[dict[str, Any]] = [
        {**row, "error": None if row["error"] is None else f"{row['error']:.9g}"} for row in table.rows
    ]
    columns = [*axes, "method", "seed", "error"]
    with staged(folder) as stage:
        write_csv([{c: row[c] for c in columns} for row in rows], columns, stage / f"{table.study.name}.csv")
        facts = json.dumps(table.provenance, indent=2) + "\n"
        (stage / f"{table.study.name}.json").write_text(facts, encoding="utf-8")
