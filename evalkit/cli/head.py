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
@click.argument("name", type=click.Choice(["makehuman"]))
@click.option(
    "-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Write it and a picture here, too."
)
@click.option("--wheel", type=click.Path(path_type=Path), help="The package's wheel, if it was downloaded before.")
def get(name: str, output: Path | None, wheel: Path | None) -> None:
    """Get a head of others into the cache: MakeHuman's (CC0), with 52 face units; then --head makehuman works."""
    from evalkit.head import load_head
    from evalkit.head.makehuman import get_makehuman

    path = get_makehuman(wheel)
    click.echo(f"wrote {path}")
    if output is not None:
        _write(load_head(name), output, True)


@head.command("import")
@click.argument("source", type=click.Path(path_type=Path), metavar="MESH")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), metavar="DIR", help="Folder for it.")
@click.option("--names", type=click.Path(path_type=Path), help="JSON of landmarks and regions  [default: beside MESH]")
@click.option("--no-picture", is_flag=True, help="Write the head alone.")
def import_(source: Path, output: Path, names: Path | None, no_picture: bool) -> None:
    """Make a head of a mesh file (OBJ, PLY, glTF) and its JSON of names, or of ICT-FaceKit's folder."""
    from evalkit.head.importing import import_head

    _write(import_head(source, names), output, not no_picture)


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
