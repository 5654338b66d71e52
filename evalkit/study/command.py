"""Running studies from a command line: ``evalkit study run NAME`` and ``python -m evalkit.studies.NAME``."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from evalkit.errors import EvalkitError

if TYPE_CHECKING:  # at run time only where needed: every command pays for what is imported here
    from evalkit.study.description import Budget, Scalar, Study
    from evalkit.study.table import Table

NUMERICS = ("numpy", "scipy", "nlopt")
"""Packages that every table's numbers hang on; their versions are printed below it."""

OPTIONS = (
    click.option("-o", "--output", type=click.Path(path_type=Path), default=Path("results"), metavar="DIR",
                 show_default=True, help="Folder for tables, provenance and the journal to go on from."),
    click.option("--budget", type=click.Choice(["small", "full"]), default="small", show_default=True,
                 help="small: minutes for all studies; full: what the findings rest on."),
    click.option("--seeds", type=click.IntRange(min=1), help="Takes per condition instead of the budget's."),
    click.option("--axis", "axes", multiple=True, metavar="NAME=V1,V2", help="Other values of an axis; repeatable."),
    click.option("--methods", metavar="A,B", help="Only these methods."),
    click.option("--jobs", type=int, default=-1, show_default=True, help="Processes; -1 is one per core."),
    click.option("--scheduler", metavar="ADDRESS", help="Run the cells on this dask cluster (extra: cluster)."),
    click.option("--fresh", is_flag=True, help="Measure again what is already done."),
    click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON."),
)  # fmt: skip


def options(function: Any) -> Any:
    """Give a command the options that every study has."""
    for option in reversed(OPTIONS):
        function = option(function)
    return function


def run_studies(
    studies: Sequence[Study], output: Path, budget: str, seeds: int | None, axes: Sequence[str], methods: str | None,
    jobs: int, scheduler: str | None, fresh: bool, as_json: bool,
) -> None:  # fmt: skip
    """Run studies one after the other and print their tables.

    Raises
    ------
    EvalkitError
        As :func:`evalkit.study.runner.run`; if an axis or a method is not one of the study's; after all is written, if
        every row of a study failed.
    """
    from evalkit.study.runner import run

    found: dict[str, Any] = {}
    empty: list[str] = []
    for study in studies:
        cut = _cut(study, budget, seeds, axes, methods)
        try:
            table = run(study, output, cut, jobs, scheduler, fresh, tell=lambda text: click.echo(text, err=True))
        except KeyboardInterrupt:
            raise EvalkitError(f"{study.name}: stopped; what is done is kept, the same command goes on") from None
        found[study.name] = {"summary": table.summary, "machine": table.machine_summary, "files": str(output)}
        if not as_json:
            click.echo(report(table))
            click.echo(f"tables: {output / study.name}.csv, -summary.csv, -machine.csv, .json\n")
        if len(table.failed) == len(table.rows):
            empty.append(f"{study.name} ({table.failed[0]['message']})")
    if as_json:
        click.echo(json.dumps(_finite(found), indent=2))
    if empty:
        raise EvalkitError(f"no method gave an answer in {', '.join(empty)}")


def _cut(study: Study, budget: str, seeds: int | None, axes: Sequence[str], methods: str | None) -> Budget:
    """The budget with what the command line changes in it."""
    base = study.small if budget == "small" else study.full
    changed = {**base.axes, **chosen_axes(axes)}
    kept = tuple(part.strip() for part in methods.split(",") if part.strip()) if methods else base.methods
    return replace(base, axes=changed, methods=kept, seeds=seeds or base.seeds)


def chosen_axes(settings: Sequence[str]) -> dict[str, tuple[Scalar, ...]]:
    """Values of axes from texts of the form ``NAME=V1,V2``.

    Raises
    ------
    EvalkitError
        If a text is not of that form.
    """
    chosen: dict[str, tuple[Scalar, ...]] = {}
    for setting in settings:
        name, equals, text = (part.strip() for part in setting.partition("="))
        values = tuple(_scalar(part.strip()) for part in text.split(",") if part.strip())
        if not equals or not values:
            raise EvalkitError(f"axis {setting!r} is not of the form NAME=V1,V2")
        chosen[name] = values
    return chosen


def _scalar(text: str) -> Scalar:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def report(table: Table) -> str:
    """Question, table, failures, expectations and versions of a run as text."""
    from evalkit.study.table import printed, verdicts

    study, parts = table.study, [f"{table.study.name}: {table.study.question}", ""]
    parts.append(printed(study, table.summary + table.machine_summary))
    failed: dict[tuple[str, str], int] = {}
    for row in table.failed:
        failed[row["method"], row["message"]] = failed.get((row["method"], row["message"]), 0) + 1
    if failed:
        parts += ["", "failed rows"]
        parts += [f"  {count} x {method}: {message}" for (method, message), count in failed.items()]
    found = verdicts(study, table.summary + table.machine_summary)
    if found:
        parts += ["", "expected"]
        parts += [f"  {'met    ' if met else 'NOT MET'} {words}" for words, met in found]
    facts = table.provenance
    versions = [f"{name} {facts['packages'][name]}" for name in NUMERICS if name in facts["packages"]]
    others = [f"{method} from {origin}" for method, origin in facts["origins"].items()]
    own = f"evalkit {facts['evalkit']['version']} (source {facts['evalkit']['source_sha256'][:10]})"
    parts += ["", f"{facts['wall_s']:.1f} s; {', '.join([own, *versions, *others])}"]
    return "\n".join(parts)


def _finite(value: Any) -> Any:
    """JSON has no NaN: null instead."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def script(study: Study) -> None:
    """Run one study as ``python -m evalkit.studies.NAME``; a user's mistake becomes one line and exit code 1."""

    @click.command(
        help=f"{study.question}\n\n\b\nExample:\n    python -m evalkit.studies.{study.name.replace('-', '_')}"
    )
    @options
    def command(**given: Any) -> None:
        run_studies([study], **given)

    try:
        command(prog_name=f"python -m evalkit.studies.{study.name.replace('-', '_')}")
    except EvalkitError as error:
        click.echo(f"evalkit: {error}", err=True)
        raise SystemExit(1) from None
