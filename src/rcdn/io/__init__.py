"""Files in and out: pictures and videos, detections as JSON, corners.vnl. Everything public is here."""

from rcdn.io.files import check_writable, expand, is_video, write_bytes, write_text
from rcdn.io.formats import (
    FormatError,
    ImageResult,
    read_detections,
    write_detections,
)
from rcdn.io.images import as_grey, frames, read_image, write_image
from rcdn.io.vnl import read_vnl, read_vnl_boards, write_vnl

__all__ = [
    "FormatError",
    "ImageResult",
    "as_grey",
    "check_writable",
    "expand",
    "frames",
    "is_video",
    "read_detections",
    "read_image",
    "read_vnl",
    "read_vnl_boards",
    "write_bytes",
    "write_detections",
    "write_image",
    "write_text",
    "write_vnl",
]
