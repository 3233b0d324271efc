"""What `rcdn calibrate` writes: its options, checked before the work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.cli import _batch
from rcdn.cli._camera_files import check_format
from rcdn.errors import ConfigError, FormatError

if TYPE_CHECKING:
    from rcdn.io import CameraFormat
    from rcdn.types import Calibration


class FileFormat(StrEnum):
    """Formats of camera files."""

    opencv = "opencv"
    ros = "ros"
    kalibr = "kalibr"
    colmap = "colmap"
    mrcal = "mrcal"
    json = "json"


class FailOn(StrEnum):
    """Verdicts that may be failures; `good` isn't."""

    fair = "fair"
    unsure = "unsure"
    bad = "bad"


CameraFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Write the camera; may be given several times. By the name: .yaml (OpenCV; camera_info.yaml: ROS, camchain.yaml: "
        "Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json; .npz: maps that undistort, for cv2.remap.",
    ),
]
CameraFileFormat = Annotated[
    FileFormat | None, typer.Option("--format", help="Format of --output, where the name doesn't tell.")
]
ReportFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Write a page to look at: verdict, coverage, residuals, views.")
]
JsonFile = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Write everything: camera, deviations, poses, residuals of each corner."),
]
Force = Annotated[
    bool,
    typer.Option("--force", help="Write the camera even if the views don't settle its focal length or centre."),
]
FailOnVerdict = Annotated[
    FailOn | None,
    typer.Option(
        "--fail-on",
        help="Exit with 1 if the verdict is this or worse (fair, unsure, bad); files are written all the same.",
    ),
]


@dataclass(frozen=True)
class Outputs:
    """What to write, and where."""

    cameras: list[Path]
    format: CameraFormat | None
    report: Path | None
    json: Path | None
    force: bool = False
    pictures: Sequence[Path] = ()

    def check(self, inputs: Sequence[str | Path]) -> None:
        """Raise before the work what would spoil it afterwards."""
        paths = [Path(i) for i in inputs]
        for path in self.cameras:
            try:
                check_format(path, self.format)
            except FormatError as error:
                raise ConfigError(str(error)) from None
            _batch.check_file("--output", path, paths)
        _batch.check_file("--report", self.report, paths)
        _batch.check_file("--json", self.json, paths)

    def kept(self, *calibrations: Calibration) -> bool:
        """Whether cameras are written: what the views of `calibrations` don't settle is written only by force."""
        from rcdn.calibration.observability import unsettled

        return self.force or not any(unsettled(c) for c in calibrations)

    def say(self, written: Sequence[Path] | None) -> None:
        """Tell what was written: the camera files `written`, or None if the views don't settle the camera."""
        if self.cameras and written is None:
            lost = ", ".join(str(p) for p in self.cameras)
            typer.echo(
                f"not written: {lost}: these pictures don't settle the camera; --force writes it all the same", err=True
            )
        every = [str(p) for p in (*(written or ()), self.json, self.report) if p is not None]
        if every:
            typer.echo(f"written: {', '.join(every)}", err=True)
        elif not self.cameras:
            typer.echo(
                "nothing is written; add -o camera.yaml, --report report.html or --json calibration.json", err=True
            )
