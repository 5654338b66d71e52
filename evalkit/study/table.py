"""The tables of a study: rows of cells, the summary over seeds, and their files."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.study.description import Expected, Study
from evalkit.study.statistics import Statistic, with_interval

Row = dict[str, Any]

SUMMARY_COLUMNS = ("method", "statistic", "unit", "value", "low", "high", "standard_error", "seeds", "failed")


@dataclass(frozen=True, eq=False)
class Table:
    """What a study measured.

    Attributes
    ----------
    study : Study
        As it was cut by its budget.
    rows : list of dict
        One per cell and method: axes, method, seed, status (``ok`` or ``failed``), message, the study's columns.
        The same in every run.
    machine : list of dict
        One per row: axes, method, seed, ``seconds`` of the method's run, the study's machine columns.
    provenance : dict
    """

    study: Study
    rows: list[Row]
    machine: list[Row]
    provenance: dict[str, Any]

    @property
    def summary(self) -> list[Row]:
        """One row per condition, method and statistic; see :data:`SUMMARY_COLUMNS`."""
        return summarised(self.study, self.rows, [f for f in self.study.statistics if not _on_machine(self.study, f)])

    @property
    def machine_summary(self) -> list[Row]:
        """The same of the columns that depend on the machine."""
        return summarised(self.study, self.machine, [f for f in self.study.statistics if _on_machine(self.study, f)])

    @property
    def failed(self) -> list[Row]:
        """Rows whose method gave no answer."""
        return [row for row in self.rows if row["status"] != "ok"]


def _on_machine(study: Study, statistic: Statistic) -> bool:
    return any(column == "seconds" or column in study.machine for column in statistic.columns)


def summarised(study: Study, rows: Sequence[Row], statistics: Sequence[Statistic]) -> list[Row]:
    """Statistics over the seeds of every condition and method; failed rows are counted, never dropped in silence."""
    groups: dict[tuple[Any, ...], dict[str, dict[int, Row]]] = {}
    for row in rows:
        condition = tuple(row[axis] for axis in study.axes)
        groups.setdefault(condition, {}).setdefault(row["method"], {})[row["seed"]] = row
    out = []
    for condition, methods in groups.items():
        for method, mine in methods.items():
            for statistic in statistics:
                if statistic.against and statistic.against not in methods:
                    continue
                columns = [_values(row, statistic.columns) for row in mine.values()]
                if statistic.against:
                    other = methods[statistic.against]
                    blank = dict.fromkeys(statistic.columns)
                    columns = [
                        values + _values(other.get(seed, blank), statistic.columns)
                        for seed, values in zip(mine, columns, strict=True)
                    ]
                array = np.array(columns, dtype=np.float64).reshape(len(mine), -1)
                array = array[np.isfinite(array).all(axis=1)]
                value, low, high, error = with_interval(statistic, array)
                out.append(
                    {
                        **dict(zip(study.axes, condition, strict=True)),
                        "method": method, "statistic": statistic.name, "unit": statistic.unit,
                        "value": value, "low": low, "high": high, "standard_error": error,
                        "seeds": len(array), "failed": len(mine) - len(array),
                    }
                )  # fmt: skip
    return out


def _values(row: Mapping[str, Any], columns: Iterable[str]) -> list[float]:
    """Numbers of a row; NaN where there is none."""
    found = (row.get(column) for column in columns)
    return [float(value) if isinstance(value, (int, float)) else math.nan for value in found]


def verdicts(study: Study, summary: Sequence[Row]) -> list[tuple[str, bool]]:
    """Each expectation of the study in words with the value reached, and whether it is met."""
    out = []
    for limit in study.expected:
        found = [row for row in summary if _fits(row, limit)]
        for row in found:
            met = row["value"] >= limit.limit if limit.least else row["value"] <= limit.limit
            where = ", ".join(f"{axis} {row[axis]}" for axis in study.axes)
            word = "at least" if limit.least else "at most"
            text = f"{row['statistic']} {word} {limit.limit:g} - {short(row)}"
            out.append((f"{row['method']} ({where}): {text}", bool(met)))
    return out


def _fits(row: Row, limit: Expected) -> bool:
    same = row["statistic"] == limit.statistic and row["method"] == limit.method
    return same and all(row.get(axis) == value for axis, value in limit.where.items())


def short(row: Row) -> str:
    """Value and interval of a row of the summary, three digits."""
    if math.isnan(row["value"]):
        return "-"
    text = f"{row['value']:.3g}"
    return text if math.isnan(row["low"]) else f"{text} [{row['low']:.3g}, {row['high']:.3g}]"


def printed(study: Study, summary: Sequence[Row]) -> str:
    """The summary as text: a block per condition, a line per method, a column per statistic."""
    lines: list[str] = []
    names = list(dict.fromkeys(row["statistic"] for row in summary))
    units = {row["statistic"]: row["unit"] for row in summary}
    for condition in dict.fromkeys(tuple(row[axis] for axis in study.axes) for row in summary):
        block: dict[str, dict[str, Row]] = {}
        for row in summary:
            if tuple(row[axis] for axis in study.axes) == condition:
                block.setdefault(row["method"], {})[row["statistic"]] = row
        heads = ["", *(f"{name}, {units[name]}" if units[name] else name for name in names)]
        cells = [heads]
        for method, found in block.items():
            # A failed row has no number for any statistic; a statistic that does not apply to a method is no failure.
            failed = min(row["failed"] for row in found.values())
            note = f" ({failed} failed)" if failed else ""
            cells.append([method + note, *(short(found[name]) if name in found else "" for name in names)])
        wide = [max(len(line[k]) for line in cells) for k in range(len(heads))]
        where = ", ".join(f"{axis} {value}" for axis, value in zip(study.axes, condition, strict=True))
        seeds = max(row["seeds"] + row["failed"] for found in block.values() for row in found.values())
        lines += ["", f"{where or study.name} ({seeds} seed{'s' if seeds > 1 else ''})"]
        for line in cells:
            first, *rest = line
            lines.append(f"  {first:<{wide[0]}}" + "".join(f"  {c:>{w}}" for c, w in zip(rest, wide[1:], strict=True)))
    return "\n".join(lines[1:])


def write_csv(rows: Sequence[Row], columns: Sequence[str], path: Path) -> None:
    """Rows as CSV; numbers with all their digits, so that reading gives back the same bits."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_summary(path: Path) -> list[Row]:
    """A summary as :func:`write_csv` wrote it, numbers as numbers.

    Raises
    ------
    EvalkitError
        If the file cannot be read or is not a summary.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            rows: list[Row] = [dict(row) for row in csv.DictReader(file)]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise EvalkitError(f"{path}: cannot be read as a table ({getattr(error, 'strerror', error)})") from error
    for number, row in enumerate(rows, start=2):
        lacking = [column for column in SUMMARY_COLUMNS if row.get(column) is None]
        if lacking:
            raise EvalkitError(f"{path}, line {number}: not the summary of a study; it lacks {', '.join(lacking)}")
        try:
            for column in ("value", "low", "high", "standard_error"):
                row[column] = float(row[column])
            for column in ("seeds", "failed"):
                row[column] = int(row[column])
        except ValueError as error:
            raise EvalkitError(f"{path}, line {number}: {column} is '{row[column]}', not a number") from error
    return rows
