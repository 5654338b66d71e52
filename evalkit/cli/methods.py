"""``evalkit methods``: what there is to choose from."""

from __future__ import annotations

import json

import click


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def methods(as_json: bool) -> None:
    """List every estimator with a line each.

    \b
    Example:
        evalkit methods --json
    """
    from evalkit.pivot import pivot_estimators
    from evalkit.pose import pose_estimators

    rows = [
        {"kind": kind, "name": name, "summary": entry.summary, "source": entry.source}
        for kind, table in (("pose", pose_estimators), ("pivot", pivot_estimators))
        for name, entry in table.items()
    ]
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    wide = {key: max(len(row[key]) for row in rows) for key in ("name", "summary")}
    for kind in ("pose", "pivot"):
        click.echo(f"{kind} estimators (--{kind} NAME)")
        for row in rows:
            if row["kind"] == kind:
                click.echo(f"  {row['name']:<{wide['name']}}  {row['summary']:<{wide['summary']}}  {row['source']}")
