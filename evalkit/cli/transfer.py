"""``evalkit transfer``: rough expressions become a character's own, over mesh files."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

FILE = click.Path(path_type=Path)


@click.group()
def transfer() -> None:
    """A character's own expressions out of rough ones; files are OBJ, PLY or glTF, the order of vertices is kept."""


@transfer.command()
@click.argument("rough", nargs=-1, required=True, type=FILE, metavar="ROUGH...")
@click.option("--rest", type=FILE, metavar="MESH", help="The character at rest  [default: that of a glTF ROUGH]")
@click.option("--fine", multiple=True, type=FILE, metavar="MESH|DIR", help="Sculpted examples, named like ROUGH ones.")
@click.option(
    "--example", "pairs", nargs=2, multiple=True, type=FILE, metavar="ROUGH FINE", help="A pair of different names."
)
@click.option("-o", "--output", required=True, type=FILE, metavar="DIR", help="Folder for the results.")
@click.option(
    "--method",
    default="character transfer",
    show_default=True,
    metavar="NAME",
    help="Or a baseline; an unknown name is told them all.",
)
@click.option("--regions", type=FILE, metavar="JSON", help="Regions, as an edited regions.json.")
@click.option("--coefficients", type=FILE, metavar="CSV", help="Coefficients, as rows of an edited coefficients.csv.")
@click.option(
    "--reference", multiple=True, type=FILE, metavar="MESH|DIR", help="What a sculptor made of ROUGH: errors."
)
@click.option(
    "--names", type=FILE, metavar="JSON", help="Landmarks of the rest mesh: errors over the eye distance, too."
)
@click.option("--up", type=click.Choice(["y", "z"]), default="y", show_default=True, help="Axis, for the pictures.")
@click.option("--no-pictures", is_flag=True, help="Write no sheet-1.png, ...")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON instead of text.")
def apply(
    rough: tuple[Path, ...], rest: Path | None, fine: tuple[Path, ...], pairs: tuple[tuple[Path, Path], ...],
    output: Path, method: str, regions: Path | None, coefficients: Path | None, reference: tuple[Path, ...],
    names: Path | None, up: str, no_pictures: bool, as_json: bool,
) -> None:  # fmt: skip
    """Make fine shapes of the rough ones that have none, from those that have.

    ROUGH and --fine are mesh files, folders of such, or one glTF file with a morph target for each shape; a rough and
    a fine shape of one name are an example. Rough shapes must be without head motion. Written into DIR: each result
    as its rough file with other positions, summary.json, regions.json and coefficients.csv (edit them, give them
    back), and pictures, sheet-1.png and so on, with error maps where there are references.

    \b
    Examples:
        evalkit transfer apply rough --fine fine --rest rest.obj -o out
        evalkit transfer apply rough.glb --fine fine.glb -o out
        evalkit transfer apply rough/frown.obj --rest rest.obj --example rough/smile.obj grin.obj -o out
        evalkit transfer apply rough --fine fine --rest rest.obj --regions mine.json --reference sculpts -o out
    """
    from evalkit.cli.compensate import working
    from evalkit.report import transfer as report
    from evalkit.results import check_output, staged
    from evalkit.transfer.files import read_material
    from evalkit.transfer.run import transferred

    if not fine and not pairs:
        raise click.UsageError("give sculpted examples: --fine DIR, or --example ROUGH FINE")
    check_output(output)
    with working("reading the meshes"):
        material = read_material(rough, fine, rest, pairs)
        references = report.read_references(reference, material)
        eyes = report.eye_distance(names, material.rest) if names is not None else None
    written = [*report.output_names(material), *report.FILES]
    every = (*material.rough, *material.fine, *material.new, *(shape for shape in references if shape))
    given = [material.rest.path, *(shape.mesh.path for shape in every), *filter(None, (regions, coefficients, names))]
    report.protect_inputs(output, written, given)
    with working("transferring"):
        outcome = transferred(material, method, regions, coefficients)
        content = report.summary(material, outcome, references, eyes)
    pictures = not no_pictures and drawable(content["warnings"])
    with staged(output) as stage:
        report.write_transferred(material, outcome, content, stage)
        if pictures:
            titles = [shape.name for shape in material.new]
            columns = report.transfer_columns(material, outcome, references)
            with progress("drawing", len(titles)) as drawn:
                report.write_sheets(titles, columns, stage, up, drawn)
        names_written = sorted(path.name for path in stage.iterdir())
    click.echo(json.dumps(content, indent=2) if as_json else "\n".join(described(content, output, names_written)))


def described(content: dict[str, Any], output: Path, written: Sequence[str]) -> list[str]:
    """The summary for people."""
    mesh, method, shapes = content["mesh"], content["method"], content["shapes"]
    loose = f", {mesh['loose_parts']} of {mesh['parts']} parts without a pin" if mesh["loose_parts"] else ""
    welded = f" ({mesh['vertices_welded']} on another at seams)" if mesh["vertices_welded"] else ""
    regions = f", {len(method['regions'])} regions" if "regions" in method else ""
    lines = [
        f"{method['name']}: {len(shapes)} shapes from {len(content['examples'])} examples{regions}",
        f"mesh: {mesh['vertices']} vertices{welded}, {mesh['faces']} faces{loose}",
    ]
    for shape in shapes:
        if shape["rms"] is not None:
            share = shape["rms_over_eye_distance"]
            eyes = "" if share is None else f", {share:.4f} of the eye distance"
            lines.append(
                f"{shape['name']}: {shape['rms']:.4g} rms from the reference, {shape['rms_of_rough']:.4g} before{eyes}"
            )
    turned, before = (
        sum(shape[key] for shape in shapes) for key in ("flipped_triangles", "flipped_triangles_of_rough")
    )
    lines.append(f"{turned} triangles turned over in the results, {before} in the rough shapes")
    if content["coefficients_overridden"]:
        lines.append(f"{content['coefficients_overridden']} coefficients taken from the file")
    lines += [f"warning: {text}" for text in content["warnings"]]
    return [*lines, wrote(output, written)]


def wrote(output: Path, written: Sequence[str]) -> str:
    """What is in the folder now, in a line."""
    shown = f"{', '.join(written[:3])}, ... ({len(written)} files)" if len(written) > 5 else ", ".join(written)
    return f"wrote into {output}: {shown}"


def drawable(warnings: list[str]) -> bool:
    """Whether pictures can be drawn here; if not, a warning says why: the meshes are worth having without."""
    from evalkit.errors import EvalkitError
    from evalkit.render.offscreen import require_offscreen

    try:
        require_offscreen()
    except EvalkitError as error:
        warnings.append(str(error))
        return False
    return True


@contextmanager
def progress(text: str, total: int) -> Iterator[Callable[[int], object]]:
    """A bar with the time left on a terminal, moved on by a call with how much is done; silent elsewhere."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(text, total=total)
        yield lambda done: bar.advance(task, done)
