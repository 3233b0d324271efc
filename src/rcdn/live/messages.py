"""Messages from the page on the socket: frames as bytes, requests as JSON. Any other message ends the connection."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast, get_args

from rcdn.errors import RcdnError

HEADER = struct.Struct("<Id")
"""header of a frame: its number, and its time, ms of the page's clock; a JPEG follows"""
PAIR = struct.Struct("<dI")
"""second header of a frame of two cameras: the time of the right one's, ms, and the bytes of the left one's JPEG; both
JPEGs follow"""
PREVIEW = struct.Struct("<I")
"""header of a frame that the server sends: its number; a JPEG follows, for two cameras the bytes of the left one's JPEG
in the same form, and both"""
MOST_TEXT = 500
"""largest number of characters of a request"""
Wish = Literal["begin", "take", "remove", "write", "shown"]


@dataclass(frozen=True)
class Frame:
    """The frame of each camera from the page: `number`, `times` of the page's clock, s, and JPEGs."""

    number: int
    times: tuple[float, ...]
    data: tuple[bytes, ...]


@dataclass(frozen=True)
class Wanted:
    """A request from the page: to `begin` with a `value` (side of a square, m), to `take` a picture, to `remove` the
    picture `name`, to `write` the camera; or the confirmation that the preview number `value` was `shown`."""

    wish: Wish
    name: str = ""
    value: float = 0.0


def frame_of(message: bytes, cameras: int = 1) -> Frame:
    """Parse the frame of one camera or of two. Raises RcdnError for a message that is too short, whose time isn't
    finite, or that doesn't have the length that it says."""
    (number, left), rest = _header(HEADER, message)
    if cameras == 1:
        return Frame(number, (left / 1000,), (rest,))
    (right, length), pictures = _header(PAIR, rest)
    if not 0 < length < len(pictures):
        raise RcdnError("a frame's length is wrong")
    return Frame(number, (left / 1000, right / 1000), (pictures[:length], pictures[length:]))


def _header(form: struct.Struct, message: bytes) -> tuple[tuple[Any, ...], bytes]:
    """The values of a header, and what follows it."""
    if len(message) <= form.size:
        raise RcdnError("a frame is too short")
    values = form.unpack_from(message)
    if not all(map(math.isfinite, values)):
        raise RcdnError("a frame's time is no number")
    return values, message[form.size :]


def preview_of(number: int, pictures: Sequence[bytes]) -> bytes:
    """The message with the preview (JPEG) of each camera."""
    lengths = b"".join(PREVIEW.pack(len(p)) for p in pictures[:-1])
    return PREVIEW.pack(number) + lengths + b"".join(pictures)


def wish_of(text: str) -> Wanted:
    """Parse a request. Raises RcdnError for anything but a well-formed request."""
    if len(text) > MOST_TEXT:
        raise RcdnError("a message is too long")
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RcdnError("a message is no JSON") from error
    if not isinstance(record, dict) or record.get("wish") not in get_args(Wish):
        raise RcdnError("a message is unknown")
    name, value = record.get("name", ""), record.get("value", 0.0)
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12  # excludes NaN, too
    if not isinstance(name, str) or not number or set(record) - {"wish", "name", "value"}:
        raise RcdnError("a message is malformed")
    return Wanted(cast(Wish, record["wish"]), name, float(value))
