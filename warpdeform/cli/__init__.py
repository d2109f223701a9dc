"""The command line, `warpdeform`: one module per command.

Modules of this package import typer and the standard library alone; a command loads what it needs when it runs, so that
`warpdeform --help` answers at once. A group of commands is a typer of its own under the same rule, as `bench` is.
"""

import typer

from warpdeform.cli.bench import bench
from warpdeform.cli.check import check
from warpdeform.cli.ending import INTERRUPTED
from warpdeform.cli.info import info
from warpdeform.cli.picture import picture
from warpdeform.cli.run import run
from warpdeform.cli.scenes import scenes
from warpdeform.cli.study import study

app = typer.Typer(
    name="warpdeform",
    help="Elastically deformable surfaces: scene files to USD frames, on the CPU or the GPU.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # plain help: loading rich would double its time
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _version(wanted: bool) -> None:
    if wanted:
        from warpdeform import __version__

        typer.echo(f"warpdeform {__version__}")
        raise typer.Exit


@app.callback()
def _main(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Say which version it is."),
) -> None:
    """Elastically deformable surfaces: scene files to USD frames, on the CPU or the GPU."""


for command in (run, check, info, scenes, picture):
    app.command()(command)
app.add_typer(bench, name="bench")
app.add_typer(study, name="study")


def main() -> None:
    """Entry point of the command `warpdeform`."""
    try:
        app()
    except KeyboardInterrupt:  # before a command took the signal over
        raise SystemExit(INTERRUPTED) from None
