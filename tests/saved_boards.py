"""Boards as `rcdn detect --json` saves them."""

from rcdn.io import ImageResult, write_detections
from rcdn.types import Corners


def save(path, boards):
    """A file of detections with one picture for each board; gives its path."""
    images = [
        ImageResult(f"{k:02d}.png", *b.image_size, Corners(b.xy, b.response, b.status, sigma=b.sigma), (b,))
        for k, b in enumerate(boards)
    ]
    write_detections(path, images, ())
    return path
