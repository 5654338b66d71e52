"""One cell of a study: its data prepared once, every method run on it, the run timed, the result scored."""

from __future__ import annotations

import threading
import time
import traceback
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from evalkit.errors import EvalkitError
from evalkit.study.description import Cell, Study

Rows = list[dict[str, Any]]

_ONE_AT_A_TIME = threading.Lock()
"""Cells that share a process take turns: limits on threads and the silencing of warnings hold for a process."""


def measure(study: Study, cell: Cell) -> tuple[Rows, Rows]:
    """Rows of a cell, one for every method, and what they cost on this machine.

    Linear algebra is limited to one thread: sums then run in the same order for any number of jobs. A method that
    fails is a row with the status ``failed`` and its reason; the others are not touched by it.

    Parameters
    ----------
    study : Study
    cell : Cell

    Returns
    -------
    (list of dict, list of dict)
        Rows for :attr:`Table.rows` and :attr:`Table.machine`.
    """
    from threadpoolctl import threadpool_limits

    condition = dict(cell.condition)
    rows, machine = [], []
    with _ONE_AT_A_TIME, threadpool_limits(1), warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # a method's complaints show in its errors; they would tear the progress bar
        data, failure = None, ""
        try:
            data = study.prepare(seed=cell.seed, **condition)
        except Exception as error:  # whatever a method or generator of somebody else raises is a row
            failure = f"no data: {_reason(error)}"
        for method in study.methods_of(condition):
            keys = {**condition, "method": method, "seed": cell.seed}
            found: dict[str, Any] = {}
            message, seconds = failure, float("nan")
            if not failure:
                try:
                    start = time.perf_counter()
                    result = study.run(data, method)
                    seconds = time.perf_counter() - start
                    found = {name: _plain(value) for name, value in study.score(data, result).items()}
                    message = _mismatch(study, found)
                except Exception as error:
                    message = _reason(error)
            status = "failed" if message else "ok"
            if message:
                found = {}
            rows.append(
                {**keys, "status": status, "message": message, **{name: found.get(name) for name in study.columns}}
            )
            machine.append({**keys, "seconds": seconds, **{name: found.get(name) for name in study.machine}})
    return rows, machine


def _mismatch(study: Study, found: dict[str, Any]) -> str:
    """What is wrong with the columns of a score; empty if nothing is."""
    wrong = set(found) ^ {*study.columns, *study.machine}
    return f"the study's score and its columns differ in {', '.join(sorted(wrong))}" if wrong else ""


def _plain(value: Any) -> Any:
    """Numbers of Python instead of NumPy's, so that text and back gives the same bits."""
    return value.item() if isinstance(value, np.generic) else value


def _reason(error: BaseException) -> str:
    """Why something failed, in one line; with the place in the source where it is not a known error."""
    text = " ".join(str(error).split())
    if isinstance(error, EvalkitError):
        return text
    last = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {text} ({Path(last.filename).name}, line {last.lineno})"
