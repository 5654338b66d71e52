"""Running the cells of a study: on this machine or on a cluster, going on where an earlier run stopped."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from evalkit.errors import EvalkitError
from evalkit.results import check_output, staged
from evalkit.study.cell import measure
from evalkit.study.description import KEYS, Budget, Cell, Study
from evalkit.study.journal import Done, Journal
from evalkit.study.provenance import fingerprint, provenance, source_digest
from evalkit.study.table import SUMMARY_COLUMNS, Table, write_csv

LOSSES = 2
"""Times that worker processes may die with nothing finished in between before cells are tried one by one."""

ANSWER_S = 10.0
"""How long a scheduler may take to answer, s."""


def run(
    study: Study,
    folder: Path | None = None,
    budget: str | Budget = "full",
    jobs: int = -1,
    scheduler: str | None = None,
    fresh: bool = False,
    tell: Callable[[str], None] | None = None,
) -> Table:
    """Measure every cell of a study that is not done yet, and give the whole table.

    The numbers do not depend on the jobs, the scheduler, the order or on interruptions: everything random follows
    from the cell's own names.

    Parameters
    ----------
    study : Study
    folder : Path, optional
        Where the journal is kept and the files are written: ``NAME.csv`` (rows), ``NAME-summary.csv``,
        ``NAME-machine.csv`` (seconds and the like), ``NAME.json`` (provenance), ``NAME.journal.jsonl``. Without it
        nothing is written and nothing can be resumed.
    budget : "small", "full" or Budget
    jobs : int
        Processes on this machine; -1 is one per core. Studies of time and memory take one.
    scheduler : str, optional
        Address of a running dask scheduler, such as ``tcp://host:8786``, to run on instead; its workers must have
        the same evalkit. Needs the extra ``cluster``.
    fresh : bool
        Measure again what is already done.
    tell : callable, optional
        Gets lines on what happens that a user should know.

    Returns
    -------
    Table

    Raises
    ------
    EvalkitError
        If the budget is not known, the folder cannot be written, the scheduler does not answer or runs another
        evalkit.
    """
    cut = study.at(budget)
    cells = cut.cells()
    say = tell or (lambda text: None)
    if jobs == 0:
        raise EvalkitError("jobs = 0; use a number of processes, or -1 for one per core")
    journal = None
    if folder is not None:
        check_output(folder)
        folder.mkdir(parents=True, exist_ok=True)
        journal = Journal(folder / f"{cut.name}.journal.jsonl", fingerprint(cut), fresh)
        if journal.put_aside and not fresh:
            say(f"{cut.name}: code, packages or data changed since the last run; all cells are measured anew")
    done: dict[str, Done] = journal.done if journal else {}
    before = {cell.key for cell in cells if _complete(cut, cell, done)}
    left = [cell for cell in cells if cell.key not in before]
    if before:
        say(f"{cut.name}: {len(before)} of {len(cells)} cells were done before")
    start = time.perf_counter()
    try:
        work = _on_cluster(cut, left, scheduler) if scheduler else _here(cut, left, 1 if cut.serial else jobs, say)
        for cell, result in _with_progress(work, cut.name, len(cells), len(before)):
            if journal:
                journal.add(cell.key, result)
            else:
                done[cell.key] = result
    finally:
        if journal:
            journal.close()
    facts = provenance(cut) | {
        "wall_s": time.perf_counter() - start,
        "cells": len(cells),
        "cells_done_before": len(before),
        "jobs": "cluster" if scheduler else (1 if cut.serial else jobs),
    }
    picked = [_picked(cut, cell, done[cell.key]) for cell in cells]
    rows = [row for pair in picked for row in pair[0]]
    machine = [row for pair in picked for row in pair[1]]
    table = Table(cut, rows, machine, facts | {"rows": len(rows), "failed": sum(r["status"] != "ok" for r in rows)})
    if folder is not None:
        write(table, folder)
    return table


def _complete(study: Study, cell: Cell, done: dict[str, Done]) -> bool:
    """Whether a finished cell holds every method that is asked for."""
    if cell.key not in done:
        return False
    return {row["method"] for row in done[cell.key][0]} >= set(study.methods_of(dict(cell.condition)))


def _picked(study: Study, cell: Cell, done: Done) -> Done:
    """The rows of the methods that are asked for, in their order."""
    order = {method: k for k, method in enumerate(study.methods_of(dict(cell.condition)))}
    rows, machine = ([r for r in part if r["method"] in order] for part in done)
    return sorted(rows, key=lambda r: order[r["method"]]), sorted(machine, key=lambda r: order[r["method"]])


def write(table: Table, folder: Path) -> None:
    """The files of a table, all or none."""
    study, axes = table.study, list(table.study.axes)
    with staged(folder) as stage:
        write_csv(table.rows, [*axes, *KEYS, *study.columns], stage / f"{study.name}.csv")
        machine = [*axes, "method", "seed", "seconds", *study.machine]
        write_csv(table.machine, machine, stage / f"{study.name}-machine.csv")
        write_csv(table.summary, [*axes, *SUMMARY_COLUMNS], stage / f"{study.name}-summary.csv")
        if table.machine_summary:
            path = stage / f"{study.name}-machine-summary.csv"
            write_csv(table.machine_summary, [*axes, *SUMMARY_COLUMNS], path)
        text = json.dumps(table.provenance, indent=2) + "\n"
        (stage / f"{study.name}.json").write_text(text, encoding="utf-8")


def _here(study: Study, cells: Sequence[Cell], jobs: int, say: Callable[[str], None]) -> Iterator[tuple[Cell, Done]]:
    """Cells as they finish, in processes of this machine; one that dies costs its cells' time, or is a failed row."""
    from joblib import Parallel, delayed
    from joblib.externals.loky import get_reusable_executor
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    if jobs == 1:
        yield from ((cell, measure(study, cell)) for cell in cells)
        return
    left = {cell.key: cell for cell in cells}
    losses = 0
    while left and losses < LOSSES:
        work = Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch="3*n_jobs")
        try:
            for cell, result in work(delayed(_measured)(study, cell) for cell in list(left.values())):
                del left[cell.key]
                losses = 0
                yield cell, result
        except TerminatedWorkerError:
            losses += 1
            say(f"{study.name}: a worker process died; its cells are measured again")
    for cell in left.values():
        try:
            yield get_reusable_executor(max_workers=1).submit(_measured, study, cell).result()
        except TerminatedWorkerError:
            yield cell, _lost(study, cell)


def _measured(study: Study, cell: Cell) -> tuple[Cell, Done]:
    return cell, measure(study, cell)


def _on_cluster(study: Study, cells: Sequence[Cell], address: str) -> Iterator[tuple[Cell, Done]]:
    """Cells as they finish, on the workers of a dask cluster."""
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError as error:
        raise EvalkitError("running on a cluster needs dask: pip install 'evalkit[cluster]'") from error
    try:
        client = Client(address, timeout=ANSWER_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        raise EvalkitError(f"{address}: no dask scheduler answers there; start one with 'dask scheduler'") from error
    try:
        if not client.scheduler_info()["workers"]:
            raise EvalkitError(f"{address}: the scheduler has no workers; start one with 'dask worker {address}'")
        mine = source_digest()
        for worker, other in client.run(source_digest).items():
            if other != mine:
                raise EvalkitError(f"{address}: the worker {worker} has another evalkit than this machine")
        futures = {client.submit(_measured, study, cell, key=cell.key, retries=0): cell for cell in cells}
        for future in as_completed(futures, loop=client.loop):
            cell = futures[future]
            problem = future.exception()
            if problem is None:
                yield future.result()
            elif isinstance(problem, KilledWorker):
                yield cell, _lost(study, cell)
            else:
                raise EvalkitError(f"{address}: cell {cell.key} came back as {type(problem).__name__}: {problem}")
            future.release()
    finally:
        client.close()


def _lost(study: Study, cell: Cell) -> Done:
    """Rows of a cell under which workers keep dying."""
    condition = dict(cell.condition)
    text = "the worker died every time that this cell was tried"
    rows: list[dict[str, Any]] = []
    machine: list[dict[str, Any]] = []
    for method in study.methods_of(condition):
        keys = {**condition, "method": method, "seed": cell.seed}
        rows.append({**keys, "status": "failed", "message": text, **dict.fromkeys(study.columns)})
        machine.append({**keys, "seconds": None, **dict.fromkeys(study.machine)})
    return rows, machine


def _with_progress(work: Iterator[tuple[Cell, Done]], name: str, total: int, done: int) -> Iterator[tuple[Cell, Done]]:
    """The same with a bar and the time left on a terminal; silent elsewhere."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("cells, passed"),
        TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(name, total=total, completed=done)
        for item in work:
            yield item
            bar.advance(task)
