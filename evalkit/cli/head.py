"""``evalkit head``: make, get, import and check heads."""

from __future__ import annotations

from pathlib import Path

import click

from evalkit.errors import EvalkitError


@click.group()
def head() -> None:
    """The 2.5D head: the built-in one, heads of others, and what is wrong with them."""


@head.command()
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Folder for it.")
@click.option("--vertices", default=11_000, show_default=True, help="About so many, 1,000 to 100,000.")
@click.option("--no-picture", is_flag=True, help="Write the head alone.")
def new(output: Path, vertices: int, no_picture: bool) -> None:
    """Make the built-in head: head.npz and its pictures head.png.

    \b
    Example:
        evalkit head new -o myhead
    """
    from evalkit.head import load_head

    made = load_head("template", vertices=vertices)
    _write(made, output, not no_picture)


@head.command()
@click.argument("source", metavar="HEAD")
def check(source: str) -> None:
    """Say in one line each what is wrong with HEAD, a head file or "template"; exit 1 if anything is."""
    from evalkit.head import load_head
    from evalkit.head.check import check_head

    problems = check_head(load_head(source))
    for line in problems:
        click.echo(f"{source}: {line}")
    if problems:
        raise SystemExit(1)
    click.echo(f"{source}: nothing wrong")


def _write(made: object, output: Path, picture: bool) -> None:
    from evalkit.head import Head

    assert isinstance(made, Head)
    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise EvalkitError(f"{output}: cannot make the folder ({error.strerror or error})") from error
    made.save(output / "head.npz")
    click.echo(f"wrote {output / 'head.npz'} ({len(made.vertices):,} vertices, {len(made.triangles):,} triangles)")
    if picture:
        from evalkit.render.head_views import head_sheet_png

        head_sheet_png(made, output / "head.png")
        click.echo(f"wrote {output / 'head.png'}")
