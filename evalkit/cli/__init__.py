"""The command line: one file per verb. Exit 0 done, 1 the data could not answer or was bad, 2 wrong usage."""

from __future__ import annotations

import sys

import typer

from evalkit import __version__
from evalkit.cli import compensate, demo, methods, synth
from evalkit.errors import EvalkitError

app = typer.Typer(
    name="evalkit",
    help="Facial motion capture from raw markers to expression-only motion, measured at every step.",
    epilog="Start with:  evalkit demo    ·    on your own take:  evalkit compensate take.c3d -o out",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"evalkit {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Print the version."),
) -> None:
    pass


app.command("demo")(demo.demo)
app.command("compensate")(compensate.compensate)
app.command("synth")(synth.synth)
app.command("methods")(methods.methods)


def main() -> None:
    """Run a command; a user's mistake becomes one line on standard error."""
    try:
        app()
    except EvalkitError as error:
        sys.stderr.write(f"evalkit: {error}\n")
        sys.exit(1)
    except BrokenPipeError:
        # The reader of our output has gone (a pager that was closed): nothing is left to say.
        sys.stderr.close()
        sys.exit(0)
    except KeyboardInterrupt:
        sys.stderr.write("evalkit: interrupted; nothing was written\n")
        sys.exit(130)
