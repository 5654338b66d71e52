"""``evalkit methods``: what there is to choose from."""

from __future__ import annotations

import json
from importlib import import_module

import click

TABLES = (
    ("pose", "pose estimators (--pose NAME)", "evalkit.pose", "pose_estimators", "summary"),
    ("pivot", "pivot estimators (--pivot NAME)", "evalkit.pivot", "pivot_estimators", "summary"),
    ("kernel", "kernels of the deformation", "evalkit.deform.kernels", "kernels", "summary"),
    ("preset", "synthetic takes (evalkit synth NAME)", "evalkit.synthetic", "PRESETS", "text"),
    ("search", "searches of a motion database", "evalkit.control.search", "searchers", "text"),
    ("study", "studies (evalkit study run NAME)", "evalkit.studies", "studies", "question"),
)
"""Kind, heading, where the table is, and the field of its entries that says what one is."""


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def methods(as_json: bool) -> None:
    """List every estimator, kernel, preset, search and study, and the package it comes from if not evalkit.

    \b
    Example:
        evalkit methods --json
    """
    rows = [
        {
            "kind": kind,
            "name": name,
            "summary": getattr(entry, field),
            "source": getattr(entry, "source", ""),
            "origin": getattr(entry, "origin", ""),
        }
        for kind, _, module, table, field in TABLES
        for name, entry in getattr(import_module(module), table).items()
    ]
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    wide = max(len(row["name"]) for row in rows)
    for kind, heading, *_ in TABLES:
        listed = [row for row in rows if row["kind"] == kind]
        summary = max((len(row["summary"]) for row in listed), default=0)
        click.echo(heading)
        for row in listed:
            origin = f"  [{row['origin']}]" if row["origin"] else ""
            line = f"  {row['name']:<{wide}}  {row['summary']:<{summary}}  {row['source']}"
            click.echo(line.rstrip() + origin)
