"""The command line: one file per verb. Exit 0 done, 1 the data could not answer or was bad, 2 wrong usage."""

from __future__ import annotations

import sys

import click

from evalkit import __version__
from evalkit.cli.animate import animate
from evalkit.cli.bench import bench
from evalkit.cli.compensate import compensate
from evalkit.cli.control import control
from evalkit.cli.database import database
from evalkit.cli.demo import demo
from evalkit.cli.figures import figures
from evalkit.cli.head import head
from evalkit.cli.methods import methods
from evalkit.cli.regress import regress
from evalkit.cli.study import study
from evalkit.cli.synth import synth
from evalkit.cli.track import track
from evalkit.cli.transfer import transfer
from evalkit.errors import EvalkitError


@click.group(
    epilog="Start with:  evalkit demo    -    on your own take:  evalkit compensate take.c3d -o out",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(__version__, prog_name="evalkit")
def app() -> None:
    """Facial motion capture from raw markers to expression-only motion, measured at every step."""


COMMANDS = (
    demo,
    compensate,
    animate,
    track,
    database,
    control,
    transfer,
    bench,
    synth,
    study,
    figures,
    regress,
    head,
    methods,
)
for command in COMMANDS:
    app.add_command(command)


def main() -> None:
    """Run a command; a user's mistake becomes one line on standard error."""
    try:
        app(prog_name="evalkit")
    except EvalkitError as error:
        sys.stderr.write(f"evalkit: {error}\n")
        sys.exit(1)
