"""Cameras with known lenses (`rcdn calibrate --camera`): which input each camera of the files belongs to."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rcdn.batch.camera_files import cameras_of, chosen_camera
from rcdn.errors import ConfigError, FormatError
from rcdn.terminal import console

if TYPE_CHECKING:
    from rcdn.types import Camera

KnownCameras = Annotated[
    list[Path] | None,
    typer.Option(
        "--camera",
        metavar="FILE",
        help="With --rig or --stereo: a camera whose lens is known and held; the other lenses are solved for. A "
        "camera's file (left.yaml, or one with `camera_name: left`, is that of the input left; NAME=FILE says it), a "
        "file of several cameras or of a rig (NAME=FILE#cam1 takes one of them), or a folder with a file a camera; may "
        "be given several times. With --stereo left and right are names, too, and of two files with other names the "
        "first is the left camera's.",
    ),
]


def known_cameras(files: Sequence[Path], names: Sequence[str]) -> dict[str, Camera]:
    """The known cameras by the `names` of the inputs.

    A file with one camera belongs to the input that its `camera_name` says, else to that with the file's name without
    ending (`NAME=FILE`: to NAME); the cameras of a file with several have the names given in it (`NAME=FILE#CAMERA`:
    one of them, for NAME). If the only file has as many cameras as there are inputs, and none of their names is an
    input's, they are assigned in order. Raises ConfigError for names that don't match, or for a camera that is given
    twice; FormatError as `read_cameras`.
    """
    return _assigned(files, [_cameras(*_given(file), names) for file in files], names)


def known_pair(files: Sequence[Path], names: Sequence[str]) -> tuple[Camera | None, Camera | None]:
    """The left and the right camera whose lens is known, None where it isn't.

    They are named as the inputs, `names`, else left and right; two files of one camera each that have other names are
    taken in their order. Raises as `known_cameras`.
    """
    from rcdn.types.calibration import SIDES

    each = [_cameras(*_given(file), names, SIDES) for file in files]
    found = {name for cameras in each for name in cameras}
    if not found <= set(names) and found <= set(SIDES):
        names = SIDES
    elif not found & {*names, *SIDES} and [len(c) for c in each] == [1, 1] and not any(_given(f)[0] for f in files):
        console.note(f"note: {files[0]} is taken for the left camera, {files[1]} for the right one")
        one, two = each
        return next(iter(one.values())), next(iter(two.values()))
    known = _assigned(files, each, names)
    left, right = (known.get(name) for name in names)
    return left, right


def _assigned(
    files: Sequence[Path], cameras: Sequence[Mapping[str, Camera]], names: Sequence[str]
) -> dict[str, Camera]:
    """The `cameras` of each of the `files` by the `names` of the inputs, as `known_cameras`."""
    found: dict[str, Camera] = {}
    for (_, file, _), each in zip(map(_given, files), cameras, strict=True):
        for name, camera in each.items():
            if name in found:
                raise ConfigError(f"--camera {file}: the camera {name} is given twice; leave one of the files away")
            found[name] = camera
    if len(files) == 1 and len(found) == len(names) and not set(found) & set(names):
        console.note(f"note: the cameras of {files[0]} are taken for {', '.join(names)}, in this order")
        return dict(zip(names, found.values(), strict=True))
    if unknown := [name for name in found if name not in names]:
        raise ConfigError(
            f"--camera: {', '.join(unknown)} {'is no input' if len(unknown) == 1 else 'are no inputs'}; the inputs are "
            f"{', '.join(names)}: name files, or the cameras in them, as the folders or videos, or give NAME=FILE"
        )
    return found


def camera_paths(files: Sequence[Path]) -> list[Path]:
    """The paths of `files` without their NAME= and #CAMERA, and those of the files in folders."""
    paths = [path for _, path, _ in map(_given, files)]
    return [*paths, *(p for path in paths if path.is_dir() for p in path.iterdir())]


def _given(file: Path) -> tuple[str, Path, str]:
    """(NAME, FILE, CAMERA) of `NAME=FILE#CAMERA`, each "" where it isn't given; a `file` that exists is FILE itself."""
    name, sign, rest = str(file).partition("=")
    if not sign or os.path.exists(file):
        name, rest = "", str(file)
    path, sign, camera = rest.rpartition("#")
    if not sign or os.path.exists(rest):
        path, camera = rest, ""
    return name, Path(path), camera


def _cameras(name: str, path: Path, camera: str, *expected: Sequence[str]) -> Mapping[str, Camera]:
    """The cameras of a file or a folder, by name: all, or only the one that is called `camera` in the file. `expected`:
    sets of names that inputs have, the likelier ones first."""
    if path.is_dir():
        return _of_folder(name, path, *expected)
    if camera:
        return {name or camera: chosen_camera(path, camera, "--camera")}
    several = cameras_of(path, name or None)
    if not name:
        return several if len(several) > 1 else {_own_name(path, *expected): next(iter(several.values()))}
    if len(several) > 1:
        if name not in several:
            raise ConfigError(
                f"--camera {name}={path}: the file holds the cameras {', '.join(several)}, not {name}; say which one "
                f"it is: {name}={path}#{next(iter(several))}"
            )
        return {name: several[name]}
    return {name: next(iter(several.values()))}


def _of_folder(name: str, folder: Path, *expected: Sequence[str]) -> Mapping[str, Camera]:
    """The camera of each file in a folder."""
    if name:
        raise ConfigError(f"--camera {name}={folder}: is a folder; give the file of that camera")
    files = sorted(p for p in folder.iterdir() if p.is_file() and not p.name.startswith("."))
    found: dict[str, Camera] = {}
    for path in files:
        try:
            several = cameras_of(path)
        except FormatError:
            continue  # the folder may contain other files, too: extrinsics, notes
        if len(several) == 1:
            own = _own_name(path, *expected)
            if own in found:
                raise ConfigError(f"--camera {path}: the camera {own} is given twice in this folder; give its file")
            found[own] = next(iter(several.values()))
    if not found:
        raise ConfigError(f"--camera {folder}: no file in it holds one camera; give a file a camera, such as left.yaml")
    return found


def _own_name(path: Path, *expected: Sequence[str]) -> str:
    """The name of the only camera of a file: of the name in the file and the one derived from the file's name the one
    that is expected, or is likelier, else the one in the file; a note says if they are those of different inputs."""
    inside, outside = (_first_expected(names, expected) for names in (_names_inside(path), [_stem(path)]))
    if inside is None or outside is None:
        return (inside or outside or (0, 0, _stem(path)))[2]
    (_, place, name), (_, other, _) = sorted([inside, outside], key=lambda found: found[0])
    if place != other:
        console.note(
            f"note: {path} holds the camera {inside[2]} by its `camera_name`, {outside[2]} by the file's name; it is "
            f"taken for {name} (NAME={path} says it)"
        )
    return name


def _first_expected(names: Sequence[str], expected: Sequence[Sequence[str]]) -> tuple[int, int, str] | None:
    """(number of the set, place in it, name) of the first of `names` in the first set that has one."""
    found = ((k, each.index(name), name) for k, each in enumerate(expected) for name in names if name in each)
    return next(found, None)


def _names_inside(path: Path) -> list[str]:
    """The name that a file gives its only camera, and shorter ones: `narrow_stereo/left` is `left`, too."""
    from rcdn.io.cameras import name_in

    if path.suffix.lower() not in (".yaml", ".yml", ".xml") or not (name := name_in(path)):
        return []
    last = name.rstrip("/").rpartition("/")[2]
    return [*dict.fromkeys((name, last, _bare(last)))]


def _stem(path: Path) -> str:
    """The camera's name derived from a file name: `left` from left.yaml, left_camera_info.yaml or
    camera_info_left.yaml."""
    return _bare(path.stem)


def _bare(name: str) -> str:
    """A name without the words that say what a file holds."""
    for part in ("camera_info", "camera", "intrinsics", "calibration"):
        if len(rest := name.replace(part, "").strip("_-. ")) and part in name:
            return rest
    return name
