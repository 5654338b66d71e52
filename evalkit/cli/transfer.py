"""``evalkit transfer``: rough expressions become a character's own, over mesh files."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from evalkit.render.error_maps import Column

FILE = click.Path(path_type=Path)

TURNED_APART_DEG = 20.0
"""Heads that face ways further apart need a warning: landmarks put on by hand turn two upright heads by less."""


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
@click.option("--fine-suffix", metavar="TEXT", help="ROUGH has the fine shapes, too: those named NAME and TEXT.")
@click.option("-o", "--output", required=True, type=FILE, metavar="DIR", help="Folder for the results.")
@click.option(
    "--method",
    default="character transfer",
    show_default=True,
    metavar="NAME",
    help="Or another; an unknown name lists all.",
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
    fine_suffix: str | None, output: Path, method: str, regions: Path | None, coefficients: Path | None,
    reference: tuple[Path, ...], names: Path | None, up: str, no_pictures: bool, as_json: bool,
) -> None:  # fmt: skip
    """Make fine shapes of the rough ones that have none, from those that have.

    ROUGH and --fine are mesh files, folders of such, or one glTF file with a morph target for each shape; a rough and
    a fine shape of one name are an example. Rough shapes must be without head motion. Written into DIR: each result
    as its rough file with other positions, summary.json, regions.json and coefficients.csv (edit them, give them
    back), and pictures, sheet-1.png and so on, with error maps where there are references.

    \b
    Examples:
        evalkit transfer apply rough --fine fine --rest rest.obj -o out
        evalkit transfer apply face.glb --fine-suffix .fine -o out
        evalkit transfer apply rough/frown.obj --rest rest.obj --example rough/smile.obj grin.obj -o out
        evalkit transfer apply rough --fine fine --rest rest.obj --regions mine.json --reference sculpts -o out
    """
    from evalkit.cli.compensate import working
    from evalkit.report import transfer as report
    from evalkit.results import check_output
    from evalkit.transfer.files import read_material
    from evalkit.transfer.run import transferred

    if not (fine or pairs or fine_suffix):
        raise click.UsageError("give sculpted examples: --fine DIR, --example ROUGH FINE, or --fine-suffix TEXT")
    check_output(output)
    with working("reading the meshes"):
        material = read_material(rough, fine, rest, pairs, fine_suffix)
        references = report.read_references(reference, material)
        eyes = report.eye_distance(names, material.rest) if names is not None else None
    every = (*material.rough, *material.fine, *material.new, *(shape for shape in references if shape))
    given = [material.rest.path, *(shape.mesh.path for shape in every), *filter(None, (regions, coefficients, names))]
    report.protect_inputs(output, [*report.output_names(material), *report.FILES], given)
    with working("transferring"):
        outcome = transferred(material, method, regions, coefficients)
        content = report.summary(material, outcome, references, eyes)
    columns = report.transfer_columns(material, outcome, references)
    files = write(
        output, lambda stage: report.write_transferred(material, outcome, content, stage), content["warnings"],
        [shape.name for shape in material.new], columns, up, not no_pictures,
    )  # fmt: skip
    echo(content, output, files, as_json, described(content))


@transfer.command()
@click.argument("shapes", nargs=-1, required=True, type=FILE, metavar="SHAPE...")
@click.option("--source-rest", type=FILE, metavar="MESH", help="SHAPEs at rest  [default: that of a glTF SHAPE]")
@click.option("--target-rest", required=True, type=FILE, metavar="MESH", help="The character at rest.")
@click.option("--source-names", type=FILE, metavar="JSON", help="Its landmarks and regions  [default: beside it]")
@click.option("--target-names", type=FILE, metavar="JSON", help="The same of the character  [default: beside it]")
@click.option("--correspondence", type=FILE, metavar="NPZ", help="One that was written before, in place of the names.")
@click.option("-o", "--output", required=True, type=FILE, metavar="DIR", help="Folder for the results.")
@click.option("--up", type=click.Choice(["y", "z"]), default="y", show_default=True, help="Axis, for the pictures.")
@click.option("--no-pictures", is_flag=True, help="Write no sheet-1.png, ...")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON instead of text.")
def deform(
    shapes: tuple[Path, ...], source_rest: Path | None, target_rest: Path, source_names: Path | None,
    target_names: Path | None, correspondence: Path | None, output: Path, up: str, no_pictures: bool, as_json: bool,
) -> None:  # fmt: skip
    """Make rough shapes of the target from the SHAPEs of another head, by Deformation Transfer.

    The two meshes may differ in topology and size; they must face the same way. The JSONs of names are those of
    evalkit head import: landmarks that both have, and the regions "upper lip" and "lower lip", which keep a closed
    mouth from growing together. Written into DIR: each shape as the target's file with other positions,
    correspondence.npz for the next time, summary.json, and pictures.

    \b
    Examples:
        evalkit transfer deform other --source-rest a.obj --target-rest b.obj -o rough
        evalkit transfer deform more --source-rest a.obj --target-rest b.obj --correspondence kept.npz -o rough2
    """
    import numpy as np

    from evalkit.cli.compensate import working
    from evalkit.meshes import read_mesh_file
    from evalkit.report import transfer as report
    from evalkit.results import check_output
    from evalkit.transfer.files import odd_shapes, read_source, read_surface
    from evalkit.transfer.run import deformed, turned_apart

    check_output(output)
    with working("reading the meshes"):
        source, found = read_source(shapes, source_rest)
        target = read_mesh_file(target_rest)
        if correspondence is None:
            source_names = source_names or source.path.with_suffix(".json")
            target_names = target_names or target.path.with_suffix(".json")
        one, other = read_surface(source, source_names), read_surface(target, target_names)
    inputs = [source.path, target.path, *(shape.mesh.path for shape in found)]
    inputs += filter(None, (source_names, target_names, correspondence))
    report.protect_inputs(output, [*(shape.name + target.path.suffix for shape in found), *report.FILES], inputs)
    warnings = odd_shapes(source, found)
    angle = turned_apart(one, other)
    if angle > TURNED_APART_DEG:
        warnings.append(f"{target.path} faces {angle:.0f} degrees away from {source.path}; turn one of them first")
    with working("transferring"):
        done = deformed(one, np.stack([shape.places for shape in found]), other, correspondence)
        content = report.deformed_summary(found, source, target, done, warnings)
    columns = report.deformed_columns(found, source, target, done)
    files = write(
        output, lambda stage: report.write_deformed(found, target, done, content, stage), content["warnings"],
        [shape.name for shape in found], columns, up, not no_pictures,
    )  # fmt: skip
    echo(content, output, files, as_json, described_deformed(content))


@transfer.command()
@click.argument("rough", nargs=-1, required=True, type=FILE, metavar="ROUGH...")
@click.option("--rest", type=FILE, metavar="MESH", help="The character at rest  [default: that of a glTF ROUGH]")
@click.option("-k", "count", default=4, show_default=True, type=click.IntRange(1), help="So many examples.")
@click.option("--json", "as_json", is_flag=True, help="Print the names as a JSON list.")
def choose(rough: tuple[Path, ...], rest: Path | None, count: int, as_json: bool) -> None:
    """Say which of the ROUGH expressions an artist should sculpt, the most useful first.

    \b
    Example:
        evalkit transfer choose rough --rest rest.obj -k 3
    """
    from evalkit.cli.compensate import working
    from evalkit.transfer.files import read_source
    from evalkit.transfer.run import chosen

    with working("reading the meshes"):
        neutral, shapes = read_source(rough, rest)
    with working("choosing"):
        names = [shape.name for shape in chosen(neutral, shapes, count)]
    click.echo(json.dumps(names, indent=2) if as_json else "\n".join(names))


def described(content: dict[str, Any]) -> list[str]:
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
    return lines


def described_deformed(content: dict[str, Any]) -> list[str]:
    """The summary of Deformation Transfer for people."""
    turned = sum(shape["flipped_triangles"] for shape in content["shapes"])
    return [
        f"deformation transfer: {len(content['shapes'])} shapes, {content['source']['vertices']} vertices to "
        f"{content['target']['vertices']}, {content['pinned_vertices']} of them still",
        f"{turned} triangles turned over in the results",
    ]


def echo(content: dict[str, Any], output: Path, files: Sequence[str], as_json: bool, lines: Sequence[str]) -> None:
    """Print what was done; in text also its warnings and files."""
    if as_json:
        click.echo(json.dumps(content, indent=2))
        return
    meshes = sorted({shape["written"] for shape in content["shapes"]})
    shown = f"{', '.join(meshes[:3])}, ... ({len(meshes)} meshes)" if len(meshes) > 3 else ", ".join(meshes)
    others = ", ".join(name for name in files if name not in meshes)
    warnings = [f"warning: {text}" for text in content["warnings"]]
    click.echo("\n".join([*lines, *warnings, f"wrote into {output}: {shown}, {others}"]))


def write(
    output: Path, meshes: Callable[[Path], None], warnings: list[str], names: Sequence[str], columns: Sequence[Column],
    up: str, pictures: bool,
) -> list[str]:  # fmt: skip
    """Meshes and pictures in a folder, all of it or nothing; returns the names of the files.

    Where nothing can be drawn a warning says why: the meshes are worth having without.
    """
    from evalkit.errors import EvalkitError
    from evalkit.render.offscreen import require_offscreen
    from evalkit.report.transfer import write_sheets
    from evalkit.results import staged

    if pictures:
        try:
            require_offscreen()
        except EvalkitError as error:
            warnings.append(str(error))
            pictures = False
    with staged(output) as stage:
        meshes(stage)
        if pictures:
            with progress("drawing", len(names)) as drawn:
                write_sheets(names, columns, stage, up, drawn)
        return sorted(path.name for path in stage.iterdir())


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
