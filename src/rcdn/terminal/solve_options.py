"""Options of `rcdn calibrate` for the solution: the lens model, the board's shape, excluded pictures."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer

from rcdn.terminal.options import GridSize, parse_size


class Model(StrEnum):
    """The lens models of `rcdn.calibrate`."""

    auto = "auto"
    pinhole = "pinhole"
    radtan = "radtan"
    brown = "brown"
    fisheye = "fisheye"
    rational = "rational"
    splined = "splined"


LensModel = Annotated[
    Model,
    typer.Option(
        help="The lens: pinhole has no distortion, radtan k1 k2 p1 p2 (Kalibr's), brown k3 too, fisheye four numbers "
        "(Kannala-Brandt), rational eight, splined a smooth correction beside the best of these. auto: the "
        "simplest that predicts pictures held out about as well as the best."
    ),
]
BoardSize = Annotated[
    GridSize | None,
    typer.Option(
        parser=parse_size,
        metavar="COLSxROWS",
        help="The board's inner corners: 10x7 squares are 9x6. Not needed; "
        "boards that can't be part of it are left out.",
    ),
]
Flat = Annotated[bool, typer.Option("--flat", help="The board is perfect (glass, say): don't solve for its shape.")]
LeaveOut = Annotated[
    list[str] | None,
    typer.Option(
        "--leave-out",
        metavar="NAME",
        help="Solve without this picture, or without its second board (NAME:2); may be given several times. "
        "The report names them.",
    ),
]
FixAspect = Annotated[bool, typer.Option("--fix-aspect", help="Pixels are square: hold fx = fy.")]
FixPrincipalPoint = Annotated[
    bool,
    typer.Option("--fix-principal-point", help="Hold the principal point in the middle of the picture."),
]
CorrectTime = Annotated[
    bool,
    typer.Option(
        "--correct-time",
        help="With --rig: bring cameras into step that are late or early, by boards that move; of videos, which may "
        "have been started one after the other, more frames are looked at.",
    ),
]
FixedBoards = Annotated[
    bool,
    typer.Option(
        "--fixed-boards",
        help="With --rig: the boards with different codes are fixed to each other (on both sides of a plate, on a "
        "frame, in a room); their places are solved for, and connect cameras that see different ones.",
    ),
]
Select = Annotated[
    int | None,
    typer.Option(
        "--select",
        min=3,
        metavar="N",
        help="Calibrate from N of the pictures, or frames of videos: those whose camera is nearest to that of all.",
    ),
]
