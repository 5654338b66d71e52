"""``evalkit study``: rerun what the claims rest on."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import click

from evalkit.errors import EvalkitError
from evalkit.study.command import options, run_studies


@click.group()
def study() -> None:
    """List, show and run the studies: methods compared on takes whose truth is known.

    \b
    Example:
        evalkit study run pivot-noise --budget small -o results
    """


@study.command("list")
def list_() -> None:
    """List the studies with their questions."""
    from evalkit.studies import studies

    wide = max(map(len, studies))
    for name, entry in studies.items():
        click.echo(f"{name:<{wide}}  {entry.question}")


@study.command()
@click.argument("name")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Also print the table found here.")
def show(name: str, output: Path | None) -> None:
    """Show what a study does, what it found, and how to rerun it.

    \b
    Example:
        evalkit study show pivot-noise -o results
    """
    from evalkit.study.table import printed, read_summary

    (entry,) = _named((name,))
    click.echo(f"{entry.name}: {entry.question}\n")
    click.echo(textwrap.fill(entry.finding, 100))
    click.echo("\naxes")
    for axis, values in entry.axes.items():
        click.echo(f"  {axis}: {', '.join(map(str, values))}")
    click.echo(f"methods\n  {', '.join(entry.methods)}\ncolumns")
    for column, text in {**entry.columns, **entry.machine}.items():
        click.echo(f"  {column}: {text}")
    click.echo("statistics over the seeds, with bootstrap 95 % intervals")
    for statistic in entry.statistics:
        click.echo(f"  {statistic.name}{', ' + statistic.unit if statistic.unit else ''}: {statistic.text}")
    click.echo(f"seeds\n  {entry.full.seeds}; small budget {entry.small.seeds}")
    click.echo(f"command\n  evalkit study run {entry.name} --budget full")
    if output is not None:
        path = output / f"{entry.name}-summary.csv"
        if not path.exists():
            raise EvalkitError(f"{path}: no table there; run: evalkit study run {entry.name} -o {output}")
        click.echo("\n" + printed(entry, read_summary(path)))


@study.command()
@click.argument("names", nargs=-1, metavar="NAME...")
@click.option("--all", "everything", is_flag=True, help="All studies that need no file of yours.")
@options
def run(names: tuple[str, ...], everything: bool, **given: Any) -> None:
    """Run studies and print their tables; an interrupted run goes on where it stopped.

    \b
    Examples:
        evalkit study run pose-noise pivot-noise -o results
        evalkit study run real-takes --axis take=a.c3d,b.c3d
        evalkit study run pivot-sway --budget full --scheduler tcp://host:8786
    """
    from evalkit.studies import studies

    if bool(names) == everything:
        raise click.UsageError("give the names of studies, or --all (evalkit study list shows them)")
    chosen = [entry for entry in studies.values() if all(entry.axes.values())] if everything else _named(names)
    run_studies(chosen, **given)


def _named(names: tuple[str, ...]) -> list[Any]:
    """Studies of these names."""
    import difflib

    from evalkit.studies import studies

    for name in names:
        if name not in studies:
            near = difflib.get_close_matches(name, studies, n=2, cutoff=0.4)
            hint = f"did you mean {' or '.join(near)}?" if near else f"known are {', '.join(studies)}"
            raise EvalkitError(f"study '{name}' is not known; {hint}")
    return [studies[name] for name in names]
