"""What the page may say on the socket: frames as bytes, wishes as JSON. Anything else ends the connection."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from typing import Literal, cast, get_args

from rcdn.errors import RcdnError

HEADER = struct.Struct("<Id")
"""of a frame: its number, and when it was taken, ms of the page's clock; then a JPEG"""
PREVIEW = struct.Struct("<I")
"""of a frame that the server sends: its number; then a JPEG"""
MOST_TEXT = 500
"""characters of a wish"""
Wish = Literal["begin", "take", "remove", "write", "shown"]


@dataclass(frozen=True)
class Frame:
    """A frame that the page sends: `number`, `time` s of its clock, and a JPEG."""

    number: int
    time: float
    data: bytes


@dataclass(frozen=True)
class Wanted:
    """A wish of the page: to `begin` with a `value` (side of a square, m), to `take` a picture, to `remove` the one `name`d, to `write` the camera;
    or a word that the preview with the number `value` was `shown`."""

    wish: Wish
    name: str = ""
    value: float = 0.0


def frame_of(message: bytes) -> Frame:
    """Raises RcdnError for what is too short, or has a time that is none."""
    if len(message) <= HEADER.size:
        raise RcdnError("a frame is too short")
    number, time = HEADER.unpack_from(message)
    if not math.isfinite(time):
        raise RcdnError("a frame's time is no number")
    return Frame(number, time / 1000, message[HEADER.size :])


def wish_of(text: str) -> Wanted:
    """Raises RcdnError for anything but a wish of the known form."""
    if len(text) > MOST_TEXT:
        raise RcdnError("a message is too long")
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RcdnError("a message is no JSON") from error
    if not isinstance(record, dict) or record.get("wish") not in get_args(Wish):
        raise RcdnError("a message is unknown")
    name, value = record.get("name", ""), record.get("value", 0.0)
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e12  # NaN, too, is not
    if not isinstance(name, str) or not number or set(record) - {"wish", "name", "value"}:
        raise RcdnError("a message is malformed")
    return Wanted(cast(Wish, record["wish"]), name, float(value))
