"""Boards as `rcdn detect --json` saves them."""

from rcdn.io import ImageResult, write_detections
from rcdn.types import Corners


def save(path, boards, name="{:02d}.png"):
    """A file of detections with one picture for each board, called `name` with its number; gives its path."""
    images = [
        ImageResult(name.format(k), *b.image_size, Corners(b.xy, b.response, b.status, sigma=b.sigma), (b,))
        for k, b in enumerate(boards)
    ]
    write_detections(path, images, ())
    return path
