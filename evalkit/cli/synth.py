"""``evalkit synth``: captures and videos with their truth, and the reference set."""

from __future__ import annotations

import itertools
from pathlib import Path

import click

BUNDLED = "the bundled takes"
VIDEO = "video-"
"""How presets of filmed heads begin."""

PERFORMER = "performer"
"""The preset that is a take for a motion database."""


@click.command()
@click.argument("preset", required=False, metavar="PRESET")
@click.option("-o", "--output", type=click.Path(path_type=Path), metavar="DIR", help="Folder to write into.")
@click.option("--seed", default=0, show_default=True, help="The same seed gives the same take.")
@click.option("--set", "settings", multiple=True, metavar="KEY=VALUE", help="Change a parameter; may be repeated.")
@click.option("--list", "show", is_flag=True, help="List presets and parameters.")
@click.option("--reference", is_flag=True, help="Write the reference set, a small take of every preset, to -o DIR.")
@click.option(
    "--check",
    is_flag=False,
    flag_value=BUNDLED,
    metavar="[DIR]",
    help="Make the takes of DIR's MANIFEST.json again (default: those that come with evalkit) and compare.",
)
def synth(
    preset: str | None,
    output: Path | None,
    seed: int,
    settings: tuple[str, ...],
    show: bool,
    reference: bool,
    check: str | None,
) -> None:
    """Make a synthetic capture: PRESET.c3d, PRESET.truth.npz and PRESET.json with parameters and checksums.

    A preset whose name begins with video- is a filmed head instead: PRESET.mp4, PRESET.truth.npz, PRESET.truth.csv,
    PRESET.points.json (the 19 points of its first frame) and PRESET.json. The preset performer is a take of a whole
    face for a motion database, performer-SEED.c3d with its truth.

    \b
    Examples:
        evalkit synth talking -o takes --seed 3 --set noise=0.5 --set sway=20
        evalkit synth video-occluded -o videos --set frames=60 --set noise=4
        evalkit synth performer -o takes --seed 1
        evalkit synth --check
    """
    from evalkit.synthetic import parse_overrides, write_synthetic

    if sum((preset is not None, show, reference, check is not None)) != 1 or (output is None) != (
        show or check is not None
    ):
        raise click.UsageError("give a PRESET and -o DIR, or --reference and -o DIR, or --check, or --list")
    if (settings or seed) and preset is None:
        raise click.UsageError("--set and --seed go with a PRESET")
    if show:
        _list()
    elif check is not None:
        _check(check)
    elif reference:
        from evalkit.synthetic.reference import write_reference

        assert output is not None
        written = write_reference(output)
        click.echo(f"wrote {len(written)} files to {output}, {sum(p.stat().st_size for p in written) / 1e6:.1f} MB")
    else:
        assert preset is not None
        assert output is not None
        if preset.startswith(VIDEO):
            from evalkit.studies.filmed import parse_video_overrides, write_video

            written = write_video(preset, output, seed=seed, **parse_video_overrides(settings))
        elif preset == PERFORMER:
            from evalkit.studies.control_takes import parse_settings, write_control_take

            written = write_control_take(output, seed, **parse_settings(settings))
        else:
            written = [*write_synthetic(preset, output, seed=seed, **parse_overrides(settings))]
        for path in written:
            click.echo(f"wrote {path}")


def _check(folder: str) -> None:
    """One line for each file; exit status 1 if any is not what the generator makes."""
    from evalkit.bundled import bundled_folder
    from evalkit.synthetic.reference import check_reference

    verdicts = []
    for verdict in check_reference(bundled_folder() if folder == BUNDLED else folder):
        click.echo(f"{verdict.file:<28}{verdict.text}")
        verdicts.append(verdict)
    if not all(verdict.same for verdict in verdicts):
        raise SystemExit(1)


def _list() -> None:
    from evalkit.studies.control_takes import SETTINGS
    from evalkit.studies.filmed import VIDEO_PRESETS, VideoParameters
    from evalkit.synthetic import PRESETS, Parameters
    from evalkit.synthetic.parameters import FIELDS, setting

    click.echo("presets")
    for name, entry in PRESETS.items():
        click.echo(f"  {name:<16}{entry.text}" + (f"  [{entry.origin}]" if entry.origin else ""))
        if changed := entry.parameters.settings():
            click.echo(f"  {'':<16}    {changed}")
    click.echo("\nparameters (--set KEY=VALUE), with their defaults")
    default = Parameters()
    for group, names in itertools.groupby(FIELDS, key=lambda name: FIELDS[name].group):
        click.echo(f"  {group}")
        for name in names:
            field = FIELDS[name]
            unit = f" ({field.unit})" if field.unit else ""
            click.echo(f"    {name:<16}{field.text}{unit} [{setting(getattr(default, name))}]")
    click.echo("\nperformer: a take for a motion database (evalkit database build), with its own parameters")
    for name, value in SETTINGS.items():
        click.echo(f"    {name:<16}[{value}]")
    click.echo("\nfilmed heads")
    for name, video in VIDEO_PRESETS.items():
        click.echo(f"  {name:<16}{video.text}")
        if changed := video.parameters.settings():
            click.echo(f"  {'':<16}    {changed}")
    click.echo("\nparameters of filmed heads (--set KEY=VALUE), with their defaults")
    for name, value in vars(VideoParameters()).items():
        click.echo(f"    {name:<16}[{setting(value)}]")
