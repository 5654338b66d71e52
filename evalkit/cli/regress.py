"""``evalkit regress``: is every method still as accurate as it was?"""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click


@click.command()
@click.option(
    "--baselines",
    type=click.Path(path_type=Path),
    default=Path("tests/baselines"),
    metavar="DIR",
    show_default=True,
    help="Folder of the baselines.",
)
@click.option("--update", is_flag=True, help="Make the new figures the baseline, and print old against new.")
@click.option("--jobs", type=int, default=-1, show_default=True, help="Processes; -1 is one per core.")
@click.option("--all", "every", is_flag=True, help="Print the figures that stayed the same, too.")
@click.option("--json", "as_json", is_flag=True, help="Print every figure as JSON.")
def regress(baselines: Path, update: bool, jobs: int, every: bool, as_json: bool) -> None:
    """Measure a fixed set of accuracy figures and compare them with the baselines.

    A figure that got worse by more than the spread over its seeds allows makes the exit code 1; one that got better
    asks for a new baseline.

    \b
    Examples:
        evalkit regress
        evalkit regress --update
    """  # fmt: skip
    from evalkit.errors import EvalkitError
    from evalkit.studies.regression import study
    from evalkit.study.baselines import compare, read_baseline, report, write_baseline
    from evalkit.study.runner import run

    path = baselines / f"{study.name}.csv"
    old = [] if update and not path.exists() else read_baseline(path)
    table = run(study, budget="full", jobs=jobs)
    changes = compare(study, old, table.rows)
    click.echo(json.dumps([asdict(c) for c in changes], indent=2) if as_json else report(changes, every or update))
    if update:
        write_baseline(table, baselines)
        click.echo(f"wrote {path}", err=True)
        return
    if any(change.verdict == "better" for change in changes):
        click.echo("some figures got better: run 'evalkit regress --update' and commit the new baseline", err=True)
    bad = [change for change in changes if change.verdict in ("worse", "gone")]
    if bad:
        raise EvalkitError(
            f"{len(bad)} of {len(changes)} figures are worse than {path}; "
            "mend the method, or, if that is meant, run with --update"
        )
