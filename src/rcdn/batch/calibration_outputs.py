"""What `rcdn calibrate` writes: its options, checked before the work."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.camera_files import check_format
from rcdn.batch.paths import check_file
from rcdn.batch.writing import say_unwritten, write_each
from rcdn.errors import ConfigError, FormatError
from rcdn.terminal import talk

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
        "Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json; .npz: maps that undistort, for cv2.remap. "
        "With --rig: camchain.yaml, .toml (aniposelib; camera_array.toml: caliscope), rig_config.json (COLMAP), .json, "
        "and .yaml or camera_info.yaml, a file a camera.",
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
    typer.Option(
        metavar="FILE",
        help="Write everything: camera, deviations, poses, residuals of each corner; - is standard output.",
    ),
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
    """What to write, and where. `refused`: something more was asked for that can't be written."""

    cameras: list[Path]
    format: CameraFormat | None
    report: Path | None
    json: Path | None
    force: bool = False
    pictures: Sequence[Path] = ()
    refused: bool = False

    def check(self, inputs: Sequence[str | Path], rig: bool = False) -> None:
        """Raise before the work what would spoil it afterwards; `rig`: of the files of many cameras."""
        paths = [Path(i) for i in inputs]
        for path in self.cameras:
            try:
                check_format(path, self.format, rig)
            except FormatError as error:
                raise ConfigError(str(error)) from None
            check_file("--output", path, paths)
        check_file("--report", self.report, paths)
        check_file("--json", self.json, paths)
        for name, count in Counter(os.path.abspath(p) for p in self.files).items():
            if count > 1:
                raise ConfigError(f"{name}: named for {count} outputs; give each a name of its own")

    def without_refused(self, refusal: Callable[[Path], str]) -> Outputs:
        """What is left without the files of which `refusal` says why they can't hold the cameras to come: they are told now, before the work.

        Raises FormatError if nothing is left.
        """
        refused = {p: r for p in self.cameras if (r := refusal(p))}
        left = replace(self, cameras=[p for p in self.cameras if p not in refused], refused=bool(refused))
        if refused and not left.files:
            raise FormatError("; ".join(f"{path} can't be written: {reason}" for path, reason in refused.items()))
        for path, reason in refused.items():
            say_unwritten(path, reason)
        return left

    @property
    def files(self) -> list[Path]:
        """All files that are asked for."""
        return [*self.cameras, *(p for p in (self.json, self.report) if p is not None)]

    def kept(self, *calibrations: Calibration) -> bool:
        """Whether cameras are written: what the views of `calibrations` don't settle is written only by force."""
        from rcdn.calibration.observability import unsettled

        return self.force or not any(unsettled(c) for c in calibrations)

    def write(
        self,
        kept: bool,
        camera: Callable[[Path], object],
        json: Callable[[Path], object],
        report: Callable[[Path], object],
    ) -> bool:
        """Write what is asked for, each file by its function, the cameras only if they are `kept`; say what was written and what not.

        True if all was.
        """
        cameras = self.cameras if kept else []
        tasks = [*((path, camera) for path in cameras), (self.json, json), (self.report, report)]
        written = write_each(tasks)
        if self.cameras and not kept:
            lost = ", ".join(str(p) for p in self.cameras)
            typer.echo(
                f"not written: {lost}: these pictures don't settle the camera; --force writes it all the same", err=True
            )
        if written:
            talk.say_written(written)
        elif not self.files:
            talk.note("nothing is written; add -o camera.yaml, --report report.html or --json calibration.json")
        return len(written) == len(self.files) and not self.refused
