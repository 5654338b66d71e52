"""``evalkit database``: a motion database out of captures."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from evalkit.control.database import Database

FILE = click.Path(path_type=Path)


def _shared(command: Callable[..., None]) -> Callable[..., None]:
    """Options of what makes takes out of captures."""
    for option in (
        click.option("--json", "as_json", is_flag=True, help="Print the description as JSON instead of text."),
        click.option("--graph", type=click.IntRange(min=2), metavar="FRAMES", help="Also keep the neighbour graph of "
                     "windows of so many frames, for the search 'graph'; takes minutes."),
        click.option("--scheduler", metavar="ADDRESS", help="Work on a running dask cluster that sees these folders."),
        click.option("--jobs", type=int, default=1, show_default=True, help="Processes; -1 is one per core."),
        click.option("--performer", default="", metavar="NAME", help="Whose takes they are."),
        click.option("--rigid", default="auto", show_default=True, metavar="A,B,C|auto", help="Markers over bone."),
        click.option("--compensated", is_flag=True, help="The captures have no head motion any more."),
        click.argument("captures", nargs=-1, required=True, type=FILE, metavar="CAPTURES..."),
    ):  # fmt: skip
        command = option(command)
    return command


@click.group()
def database() -> None:
    """Build, extend and describe a motion database.

    \b
    Example:
        evalkit database build takes/*.c3d -o db --performer anna
        evalkit database info db
    """


@database.command()
@_shared
@click.option("-o", "--output", required=True, type=FILE, metavar="DB", help="Folder of the new database.")
@click.option("--markers", metavar="A,B,C", help="Markers that are kept  [default: those of the first capture]")
@click.option("--rate", type=float, default=0.0, metavar="HZ", help="Frames a second  [default: as the first capture]")
@click.option(
    "--neutral",
    type=float,
    default=0.0,
    metavar="SECONDS",
    help="At rest for so long at the beginning of every capture  [default: the rest is found]",
)
def build(
    captures: tuple[Path, ...], output: Path, markers: str | None, rate: float, neutral: float, compensated: bool,
    rigid: str, performer: str, jobs: int, scheduler: str | None, graph: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Make a database out of CAPTURES (.c3d, .trc, .csv).

    Head motion is undone first, unless they are --compensated. Frames in which a marker is missing for longer than a
    tenth of a second are left out. The folder appears when all is done, or not at all.

    \b
    Example:
        evalkit database build takes/*.c3d -o db --jobs 2
    """
    from evalkit.control.database import build_database

    labels = [label for label in (markers or "").split(",") if label]
    _show(
        captures, graph, as_json,
        lambda done: build_database(
            captures, output, compensated=compensated, rigid=_labels(rigid), performer=performer, labels=labels,
            rate_hz=rate, neutral_s=neutral, jobs=jobs, scheduler=scheduler, done=done,
        ),
    )  # fmt: skip


@database.command()
@click.argument("folder", type=FILE, metavar="DB")
@_shared
def add(
    folder: Path, captures: tuple[Path, ...], compensated: bool, rigid: str, performer: str, jobs: int,
    scheduler: str | None, graph: int | None, as_json: bool,
) -> None:  # fmt: skip
    """Add CAPTURES to the database DB; the takes that it has are not worked on again.

    \b
    Example:
        evalkit database add db another.c3d
    """
    from evalkit.control.database import add_takes

    _show(
        captures, graph, as_json,
        lambda done: add_takes(
            folder, captures, compensated=compensated, rigid=_labels(rigid), performer=performer, jobs=jobs,
            scheduler=scheduler, done=done,
        ),
    )  # fmt: skip


@database.command()
@click.argument("folder", type=FILE, metavar="DB")
@click.option("--json", "as_json", is_flag=True, help="Print as JSON.")
def info(folder: Path, as_json: bool) -> None:
    """Say what the database DB holds.

    \b
    Example:
        evalkit database info db --json
    """
    from evalkit.control.database import open_database

    _echo(open_database(folder), as_json)


def _labels(rigid: str) -> str | list[str]:
    return rigid if rigid == "auto" else rigid.split(",")


def _show(
    captures: tuple[Path, ...], graph: int | None, as_json: bool, work: Callable[[Callable[[str], object]], Database]
) -> None:
    from evalkit.cli.transfer import progress

    with progress("takes", len(captures)) as advance:
        found = work(lambda name: advance(1))
    if graph is not None:
        from evalkit.control.graph import stored_graph

        stored_graph(found, graph)
    _echo(found, as_json)


def _echo(found: Database, as_json: bool) -> None:
    facts = found.facts()
    click.echo(json.dumps(facts, indent=2) if as_json else "\n".join(_described(facts)))


def _described(facts: dict[str, Any]) -> list[str]:
    """The description for people."""
    takes = facts["takes"]
    lines = [
        f"{facts['folder']}: {len(takes)} takes, {facts['rows']} frames at {facts['rate_hz']:g} Hz "
        f"({facts['seconds']:.0f} s) in {facts['segments']} segments, {facts['bytes'] / 1e6:.1f} MB",
        f"digest {facts['digest']}",
        f"{len(facts['markers'])} markers: {', '.join(facts['markers'])}",
        f"control parameters that they do not give: {', '.join(facts['unknown_parameters']) or 'none'}",
    ]
    for take in takes:
        start, stop = take["rows"]
        who = f" ({take['performer']})" if take["performer"] else ""
        lines.append(
            f"  {take['name']}{who}: {stop - start} of {take['frames']} frames at {take['own_rate_hz']:g} Hz, "
            f"{take['segments']} segments, {100.0 * take['bridged']:.1f} % of the samples bridged"
        )
        lines += [f"    warning: {text}" for text in take["warnings"]]
    return lines
