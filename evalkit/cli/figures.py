"""``evalkit figures``: every figure with the table that it was drawn from."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click

from evalkit.errors import EvalkitError


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("paper_figures"),
    metavar="DIR",
    show_default=True,
    help="Folder of the figures, each with its CSV and JSON.",
)
@click.option("--run", is_flag=True, help="Measure anew what the figures show.")
@click.option(
    "--tables",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Draw the tables that 'evalkit study run -o DIR' wrote.",
)
@click.option(
    "--budget",
    type=click.Choice(["small", "full"]),
    default="small",
    show_default=True,
    help="How much is measured: small takes minutes for all figures.",
)
@click.option(
    "--results",
    type=click.Path(path_type=Path),
    default=Path("results"),
    metavar="DIR",
    show_default=True,
    help="Where measured tables are kept, to go on from after an interruption.",
)
@click.option("--axis", "axes", multiple=True, metavar="NAME=V1,V2", help="Other values of a study's axis; repeatable.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Processes; -1 is one per core.")
@click.option("--list", "only_list", is_flag=True, help="List the figures and what they show.")
def figures(
    names: tuple[str, ...], output: Path, run: bool, tables: Path | None, budget: str, results: Path,
    axes: Sequence[str], jobs: int, only_list: bool,
) -> None:  # fmt: skip
    """Draw figures: plots as SVG and PDF, scenes as PNG, each with the CSV and JSON that it shows.

    A figure whose CSV is in the folder is drawn from it, in seconds; what is not there is measured.

    \b
    Examples:
        evalkit figures
        evalkit figures pivot-noise --run --budget full
        evalkit figures --run -o my_figures
        evalkit figures real-takes --run --axis take=a.c3d,b.c3d
    """  # fmt: skip
    from evalkit.figures import figure_named
    from evalkit.figures import figures as known
    from evalkit.figures.files import caption
    from evalkit.results import check_output
    from evalkit.study.command import chosen_axes

    if only_list:
        for name, figure in known.items():
            click.echo(f"{name:<{max(map(len, known))}}  {caption(figure).partition('. ')[0].rstrip('.')}")
        return
    if run and tables is not None:
        raise click.UsageError("--run measures, --tables draws what was measured: choose one")
    chosen = [figure_named(name).NAME for name in names] or list(known)
    given = chosen_axes(axes)
    check_output(output)
    failed: dict[str, str] = {}
    for name in chosen:
        start = time.perf_counter()
        try:
            files = _one(known[name], output, run or bool(given), tables, budget, results, given, jobs)
        except KeyboardInterrupt:
            raise EvalkitError(f"{name}: stopped; cells that are done are kept, the same command goes on") from None
        except EvalkitError as error:
            failed[name] = str(error)
            click.echo(f"{name}: not drawn: {error}", err=True)
            continue
        click.echo(f"{name}: {', '.join(str(path) for path in files)} ({time.perf_counter() - start:.1f} s)")
    if failed and (names or len(failed) == len(chosen)):
        raise EvalkitError(f"{len(failed)} of {len(chosen)} figures were not drawn: {', '.join(failed)}")


def _one(
    figure: Any, output: Path, run: bool, tables: Path | None, budget: str, results: Path, axes: dict[str, Any],
    jobs: int,
) -> list[Path]:  # fmt: skip
    """Measure or read one figure's table, and write its files."""
    from evalkit.figures.files import save
    from evalkit.figures.table import from_csv, from_tables, measured

    if tables is not None:
        return save(figure, from_tables(figure, tables), output)
    if not run and (output / f"{figure.NAME}.csv").exists():
        return save(figure, from_csv(figure, output), output, with_table=False)
    say = lambda text: click.echo(text, err=True)  # noqa: E731
    return save(figure, measured(figure, budget, results, jobs, axes, say), output)
