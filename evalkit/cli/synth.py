"""``evalkit synth``: a capture with its truth."""

from __future__ import annotations

from pathlib import Path

import click


@click.command()
@click.argument("preset", required=False, metavar="PRESET")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder to write into.")
@click.option("--seed", default=0, show_default=True, help="The same seed gives the same take.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a parameter; may be repeated.")
@click.option("--list", "show", is_flag=True, help="List presets and parameters.")
def synth(preset: str | None, output: Path | None, seed: int, settings: tuple[str, ...], show: bool) -> None:
    """Make a synthetic capture: PRESET.c3d, PRESET.truth.npz and PRESET.json with parameters and checksums.

    \b
    Example:
        evalkit synth talking -o takes --seed 3 --set noise=0.5 --set sway=20
    """
    from evalkit.synthetic import PRESETS, Parameters, parse_overrides, write_synthetic

    if show:
        import dataclasses

        click.echo("presets")
        for name, entry in PRESETS.items():
            click.echo(f"  {name:<14}{entry.text}")
        click.echo("parameters (--set KEY=VALUE) and their defaults")
        for field in dataclasses.fields(Parameters):
            click.echo(f"  {field.name:<14}{getattr(Parameters(), field.name)}")
        return
    if preset is None or output is None:
        raise click.UsageError("give a PRESET and -o DIR, or --list")
    files = write_synthetic(preset, output, seed=seed, **parse_overrides(settings))
    for path in files:
        click.echo(f"wrote {path}")
