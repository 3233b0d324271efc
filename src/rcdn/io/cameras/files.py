"""Reading and writing camera files of any format."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from rcdn.errors import FormatError, RcdnError, said_of, shown
from rcdn.io.cameras import ours
from rcdn.io.cameras.base import Format, LensFit
from rcdn.io.cameras.formats import FORMATS, CameraFormat, camera_format, load, no_pair, text_of
from rcdn.io.cameras.rig import StereoCameras
from rcdn.io.fields import located, read_text
from rcdn.io.files import check_writable, write_text
from rcdn.types import Camera, StereoCalibration
from rcdn.types.ranges import is_rigid

UNNAMED = "camera"
"""the `camera_name` in a ROS file of one camera"""


def write_camera(
    path: str | Path, camera: Camera, format: CameraFormat | None = None, fit: LensFit | None = None
) -> LensFit | None:
    """Write a camera in the format of `camera_format(path, format)`, whole or not at all.

    All digits are kept. A camera with a `correction` is represented exactly in json only; to other formats `fit`
    (default: the result of `lens_fit`) is written, which is also returned and added to the file as a comment. Returns
    None if the file represents the camera exactly. Raises FormatError if the format can't hold the lens model, listing
    those that can; OutputError as `write_text`.
    """
    kind, fit = FORMATS[camera_format(path, format)], lens_fit(path, camera, format) if fit is None else fit
    write_text(path, noted(kind.head, text_of(kind, camera if fit is None else fit.held), _texts([fit])))
    return fit


def check_lens(path: str | Path, camera: Camera, format: CameraFormat | None = None, stereo: bool = False) -> None:
    """Raise FormatError if the format of `camera_format(path, format)` can't hold a camera with this lens model, or
    (`stereo`) a pair of cameras."""
    kind = FORMATS[camera_format(path, format)]
    if stereo and kind.stereo_texts is None:
        raise no_pair(kind.title, "write")
    text_of(kind, camera)


def lens_fit(path: str | Path, camera: Camera, format: CameraFormat | None = None) -> LensFit | None:
    """The approximation of a camera with a `correction` in the format of `camera_format(path, format)`: the best fit of
    the format's lens models (mrcal: of its splined stereographic model) over the frame, and its error; None if the
    format represents the camera exactly.

    Raises FormatError if no lens model of the format can approximate the camera.
    """
    kind = FORMATS[camera_format(path, format)]
    if camera.correction is None or kind.fit is None:
        return None
    try:
        return kind.fit(camera)
    except RcdnError as error:
        raise FormatError(f"{kind.title}: {error}; write json") from error


def _texts(fits: Sequence[LensFit | None]) -> list[str]:
    return [fit.text for fit in fits if fit is not None]


def noted(head: str, text: str, notes: Iterable[str | None]) -> str:
    """The text of a file with `notes` inserted as comments after its `head`."""
    lines = [f"# {note}\n" for note in dict.fromkeys(notes)]
    return text.replace(head, head + "".join(lines), 1) if lines else text


def read_camera(path: str | Path, format: CameraFormat | None = None, name: str | None = None) -> Camera:
    """Read a camera; the format is recognised from the contents of the file, unless it is given.

    `name`: the camera to read from a file with several (`cam1`; `left`; COLMAP's number). A distortion of zeros is read
    as a pinhole. Raises FormatError, naming the file, the field and the fix, if the file contains no camera, several
    cameras and no `name` is given, or the camera has a lens model that rcdn doesn't support.
    """
    found, data = load(path, format)
    kind = FORMATS[found]
    parts = {} if name is None or kind.parts is None else kind.parts(data)
    cameras = kind.cameras(parts.get(name or "", data), str(path))
    if name is None and len(cameras) == 1:
        return next(iter(cameras.values()))
    if name not in cameras:
        raise FormatError(
            f"{path}: holds the cameras {', '.join(cameras)}; name one of them"
            + (f", not {shown(name)}" if name else "")
        )
    return cameras[name]


def is_rig(path: str | Path) -> bool:
    """Whether a file is rcdn's or COLMAP's JSON of a rig. Raises FormatError as `read_cameras` if it can't be read."""
    text = read_text(path).lstrip()
    if text.startswith("["):
        return True
    return text.startswith("{") and "lensmodel" not in text[:2000] and ours.load(str(path), text).get("kind") == "rig"


def read_cameras(path: str | Path, format: CameraFormat | None = None) -> dict[str, Camera]:
    """All cameras of a file by name, in its order; see `read_camera`. In formats for a single camera its name is
    `camera`."""
    found, data = load(path, format)
    return FORMATS[found].cameras(data, str(path))


def camera_names(path: str | Path) -> list[str]:
    """The names of the cameras of a file, as `read_cameras` has them, also of those that can't be read. Raises
    FormatError as `read_cameras` for a file of one camera or a pair."""
    found, data = load(path, None)
    kind = FORMATS[found]
    return [*((kind.parts and kind.parts(data)) or kind.cameras(data, str(path)))]


def name_in(path: str | Path) -> str:
    """The name that a file of one camera gives it (`camera_name`, of ROS and of rigs as OpenCV's YAML); "" if it gives
    none, or rcdn's `camera`, which names none. Raises FormatError as `read_cameras`."""
    _, data = load(path, None)
    name = str(data.get("camera_name") or "") if isinstance(data, dict) else ""
    return "" if name == UNNAMED else name


def stereo_paths(path: str | Path, format: CameraFormat | None = None) -> list[Path]:
    """The files that `write_stereo` writes: `path`, or, for ROS and mrcal, `path` with _left and _right."""
    target = Path(path)
    if FORMATS[camera_format(path, format)].pair_files == 1:
        return [target]
    return [target.with_stem(f"{target.stem}_{side}") for side in ("left", "right")]


def write_stereo(
    path: str | Path, pair: StereoCameras | StereoCalibration, format: CameraFormat | None = None
) -> list[Path]:
    """Write two cameras and their relative pose; returns the files, those of `stereo_paths`.

    The lens models may differ. Raises FormatError for COLMAP, whose cameras.txt can't hold a pose, and as
    `write_camera`, naming the camera that the format can't hold.
    """
    kind = FORMATS[camera_format(path, format)]
    if kind.stereo_texts is None:
        raise no_pair(kind.title, "write")
    found = StereoCameras.of(pair)
    left, right = (_side(path, kind, side, format) for side in (("left", found.left), ("right", found.right)))
    fits = [left[1], right[1]]
    texts, files = kind.stereo_texts(replace(found, left=left[0], right=right[0])), stereo_paths(path, format)
    for file in files:
        check_writable(file)
    for file, text, of in zip(files, texts, [fits] if len(texts) == 1 else [fits[:1], fits[1:]], strict=True):
        write_text(file, noted(kind.head, text, _texts(of)))
    return files


def _side(
    path: str | Path, kind: Format, side: tuple[str, Camera], format: CameraFormat | None
) -> tuple[Camera, LensFit | None]:
    """The representation of one camera of a pair in the file, and its `lens_fit`. `side`: (name, camera). Raises
    FormatError, naming the side, if the format can't hold it."""
    name, camera = side
    with said_of(f"{name} camera", FormatError):
        fit = lens_fit(path, camera, format)
        held = camera if fit is None else fit.held
        text_of(kind, held, of_pair=True)
    return held, fit


def read_stereo(left: str | Path, right: str | Path | None = None, format: CameraFormat | None = None) -> StereoCameras:
    """Read two cameras and their relative pose, from one file (OpenCV, Kalibr, JSON) or from those of the `left` and
    the `right` camera (ROS, mrcal).

    The two files of OpenCV's stereo sample, intrinsics.yml and extrinsics.yml, are also accepted. The rectification is
    None if the file has none (Kalibr, mrcal). Raises FormatError, naming the file, the field and the fix.
    """
    paths = [left] if right is None else [left, right]
    found = [load(path, format) for path in paths]
    kinds = {kind for kind, _ in found} if format is None else {format}
    if len(kinds) > 1:
        raise FormatError(
            f"{left} and {right}: one is {found[0][0]}, the other {found[1][0]}; give two files of one format"
        )
    kind = FORMATS[kinds.pop()]
    if kind.stereo is None:
        raise no_pair(f"{left}: {kind.title}", "give")
    with located(str(left)):
        pair = kind.stereo([(data, str(path)) for (_, data), path in zip(found, paths, strict=True)])
    if not is_rigid(pair.T_right_left):
        raise FormatError(f"{left}: the pose of the right camera is no rotation and translation; export it again")
    return pair
