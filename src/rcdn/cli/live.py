"""`rcdn live`: a local page that guides the user through calibrating a camera."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.errors import ConfigError, DependencyError
from rcdn.terminal import console
from rcdn.terminal.console import Quiet
from rcdn.terminal.group import INTERRUPTED, print_stopped
from rcdn.terminal.options import parse_folder
from rcdn.terminal.solve_options import BoardSize, LensModel, Model
from rcdn.terminal.spacing import Length, Lengths, check_spacing, parse_spacing
from rcdn.terminal.target import DEFAULT, Target, TargetOption

if TYPE_CHECKING:
    from rcdn.live.folder import Settings
    from rcdn.live.run import Place
    from rcdn.live.session import Tools
    from rcdn.live.sources import Source

SquareSide = Annotated[
    Length | None,
    typer.Option(
        "--spacing",
        parser=parse_spacing,
        metavar="LENGTH",
        help="Side of one square (or tag), with its unit: 25mm, 2.5cm, 1in. Without it the page asks.",
    ),
]
TARGET = 0.1
"""largest projection uncertainty that is sufficient, px"""


def live(
    folder: Annotated[
        Path,
        typer.Argument(
            parser=parse_folder,
            metavar="FOLDER",
            help="Where pictures are kept as they are taken, and the camera at the end: a new folder, "
            "or one to go on with.",
        ),
    ] = Path("camera"),
    spacing: SquareSide = None,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WHICH",
            help="browser (the default): the camera that the page may use. 0, 1, …: a camera of this computer; "
            "rtsp://…: one on the network; or a video file. With --stereo twice, LEFT and RIGHT, or once for one whose "
            "pictures hold both side by side.",
        ),
    ] = None,
    stereo: Annotated[
        bool, typer.Option("--stereo", help="Calibrate two cameras that are fixed to one another.")
    ] = False,
    model: LensModel = Model.auto,
    board: BoardSize = None,
    target: Target = DEFAULT,
    enough: Annotated[
        float,
        typer.Option(min=0.01, max=10, metavar="PX", help="The uncertainty over the whole picture that is low enough."),
    ] = TARGET,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="An address of this machine, for a page on another one, a phone say: "
            "only with --certificate or --self-signed.",
        ),
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, metavar="N", help="0: that of the last time, or any that is free.")
    ] = 0,
    certificate: Annotated[Path | None, typer.Option(metavar="FILE", help="The certificate for TLS, PEM.")] = None,
    key: Annotated[Path | None, typer.Option(metavar="FILE", help="Its key, PEM.")] = None,
    self_signed: Annotated[
        bool, typer.Option("--self-signed", help="Make a certificate for TLS; needs the package cryptography.")
    ] = False,
    open_page: Annotated[bool, typer.Option("--open/--no-open", help="Open the page in the browser.")] = True,
    quiet: Quiet = False,
) -> None:
    """Calibrate a camera with a page that says where to hold the board, and takes the pictures by itself.

    The page is for this machine only, and its address holds a secret. Pictures go to FOLDER and nowhere else: each one
    that is taken is there at once, and after a pause, or a crash, the same command goes on. At the end FOLDER holds the
    camera (OpenCV, ROS, JSON), the pictures and the report. With --stereo all this is of two cameras, and of where they
    stand to one another.

    Exit code: 1 if the page can't be served, 2 for wrong use, 130 after Ctrl-C, which ends it.
    """
    console.begin(quiet)
    length = _length(spacing, target)
    size = target.board(board)
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
        import websockets  # noqa: F401
    except ImportError as error:
        raise DependencyError(f"rcdn live needs {error.name}; run: pip install 'rcdn[live]'") from error
    from rcdn.live.folder import Folder, Settings
    from rcdn.live.run import serve
    from rcdn.live.session import Session
    from rcdn.live.sources import check_source

    named = camera or ["browser"]
    for name in named:
        check_source(name)
    if len(named) > 1 and not stereo:
        raise ConfigError("--camera is given more than once; for two cameras add --stereo")
    kept = Folder(folder, 2 if stereo else 1)
    place = _place(folder, host, port, (certificate, key), self_signed)
    settings = kept.agree(Settings(length, model.value, None if size is None else (size.cols, size.rows)))
    source = _source(named, stereo)
    session = Session(kept, settings, _tools(settings, target, enough, stereo))
    with contextlib.suppress(KeyboardInterrupt):
        serve(kept, session, source, place, lambda address: _opened(address, place, open_page))
    again = f"rcdn live {folder}{' --stereo' if stereo else ''}"
    print_stopped(f"; what was taken is in {folder}, and `{again}` goes on")
    raise typer.Exit(INTERRUPTED)


def _length(spacing: Length | Lengths | None, target: TargetOption) -> float | None:
    """The side of a square, m; None if the page should ask for it."""
    if spacing is None and target.spacing is None:
        return None
    length = target.length(spacing)
    if isinstance(length, Lengths):
        raise ConfigError("--spacing: one length for one kind of board; give it alone, such as 25mm")
    check_spacing(length)
    return float(length)


def _place(folder: Path, host: str, port: int, tls: tuple[Path | None, Path | None], self_signed: bool) -> Place:
    from rcdn.live.certificate import self_signed as make_certificate
    from rcdn.live.run import Place
    from rcdn.live.security import check_host

    if self_signed and tls != (None, None):
        raise ConfigError("--self-signed makes a certificate and a key; leave --certificate and --key out")
    check_host(host, self_signed or tls[0] is not None)
    place = Place(host, port, *(make_certificate(folder, host) if self_signed else tls))
    place.check()
    return place


def _source(cameras: list[str], stereo: bool) -> Source | None:
    """The server's own camera or cameras; None to use the browser's."""
    from rcdn.live.sources import open_pair, open_source

    return open_pair(cameras) if stereo else open_source(cameras[0])


def _tools(settings: Settings, target: TargetOption, enough: float, stereo: bool = False) -> Tools:
    """The functions for detection, guidance, and writing the camera."""
    from rcdn.batch.live_files import write_camera_files, write_pair_files
    from rcdn.calibration.guidance import Guide, PairGuide
    from rcdn.config import DetectorConfig
    from rcdn.detector import Detector
    from rcdn.live.session import Tools
    from rcdn.types import Array, Board

    careful = Detector(DetectorConfig.preset("auto", target=target.reads, threads=1))
    quick = {
        close: Detector(DetectorConfig.preset("auto", target=target.reads, threads=1, pyramid=close, sharpen=None))
        for close in (False, True)
    }

    def follow(grey: Array, close: bool) -> Board | None:
        return max(quick[close].boards(grey), key=len, default=None)

    def guide(image_size: tuple[int, int], spacing: float) -> Guide:
        return Guide(image_size, spacing, model=settings.model, size=settings.size, target=enough)

    def pair_guide(sizes: tuple[tuple[int, int], tuple[int, int]], spacing: float) -> PairGuide:
        return PairGuide(sizes, spacing, model=settings.model, size=settings.size, target=enough)

    if stereo:
        return Tools(pair_guide, follow, careful.boards, write_pair_files)
    return Tools(guide, follow, careful.boards, write_camera_files)


def _opened(address: str, place: Place, open_page: bool) -> None:
    """Print the address of the page, and open it."""
    import webbrowser

    from rcdn.live.certificate import fingerprint

    console.print_line(f"Open {address}")
    if place.certificate is not None:
        console.print_line(f"certificate, SHA-256: {fingerprint(place.certificate)}")
    console.note("Ctrl-C ends it")
    if open_page:
        webbrowser.open(address)
