"""``evalkit methods``: what there is to choose from."""

from __future__ import annotations

import json
from typing import Annotated

import typer


def methods(
    as_json: Annotated[bool, typer.Option("--json", help="Print as JSON.")] = False,
) -> None:
    """List every estimator with a line each.

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
        typer.echo(json.dumps(rows, indent=2))
        return
    wide = {key: max(len(row[key]) for row in rows) for key in ("name", "summary")}
    for kind in ("pose", "pivot"):
        typer.echo(f"{kind} estimators (--{kind} NAME)")
        for row in rows:
            if row["kind"] == kind:
                typer.echo(f"  {row['name']:<{wide['name']}}  {row['summary']:<{wide['summary']}}  {row['source']}")
