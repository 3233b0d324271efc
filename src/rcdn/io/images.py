"""Pictures and videos as grey arrays, converted in the same way from files and from arrays (docs/conventions.md,
"Grey")."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np

from rcdn.errors import ImageError, OutputError, many
from rcdn.io.containers import cut_short
from rcdn.io.decode import decode
from rcdn.io.fields import check_path
from rcdn.io.files import is_special, is_video, write_bytes
from rcdn.io.headers import known
from rcdn.io.marks import Mark, marked
from rcdn.io.quiet import quiet_opencv
from rcdn.limits import check_size, most_bytes, too_many_bytes
from rcdn.types import Array
from rcdn.types.ranges import SIDE

_STRETCH = (0.1, 99.9)
_STRETCH_SAMPLES = 1 << 22
MOST_VALUES = 1 << 31  # of an array, over all channels
_LARGEST = 1e30  # sums and differences of larger floats could overflow
_HEAD = 32  # bytes that determine the format
_BAGS = (".bag", ".db3", ".mcap")
_GREY_MODES = ("1", "L", "I", "F", "I;16", "I;16L", "I;16B", "I;16N")  # of PIL
_PIECE = 1 << 24  # bytes read at once
RATE, RATES = 30.0, (0.001, 1000.0)
"""frames a second of a video whose file states no rate within these limits"""
_DECODE = "cv2.imdecode(np.frombuffer({}, np.uint8), cv2.IMREAD_UNCHANGED)"
_FIRST = f"decode it first: {_DECODE.format('data')}"
_TO_ARRAY = {
    "bytes": _FIRST,
    "bytearray": _FIRST,
    "memoryview": _FIRST,
    "UMat": "copy it from the device first: umat.get()",
    "list": "give one picture a call, or np.asarray of rows of pixels",
    "tuple": "give one picture a call; cv2.VideoCapture.read returns (whether there is one, the picture)",
}
"""what to do with an object of another type, by its name"""


def read_image(path: str | Path) -> Array:
    """Read a picture file as grey (H, W): uint8 from 8-bit files, else float32 in 0..255.

    Pixels are returned as stored: EXIF orientation is ignored. Colour → Rec. 601 luma; alpha is dropped, not
    composited; of several pages the first is read. Files with more than 8 bits are converted as their array by
    `as_grey`: 16 bits are stretched. A pipe is read to its end.

    Raises ImageError, naming the path and the fix, if the file doesn't exist, is a folder, may not be read, is empty,
    truncated (a JPEG without its end marker, or a PNG without its last chunk), not a picture, damaged (as far as that
    can be detected: docs/decisions/0025-damaged-pictures.md), or over 250 megapixels (or the limit set by the
    environment variable RCDN_MAX_MEGAPIXELS).
    """
    return as_grey(decode(_read_bytes(path), path), str(path))


def read_pixels(path: str | Path) -> Array:
    """The pixels of a picture file as stored: (H, W) or (H, W, 3) BGR, of any depth; alpha is dropped. Otherwise as
    `read_image`."""
    return _channels(decode(_read_bytes(path), path), str(path))


def read_named_image(path: str | Path) -> Array:
    """`read_image` for a name given in a file. Raises ImageError for a pipe or a device, too, which could block or
    never end."""
    if is_special(path):
        raise ImageError(f"{path}: a pipe or a device, not a file; check the name")
    return read_image(path)


def as_grey(image: Any, name: str = "image") -> Array:
    """An image array as grey (H, W): uint8, or float32 in 0..255. `name` is its name in error messages.

    `image`: (H, W), (H, W, 1), (H, W, 3) BGR or (H, W, 4) BGRA, as from cv2.imread; colour → Rec. 601 luma, alpha is
    dropped. By dtype: uint8 is unchanged (without a copy if possible); bool → 0 and 255; uint16 is stretched; floats
    within [0, 1] are scaled by 255, within [0, 255] unchanged, else stretched; other integers within 0..255 become
    uint8, else are stretched. Stretching maps the 0.1 % and 99.9 % percentiles linearly to 0 and 255 and clips; a
    constant image becomes zeros. Above 4 million pixels the percentiles are computed from a regular subset. Raises
    ImageError for None, objects that aren't arrays, wrong shapes and dtypes, empty arrays, NaN and infinities.
    """
    grey = _luma(_plain_dtype(_channels(image, name), name))
    if grey.dtype == np.uint8:
        return grey
    if grey.dtype == np.float32:
        low, high = float(grey.min()), float(grey.max())
        if low >= 0 and high <= 1:
            return grey * np.float32(255)
        if low >= 0 and high <= 255:
            return grey
    return _stretch(grey)


def grey_of(image: Any) -> Array:
    """A picture in any form as grey (H, W): `read_image` of a path; `as_grey` of an array with BGR colours, or of a PIL
    image of any mode with RGB colours. Raises ImageError as these functions do."""
    if isinstance(image, str | os.PathLike):
        return read_image(Path(image))
    return as_grey(_of_pil(image) if _is_pil(image) else image)


def _is_pil(image: Any) -> bool:
    """Whether `image` is a PIL image, decided without importing PIL."""
    return isinstance(getattr(image, "mode", None), str) and callable(getattr(image, "convert", None))


def _of_pil(image: Any) -> Array:
    """The pixels of a PIL image in the layout of `as_grey`: RGB becomes BGR; palette, CMYK and similar modes are first
    converted to RGB; alpha is dropped."""
    try:
        if image.mode in _GREY_MODES:
            return np.asarray(image)
        return np.asarray(image if image.mode in ("RGB", "RGBA", "RGBX") else image.convert("RGB"))[:, :, 2::-1]
    except (OSError, ValueError, SyntaxError) as error:  # PIL decodes the file only now
        raise ImageError(f"image: PIL can't decode it ({error}); save it again") from error


def frames(path: str | Path) -> Iterator[tuple[str, Array]]:
    """The pictures in a file, as (name, grey): a picture itself, or every frame of a video (`clip.mp4#000012`).

    Frames are numbered from 0, and returned as stored (not rotated by the video's orientation). Raises ImageError as
    `read_image` does, if a video can't be opened or contains no frame, and, in place of the last frame, if the file was
    cut short (AVI, MP4 and MOV state their length).
    """
    if not is_video(path):
        yield str(path), read_image(path)
        return
    for name, frame in colour_frames(path):
        yield name, as_grey(frame, name)


def colour_frames(path: str | Path) -> Iterator[tuple[str, Array]]:
    """Every frame of a video as (name, frame), like `frames`, but as (H, W, 3) BGR uint8."""
    _open_check(path)
    if not Path(path).is_file():
        raise ImageError(f"{path}: a pipe or device, and videos are read from files only; save it as a file")
    video, cut, count = _video(str(path)), cut_short(path), 0
    frame = next(video, None)
    while frame is not None:
        following = next(video, None)
        if cut and following is None:  # a part of `frame` is missing
            raise ImageError(f"{path}: the file was cut short after {many(count, 'whole frame')}; copy it again")
        yield f"{path}#{count:06d}", frame
        frame, count = following, count + 1
    if count == 0:
        fix = "the file was cut short; copy it again" if cut else "convert it to MP4 (H.264) or AVI (MJPEG)"
        raise ImageError(f"{path}: the video can't be opened or holds no frame; {fix}")


def frame_rate(path: str | Path) -> float:
    """Frames a second of a video as its file states them; `RATE` if it states none that a camera may have had."""
    with quiet_opencv():
        video = cv2.VideoCapture(str(path))
        rate = float(video.get(cv2.CAP_PROP_FPS))
        video.release()
    return rate if RATES[0] <= rate <= RATES[1] else RATE


def _video(path: str) -> Iterator[Array]:
    with quiet_opencv():
        video = cv2.VideoCapture(path)
    try:
        check_size(path, *(int(video.get(side)) for side in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)))
        video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        while video.isOpened():
            with quiet_opencv():
                there, frame = video.read()
            if not there:
                return
            yield frame
    finally:
        video.release()


def write_image(path: str | Path, image: Array, mark: Mark | None = None) -> None:
    """Write an image (H, W) or (H, W, 3) BGR, uint8 or uint16 (TIFF: float32, too), in the format of the path's ending;
    whole or not at all.

    `mark`: a text in its metadata (`rcdn.io.marks`), so that it isn't taken for a photograph later. Raises OutputError
    if the ending isn't that of a picture format, the array can't be encoded, or the file can't be written.
    """
    kinds = [np.uint8, np.uint16] + [np.float32] * (Path(path).suffix.lower() in (".tif", ".tiff"))
    if image.dtype not in kinds or image.size == 0:
        raise OutputError(f"{path}: image must be uint8 or uint16 and not empty, not {image.dtype} {image.shape}")
    try:
        done, data = cv2.imencode(Path(path).suffix, image)
    except cv2.error as error:
        raise OutputError(f"{path}: can't be encoded ({error.err}); use the ending .png or .jpg") from error
    if not done:
        raise OutputError(f"{path}: can't be encoded; use the ending .png")
    encoded = data.tobytes()
    write_bytes(path, encoded if mark is None else marked(encoded, mark))


def _no_picture(path: str | Path) -> str:
    """The message for a file that doesn't begin like a picture."""
    if Path(path).suffix.lower() in _BAGS:
        return "a bag of ROS, by its ending, is not read; write the pictures of its topic to a folder first"
    return "not a picture that can be read, or a damaged one; convert it to PNG or JPEG"


def _read_bytes(path: str | Path) -> bytes:
    """The bytes of a picture from a file or a pipe, up to the limit on a picture's size."""
    _open_check(path)
    try:
        with Path(path).open("rb") as file:
            head = file.read(_HEAD)
            if not head:
                raise ImageError(f"{path}: the file is empty; copy or record it again")
            if not known(head):
                raise ImageError(f"{path}: {_no_picture(path)}")
            return _rest(file, head, str(path))
    except PermissionError as error:
        raise ImageError(f"{path}: may not be read; check its permissions") from error
    except OSError as error:
        raise ImageError(f"{path}: can't be read ({error.strerror or error}); check the file and its disk") from error


def _rest(file: BinaryIO, head: bytes, name: str) -> bytes:
    most = most_bytes()
    if os.fstat(file.fileno()).st_size > most:
        raise too_many_bytes(name)
    pieces, size = [head], len(head)
    while piece := file.read(_PIECE):  # the amount of data in a pipe isn't known in advance
        pieces.append(piece)
        size += len(piece)
        if size > most:
            raise too_many_bytes(name)
    return b"".join(pieces)


def _open_check(path: str | Path) -> None:
    check_path(path, ImageError)
    try:
        there, folder = Path(path).exists(), Path(path).is_dir()
    except (OSError, ValueError) as error:  # a folder without access, a name with a null byte
        raise ImageError(f"{path}: can't be read ({error}); check the path and its permissions") from error
    if not there:
        raise ImageError(f"{path}: no such file; check the path")
    if folder:
        raise ImageError(f"{path}: is a folder; name a picture in it")


def _channels(image: Any, name: str) -> Array:
    """`image` as (H, W) or (H, W, 3). Raises ImageError if it isn't a valid image."""
    if image is None:
        raise ImageError(f"{name} is None: cv2.imread returns None when it cannot read the file; check the path")
    if isinstance(image, str | Path):
        raise ImageError(f"{name} is a path; read it first, with rcdn.read_image")
    if not isinstance(image, np.ndarray):
        kind = type(image).__name__
        how = _TO_ARRAY.get(kind, "convert it, e.g. with np.asarray")
        if hasattr(image, "read"):  # an open file
            how = f"read it: {_DECODE.format('image.read()')}, or PIL.Image.open(image)"
        raise ImageError(f"{name} must be a numpy array, not {kind}; {how}")
    if np.ma.is_masked(image):
        raise ImageError(f"{name} has masked pixels; fill them first, e.g. with image.filled(0)")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] not in (3, 4)):
        wanted = "(H, W), (H, W, 1), (H, W, 3) BGR or (H, W, 4) BGRA"
        raise ImageError(f"{name} has shape {image.shape}; it must be {wanted}")
    if image.size == 0:
        raise ImageError(f"{name} is empty: its shape is {image.shape}; it needs at least one pixel")
    if max(image.shape[:2]) > SIDE or image.size > MOST_VALUES:
        raise ImageError(
            f"{name} has shape {image.shape}: its sides can be {SIDE} px at most, and it can hold {MOST_VALUES} values"
        )
    return np.asarray(image[:, :, :3] if image.ndim == 3 else image)


def _plain_dtype(image: Array, name: str) -> Array:
    """`image` as uint8, uint16 or finite float32, contiguous, values unchanged (except True → 255)."""
    kind = image.dtype.kind
    if kind not in "buif":
        raise ImageError(f"{name} has dtype {image.dtype}; it must be uint8, uint16, another integer, float or bool")
    image = np.require(image, requirements="A")
    if kind == "b":
        return image.astype(np.uint8) * np.uint8(255)
    if kind == "f":
        with np.errstate(over="ignore"):  # values too large for float32 become infinite, and are reported as such
            image = np.ascontiguousarray(image, dtype=np.float32)
        if bad := int(image.size - (np.abs(image) <= _LARGEST).sum()):
            raise ImageError(
                f"{name} holds {bad} values that are NaN, infinite or beyond {_LARGEST:g}; "
                "replace them, e.g. with np.nan_to_num(image, posinf=0, neginf=0)"
            )
        return image
    if image.dtype.itemsize <= 2 and kind == "u":
        return np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("="))
    small = image.min() >= 0 and image.max() <= 255
    return np.ascontiguousarray(image, dtype=np.uint8 if small else np.float32)


def _luma(image: Array) -> Array:
    """Grey (H, W) by Rec. 601: 0.299 R + 0.587 G + 0.114 B, of the same dtype."""
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _stretch(grey: Array) -> Array:
    step = max(1, int(np.ceil(np.sqrt(grey.size / _STRETCH_SAMPLES))))
    low, high = (float(v) for v in np.percentile(grey[::step, ::step], _STRETCH))
    if high <= low:  # nearly all pixels are equal: use the full range
        low, high = float(grey.min()), float(grey.max())
    span = np.float32(high - low)
    if span <= 0:
        return np.zeros(grey.shape, np.float32)
    out = grey.astype(np.float32)
    with np.errstate(over="ignore"):  # the range may be tiny: overflows are clipped
        out -= np.float32(low)
        out /= span
        out *= np.float32(255)
    return np.clip(out, 0, 255, out=out)
