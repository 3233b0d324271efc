"""The outputs of `rcdn calibrate`: their options, checked before the computation."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.camera_files import a_file_a_camera, check_format, pair_files
from rcdn.batch.paths import check_file
from rcdn.batch.writing import print_unwritten, write_each
from rcdn.errors import ConfigError, FormatError
from rcdn.terminal import console
from rcdn.terminal.options import camera_formats, parse_camera_format

if TYPE_CHECKING:
    from rcdn.io import CameraFormat
    from rcdn.types import Calibration


class FailOn(StrEnum):
    """Verdicts that `--fail-on` may treat as failures; `good` is never one."""

    fair = "fair"
    unsure = "unsure"
    bad = "bad"


CameraFiles = Annotated[
    list[Path] | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Write the camera; may be given several times. By the name: .yaml (OpenCV; camera_info.yaml: ROS, "
        "camchain.yaml: Kalibr), cameras.txt (COLMAP), .cameramodel (mrcal), .json; .npz: maps that undistort, for "
        "cv2.remap. With --rig: camchain.yaml, .toml (aniposelib; camera_array.toml: caliscope), rig_config.json "
        "(COLMAP), .json, and .yaml or camera_info.yaml, a file a camera.",
    ),
]
CameraFileFormat = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="FORMAT",
        parser=parse_camera_format,
        autocompletion=camera_formats,
        help="Format of --output, where the name doesn't tell: opencv, ros, kalibr, colmap, mrcal or json.",
    ),
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
    typer.Option(
        "--force",
        help="Write the camera even if the views don't settle its focal length or centre; a focal length that is known "
        "to less than 20 % is an error all the same.",
    ),
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
    """The files to write. `refused`: the user asked for a further file that can't be written."""

    cameras: list[Path]
    format: CameraFormat | None
    report: Path | None
    json: Path | None
    force: bool = False
    pictures: Sequence[Path] = ()
    refused: bool = False

    def check(self, inputs: Sequence[str | Path], rig: bool = False, stereo: bool = False) -> None:
        """Raise before the computation the errors that would prevent writing afterwards; `rig`, `stereo`: check camera
        files as those of a rig or a pair."""
        paths = [Path(i) for i in inputs]
        for name, given, needed, option in (
            ("--format", self.format is not None, self.cameras, "--output"),
            ("--pictures", bool(self.pictures), self.report, "--report"),
        ):
            if given and not needed:
                raise ConfigError(f"{name} has no effect without {option}; leave it out, or add {option} FILE")
        for path in self.cameras:
            if path == console.STDOUT and self.format is None:
                raise ConfigError(
                    f"--output -: standard output; name its format, --format {' | '.join(camera_formats())}"
                )
            try:
                check_format(path, self.format, rig)
            except FormatError as error:
                raise ConfigError(str(error)) from None
            files = pair_files(path, self.format) if stereo else [path]
            if path == console.STDOUT and (len(files) > 1 or (rig and a_file_a_camera(path, self.format))):
                raise ConfigError("--output -: this format has a file for each camera; name the file")
            for file in files:
                check_file("--output", file, paths)
        check_file("--report", self.report, paths)
        check_file("--json", self.json, paths)
        for name, count in Counter("-" if p == console.STDOUT else os.path.abspath(p) for p in self.files).items():
            if count > 1:
                raise ConfigError(f"{name}: named for {count} outputs; give each a name of its own")

    def check_rig_files(self, names: Sequence[str], inputs: Sequence[Path]) -> None:
        """Raise ConfigError if a file of a rig, written with a camera's name added to that of `cameras`, would
        overwrite an input."""
        from rcdn.io import rig_paths

        for path in self.cameras:
            for file in rig_paths(path, names, self.format):
                check_file("--output", file, inputs)

    def without_refused(self, refusal: Callable[[Path], str]) -> Outputs:
        """These outputs without the camera files whose format can't represent the cameras; each is reported now, before
        the computation.

        `refusal(path)` returns the reason, or "". Raises FormatError if nothing is left to write.
        """
        refused = {p: r for p in self.cameras if (r := refusal(p))}
        left = replace(self, cameras=[p for p in self.cameras if p not in refused], refused=bool(refused))
        if refused and not left.files:
            raise FormatError("; ".join(f"{path} can't be written: {reason}" for path, reason in refused.items()))
        for path, reason in refused.items():
            print_unwritten(path, reason)
        return left

    @property
    def files(self) -> list[Path]:
        """All files to write."""
        return [*self.cameras, *(p for p in (self.json, self.report) if p is not None)]

    def kept(self, *calibrations: Calibration) -> bool:
        """Whether camera files are written: with `force`, or if the views determine every one of the `calibrations`."""
        from rcdn.calibration.observability import undetermined

        return self.force or not any(undetermined(c) for c in calibrations)

    def write(
        self,
        kept: bool,
        camera: Callable[[Path], Sequence[Path]],
        json: Callable[[Path], object],
        report: Callable[[Path], object],
    ) -> bool:
        """Write each file by its function, the camera files only if `kept`, and report what was and was not written.
        `camera` returns the files it wrote: in some formats there is one for each camera.

        Returns True if every requested file was written.
        """
        cameras, files = self.cameras if kept else [], dict[Path, Sequence[Path]]()

        def write_cameras(path: Path) -> None:
            files[path] = camera(path)

        tasks = [*((path, write_cameras) for path in cameras), (self.json, json), (self.report, report)]
        written = write_each(tasks)
        if self.cameras and not kept:
            lost = ", ".join(str(p) for p in self.cameras)
            typer.echo(
                f"not written: {lost}: these pictures don't settle the camera; --force writes it all the same", err=True
            )
        if written:
            console.note_written(file for path in written for file in files.get(path, [path]))
        elif not self.files:
            console.note("nothing is written; add -o camera.yaml, --report report.html or --json calibration.json")
        return len(written) == len(self.files) and not self.refused
