"""The rows that a figure is drawn from: measured, or read from files."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from evalkit.errors import EvalkitError
from evalkit.study.description import KEYS, Budget, Study
from evalkit.study.table import Table as StudyTable
from evalkit.study.table import summarised

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Table:
    """What a figure shows.

    Attributes
    ----------
    rows : DataFrame
        As in the CSV beside the figure: of a study, one row per condition, method and seed.
    study : Study or None
        Whose rows they are.
    facts : dict
        Where they come from: what is in the JSON beside the figure.
    """

    rows: pd.DataFrame
    study: Study | None
    facts: dict[str, Any]

    @cached_property
    def _summaries(self) -> dict[str, pd.DataFrame]:
        return {}

    def _summary(self, statistic: str) -> pd.DataFrame:
        """A row per condition and method: value, low and high (95 %), seeds, failed."""
        import pandas as pd

        if self.study is None:
            raise LookupError("only rows of a study have statistics")
        # One at a time: resampling all that a study has takes longer than the drawing.
        if statistic not in self._summaries:
            wanted = next(s for s in self.study.statistics if s.name == statistic)
            rows = self.rows.to_dict("records")
            self._summaries[statistic] = pd.DataFrame(summarised(self.study, rows, [wanted]))
        return self._summaries[statistic]

    def of(self, statistic: str, method: str | None = None, **where: Any) -> pd.DataFrame:
        """The part of the summary about one statistic, of one method, where axes have these values."""
        found = self._summary(statistic)
        if method is not None:
            found = found[found["method"] == method]
        for axis, value in where.items():
            found = found[found[axis] == value]
        return found

    @property
    def methods(self) -> list[str]:
        """Methods with rows, in their order."""
        return list(dict.fromkeys(self.rows["method"]))


def shares(found: pd.DataFrame) -> pd.DataFrame:
    """A part of a summary about the mean of 0 and 1, with Wilson's 95 % intervals.

    Resampling gives intervals without width where all takes agree.

    References
    ----------
    Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22 (1927) 209-212.
    """
    from scipy.stats import binomtest

    found = found.dropna(subset=["value"])
    ends = [
        binomtest(round(share * n), n).proportion_ci(method="wilson")
        for share, n in zip(found["value"], found["seeds"], strict=True)
    ]
    return found.assign(low=[end.low for end in ends], high=[end.high for end in ends])


def study_of(figure: ModuleType) -> Study | None:
    """The study whose rows a figure shows."""
    from evalkit.studies import studies

    name = getattr(figure, "STUDY", None)
    return studies[name] if name else None


def budget_of(figure: ModuleType, budget: str) -> str | Budget:
    """How much of its study a figure takes for a budget of ``small`` or ``full``."""
    if budget not in ("small", "full"):
        raise EvalkitError(f"budget '{budget}' is not known; use small or full")
    given: Budget | None = getattr(figure, budget.upper(), None)
    return given or budget


def measured(
    figure: ModuleType,
    budget: str = "small",
    folder: Path | None = None,
    jobs: int = -1,
    axes: dict[str, tuple[Any, ...]] | None = None,
    tell: Callable[[str], None] | None = None,
) -> Table:
    """Measure what a figure shows.

    Parameters
    ----------
    figure : module
        Of the table :data:`evalkit.figures.figures`.
    budget : {"small", "full"}
    folder : Path, optional
        Where the tables of studies are kept: what is measured there already is not measured again.
    jobs : int
        Processes; -1 is one per core.
    axes : dict, optional
        Other values of the study's axes.
    tell : callable, optional
        Gets lines on what happens.

    Raises
    ------
    EvalkitError
        As :func:`evalkit.study.runner.run`; or if the study needs files that are not given.
    """
    import pandas as pd

    from evalkit.study.provenance import environment
    from evalkit.study.runner import run

    study = study_of(figure)
    cut = budget_of(figure, budget)
    if study is None:
        return Table(pd.DataFrame(figure.measure(budget)), None, {"budget": budget, **environment()})
    if axes:
        part = study.at(cut)
        cut = replace(part.full, axes={**part.axes, **axes})
    for axis, values in study.at(cut).axes.items():
        if not values:
            raise EvalkitError(f"figure {figure.NAME} needs files of yours: --axis {axis}=a.c3d,b.c3d")
    table = run(study, folder, cut, jobs, tell=tell)
    return _from_study(study, table, {"budget": budget, **table.provenance})


def _from_study(study: Study, table: StudyTable, facts: dict[str, Any]) -> Table:
    """Rows of a study with what the machine adds, if a statistic is made of it."""
    import pandas as pd

    rows = pd.DataFrame(table.rows)
    extra = _of_machine(study)
    if extra:
        keys = [*study.axes, "method", "seed"]
        machine = pd.DataFrame(table.machine)[[*keys, *extra]]
        rows = rows.merge(machine, on=keys, how="left", validate="one_to_one")
    return _without_folders(Table(rows, study, facts))


def _without_folders(table: Table) -> Table:
    """Files that are values of axes by their names alone: folders of this machine tell a reader nothing."""
    paths = table.facts.get("data_sha256", {})
    names = {path: Path(path).name for path in paths}
    if len(set(names.values())) < len(names):
        names = {path: "/".join(Path(path).parts[-2:]) for path in paths}
    text = json.dumps(table.facts)
    rows = table.rows.replace(names)
    for path, name in names.items():
        text = text.replace(json.dumps(path)[1:-1], json.dumps(name)[1:-1])
        rows["message"] = [words.replace(path, name) if isinstance(words, str) else words for words in rows["message"]]
    return Table(rows, table.study, json.loads(text))


def _of_machine(study: Study) -> list[str]:
    """Columns that statistics are made of and that depend on the machine."""
    return list(dict.fromkeys(c for s in study.statistics for c in s.columns if c not in study.columns))


def from_tables(figure: ModuleType, folder: Path) -> Table:
    """What a figure shows, from the tables that ``evalkit study run -o FOLDER`` wrote.

    Raises
    ------
    EvalkitError
        If they are not there, or not those of this study.
    """
    study = study_of(figure)
    if study is None:
        raise EvalkitError(f"figure {figure.NAME} is not drawn from a study; it is measured: --run")
    path = folder / f"{study.name}.csv"
    if not path.exists():
        raise EvalkitError(f"{path}: no table there; run: evalkit study run {study.name} -o {folder}")
    rows, machine = (read_rows(p) for p in (path, folder / f"{study.name}-machine.csv"))
    facts = _read_json(folder / f"{study.name}.json")
    both = StudyTable(study, rows.to_dict("records"), machine.to_dict("records"), facts)
    return _checked(figure, _from_study(study, both, facts), path)


def from_csv(figure: ModuleType, folder: Path) -> Table:
    """What a figure shows, from the CSV and JSON beside it.

    Raises
    ------
    EvalkitError
        If a file cannot be read, or lacks a column.
    """
    path = folder / f"{figure.NAME}.csv"
    found = Table(read_rows(path), study_of(figure), _read_json(path.with_suffix(".json")))
    return _checked(figure, found, path)


def _checked(figure: ModuleType, table: Table, path: Path) -> Table:
    study = table.study
    wanted = figure.COLUMNS if study is None else (*study.axes, *KEYS, *study.columns, *_of_machine(study))
    for column in wanted:
        if column not in table.rows.columns:
            raise EvalkitError(
                f"{path}: column '{column}' is missing; measure again: evalkit figures {figure.NAME} --run"
            )
    if not len(table.rows):
        raise EvalkitError(f"{path}: no rows; measure again: evalkit figures {figure.NAME} --run")
    return table


def read_rows(path: Path) -> pd.DataFrame:
    """A table of rows as :func:`evalkit.study.table.write_csv` wrote it, to the last bit.

    Only an empty cell is no value: methods may be called "none".

    Raises
    ------
    EvalkitError
        If it cannot be read.
    """
    import pandas as pd

    try:
        lines = list(csv.reader(io.StringIO(path.read_text(encoding="utf-8")), strict=True))
        if not lines:
            raise ValueError("empty")
        for number, line in enumerate(lines, start=1):
            if len(line) != len(lines[0]):
                raise ValueError(f"line {number} has {len(line)} cells, the first {len(lines[0])}")
    except (OSError, ValueError, csv.Error) as error:
        raise EvalkitError(
            f"{path}: cannot be read as a table ({getattr(error, 'strerror', None) or error})"
        ) from error
    head, *body = lines
    return pd.DataFrame({name: _typed([line[k] for line in body]) for k, name in enumerate(head)}, columns=head)


def _typed(cells: list[str]) -> list[Any]:
    """Cells of a column as whole numbers, as numbers, or as they are."""
    for kind in (int, float):
        try:
            return [kind(cell) if cell else math.nan for cell in cells]
        except ValueError:
            continue
    return [cell or math.nan for cell in cells]


def _read_json(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise EvalkitError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    return found
