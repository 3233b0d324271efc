"""`rcdn convert` for rigs: recognizing inputs that contain a rig, and writing it in another format."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import ConfigError, FormatError
from rcdn.terminal import console

if TYPE_CHECKING:
    from rcdn.io import CameraFormat, StereoCameras


def holds_rig(inputs: Sequence[Path], out: Path) -> bool:
    """Whether the inputs of `rcdn convert` are a rig: judged by the file names, by the number of files, or by a file
    that contains a rig or at least three cameras."""
    files = len(inputs) > 2 and all(path.suffix.lower() in (".yaml", ".yml") for path in inputs)
    if files or any(_named_rig(path) for path in (*inputs, out)) or _template(inputs):
        return True
    if len(inputs) > 1:
        return any(_has_transforms(path) for path in inputs) or _of_one_rig(inputs)
    from rcdn.io.cameras import camera_names, is_rig

    return is_rig(inputs[0]) or len(camera_names(inputs[0])) > 2


def _named_rig(path: Path) -> bool:
    return path.suffix.lower() == ".toml" or (path.suffix.lower() == ".json" and "rig_config" in path.stem.lower())


def _template(inputs: Sequence[Path]) -> bool:
    """Whether the only input is a name given to `rcdn calibrate --rig -o`, for which one file per camera was
    written."""
    from rcdn.io.rig_folder import siblings

    return len(inputs) == 1 and bool(siblings(inputs[0]))


def files_of_pair(inputs: Sequence[Path]) -> Sequence[Path]:
    """`inputs`; for the name given to `rcdn calibrate --stereo -o`, the files of the left and the right camera."""
    from rcdn.io.rig_files import pair_of_files
    from rcdn.io.rig_folder import siblings

    files = siblings(inputs[0]) if len(inputs) == 1 else []
    return inputs if pair_of_files(files) is None else files


def named_pair(path: Path) -> tuple[StereoCameras, Sequence[str]]:
    """The two cameras of a file in any format that holds a pair or a rig of two, or of the name given to `rcdn
    calibrate -o` that two files were written under; and their names. Raises FormatError if there are no two."""
    from rcdn.io import StereoCameras, read_rig, read_stereo
    from rcdn.io.cameras import camera_names
    from rcdn.io.rig_files import pair_of_files

    if pair := pair_of_files(files_of_pair([path])):
        return pair, ("left", "right")
    with suppress(FormatError):
        return read_stereo(path), camera_names(path)
    rig = read_rig(path)
    if len(rig) != 2:
        raise FormatError(f"{path}: a rectification is of two cameras, and it holds {len(rig)}: {', '.join(rig.names)}")
    (left, right), (first, second) = rig.cameras, rig.names
    return StereoCameras(left, right, rig.relative(first, second)[0]), rig.names


def _of_one_rig(inputs: Sequence[Path]) -> bool:
    """Whether each file is OpenCV's of one camera of a rig."""
    from rcdn.errors import RcdnError
    from rcdn.io import read_rig
    from rcdn.io.rig_files import pair_of_files

    try:
        return pair_of_files(inputs) is None and len(read_rig(*inputs)) == len(inputs)
    except RcdnError:
        return False


def _has_transforms(path: Path) -> bool:
    from rcdn.io.rig_folder import TRANSFORMS

    return path.stem.endswith(f"_{TRANSFORMS}")


def convert_rig(inputs: Sequence[Path], out: Path, format: CameraFormat | None, lossy: bool) -> list[Path]:
    """Write the rig in `inputs` to `out`, and print what that format can't represent. Returns the files."""
    from rcdn.batch.camera_files import a_file_a_camera, check_exact, check_format, write_rig_files
    from rcdn.io import read_calibrations, read_rig, rig_format
    from rcdn.io.rig_files import lens_fits

    check_format(out, format, rig=True)
    kind = rig_format(out, format)
    with or_one_camera(inputs):
        rig = read_rig(*inputs)
    if out == console.STDOUT and a_file_a_camera(out, format):
        raise ConfigError(f"a rig is a file a camera in {kind}; name OUT, to which the cameras' names are added")
    for name, fit in zip(rig.names, lens_fits(out, rig, format), strict=True):
        if not lossy:
            check_exact(out, f"the lens of camera {name}", fit)
    files = write_rig_files(out, rig, format)
    if rig.covariance is not None and kind != "json":
        console.note(f"{out}: holds no covariance of the cameras' places; json does")
    if _rectified(inputs):
        console.note(f"{out}: holds no rectification, which a rig has no place for; opencv, ros and json of a pair do")
    if inputs[0].exists() and read_calibrations(inputs[0]):
        console.note(f"{out}: holds the cameras; views, deviations and the verdict are in {inputs[0]} only")
    return files


@contextmanager
def or_one_camera(inputs: Sequence[Path]) -> Iterator[None]:
    """Errors that arise within tell that a camera of the only file can be chosen, if it holds several."""
    from rcdn.io.cameras import camera_names

    try:
        yield
    except FormatError as error:
        names = []
        with suppress(FormatError):
            names = camera_names(inputs[0]) if len(inputs) == 1 else []
        if len(names) < 2:
            raise
        raise FormatError(f"{error}; or choose one of its cameras: --camera-name {' | '.join(names)}") from error


def _rectified(inputs: Sequence[Path]) -> bool:
    """Whether the inputs are those of a pair with a rectification."""
    from rcdn.errors import RcdnError
    from rcdn.io import read_stereo
    from rcdn.io.rig_files import pair_of_files

    try:
        pair = read_stereo(inputs[0]) if len(inputs) == 1 else pair_of_files(inputs)
    except RcdnError:
        return False
    return pair is not None and pair.rectification is not None
