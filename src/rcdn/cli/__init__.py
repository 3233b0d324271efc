"""The command line: one file per verb.

To add a verb: write `cli/<verb>.py` with a function `<verb>` whose parameters are the options and whose docstring is
the help, import heavy modules inside that function, and add the module to the two places below, with its line and its
group in the help. Verbs raise RcdnError (exit code 1) or ConfigError (exit code 2), which `terminal.group` prints as
one line. Verbs of other packages are Typer apps given by their entry points of the group `rcdn.verbs`.
"""

from __future__ import annotations

import os
import sys
from typing import Annotated

import typer

from rcdn import interrupts
from rcdn.cli import board, calibrate, compare, convert, detect, export, live, pose, render, report, train, undistort
from rcdn.terminal.group import BUILDERS, INTERRUPTED, Group, print_stopped
from rcdn.terminal.stderr import READERS, for_ours_alone

app = typer.Typer(
    name="rcdn",
    cls=Group,
    no_args_is_help=True,
    rich_markup_mode=None,  # plain text: errors stay on one line, in a pipe and on a terminal
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from rcdn import __version__

        typer.echo(f"rcdn {__version__}")
        raise typer.Exit


@app.callback()
def rcdn(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Find the corners of checkerboards in photographs, the boards they belong to, and the cameras that took them.

    Nobody has to say how big the board is; parts of boards and several boards in a picture are found, too.
    """


FILES = "About cameras and files"
"""the second group of verbs in the help, after those that most users need"""

app.command("detect", short_help="Find corners and boards in pictures.")(detect.detect)
app.command("calibrate", short_help="Calibrate a camera, or a pair, from pictures of boards.")(calibrate.calibrate)
app.command("live", short_help="Calibrate a camera with a page that says what to do.")(live.live)
app.command("pose", short_help="Find where boards stand before a known camera.")(pose.pose)
app.command("board", short_help="Write a board to print, at true scale.")(board.board)
app.command("undistort", short_help="Turn pictures into those of a pinhole camera.")(undistort.undistort)
app.command("convert", short_help="Write cameras and detections in other formats.", rich_help_panel=FILES)(
    convert.convert
)
app.command("compare", short_help="Say how far two cameras differ, px.", rich_help_panel=FILES)(compare.compare)
app.command("report", short_help="Write the page of a saved calibration again.", rich_help_panel=FILES)(report.report)
app.command("render", short_help="Render pictures of boards, with the truth.", rich_help_panel=BUILDERS)(render.render)
app.command("train", short_help="Train networks.", rich_help_panel=BUILDERS)(train.train)
app.command("export", short_help="Write a trained network as ONNX.", rich_help_panel=BUILDERS)(export.export)


def main() -> None:
    """The `rcdn` command, called by `rcdn.__main__` after its initial setup."""
    from rcdn.terminal.streams import Streams

    # before numpy is imported, here and in processes started later: its BLAS would use threads for matrices of a few
    # rows, which doubles the time; the work is parallelized over pictures instead
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with interrupts.held():
        if READERS.intersection(sys.argv[1:2]):
            for_ours_alone()
        streams = Streams()
    code: object = 0
    try:
        app(prog_name="rcdn")
    except SystemExit as end:
        code = end.code
    except KeyboardInterrupt:
        code = INTERRUPTED
    if code == INTERRUPTED and not interrupts.ended():  # before a verb has started, or after its end
        print_stopped()
    interrupts.end()
    sys.exit(streams.end(code if isinstance(code, int) else 0))
