"""``evalkit demo``: the main job, end to end, on the bundled capture."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

BUNDLED = "talking"


@click.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("demo"),
    show_default=True,
    metavar="DIR",
    help="Folder for the results.",
)
def demo(output: Path) -> None:
    """Compensate the bundled synthetic take, compare all methods on it, write the report and pictures.

    \b
    Example:
        evalkit demo -o demo
    """
    from evalkit import compensation
    from evalkit.bundled import bundled_take
    from evalkit.capture import read_capture
    from evalkit.cli.compensate import describe, errors_against, read_truth, working
    from evalkit.report import compare_methods, write_pictures, write_report
    from evalkit.results import check_output, staged, write_results

    check_output(output)
    path, truth_path = bundled_take(BUNDLED)
    click.echo(f"reading the bundled take {path.name}: 23 markers of a talking face whose truth is known")
    take = read_capture(path)
    truth = read_truth(truth_path, take)
    result = compensation.compensate(take, truth.rigid)
    with staged(output) as stage:
        content = write_results(result, stage, path, errors_against(result, truth))
        with working("comparing methods and writing the report"):
            rows = compare_methods(take, result, truth=truth)
            write_report(take, result, stage / "report.html", methods=rows, truth=truth, source=path)
            missing = write_pictures(take, result, stage)
    click.echo(describe(content, output, True))
    click.echo("")
    click.echo(methods_table(rows))
    for line in missing:
        click.echo(line)
    click.echo(
        f"\npictures: {output / 'markers.png'}, {output / 'pivot.png'}; open {output / 'report.html'} in a browser"
    )


def methods_table(rows: list[dict[str, Any]]) -> str:
    """The comparison of methods as text."""
    header = (
        f"{'method':<32}{'status':<20}{'pivot error':>12}{'rotation':>10}{'expression':>12}{'time':>9}\n"
        f"{'':<32}{'':<20}{'mm':>12}{'deg rms':>10}{'mm rms':>12}{'ms':>9}"
    )
    lines = [header]
    for row in rows:
        name = f"{row['kind']} {row['method']}{' *' if row['chosen'] else ''}"
        name = "no compensation" if row["kind"] == "none" else name
        cells = [
            _cell(row[key], width, digits)
            for key, width, digits in (
                ("pivot_error_mm", 12, 2), ("rotation_error_deg", 10, 3), ("expression_error_mm", 12, 3),
            )
        ]  # fmt: skip
        lines.append(f"{name:<32}{row['status']:<20}{''.join(cells)}{_cell(1000 * row['seconds'], 9, 1)}")
    return "\n".join([*lines, "* chosen for the result; each line changes only the method it names"])


def _cell(value: float, width: int, digits: int) -> str:
    return f"{value:>{width}.{digits}f}" if math.isfinite(value) else f"{'-':>{width}}"
