"""``evalkit synth``: a capture with its truth."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def synth(
    preset: Annotated[str | None, typer.Argument(metavar="PRESET", help="Name of a preset; see --list.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder to write into.")] = None,
    seed: Annotated[int, typer.Option(help="The same seed gives the same take.")] = 0,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a parameter; may be repeated.")
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="List presets and parameters.")] = False,
) -> None:
    """Make a synthetic capture: PRESET.c3d, PRESET.truth.npz and PRESET.json with parameters and checksums.

    Example:

        evalkit synth talking -o takes --seed 3 --set noise=0.5 --set sway=20
    """
    from evalkit.synthetic import PRESETS, Parameters, parse_overrides, write_synthetic

    if show:
        import dataclasses

        typer.echo("presets")
        for name, entry in PRESETS.items():
            typer.echo(f"  {name:<14}{entry.text}")
        typer.echo("parameters (--set KEY=VALUE) and their defaults")
        for field in dataclasses.fields(Parameters):
            typer.echo(f"  {field.name:<14}{getattr(Parameters(), field.name)}")
        return
    if preset is None or output is None:
        raise typer.BadParameter("give a PRESET and -o DIR, or --list")
    files = write_synthetic(preset, output, seed=seed, **parse_overrides(settings or []))
    for path in files:
        typer.echo(f"wrote {path}")
