"""Selection of the photographs of a folder that are timed: a fixed choice, independent of where the folder is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, FormatError
from rcdn.io import expand, is_video, read_image
from rcdn.types import Array
from rcdn_lab.detections import judged
from rcdn_lab.peers import Grid

EACH, EMPTY = 2, 20
"""pictures of each set with boards, and of each set without boards"""
Size = tuple[int, int]


@dataclass(frozen=True, eq=False)
class Photograph:
    """One picture (H, W) uint8 of a set. `board`: the size (columns, rows) given to detectors that need it.

    `corners` (N, 2) px: those of its one board of that size, row by row if `ordered`; (0, 2): it shows no board; None:
    unknown, or boards of several sizes.
    """

    set: str
    file: str
    image: Array
    board: Size
    corners: Array | None = None
    ordered: bool = False

    @property
    def megapixels(self) -> float:
        """Pixels / 10⁶."""
        return self.image.size / 1e6

    @property
    def is_empty(self) -> bool:
        """Whether it is known to show no board."""
        return self.corners is not None and not len(self.corners)

    def is_whole(self, grids: Sequence[Grid]) -> bool | None:
        """Whether its board is among the `grids` with all corners, no others and correct labels; None if it has no
        board or the truth is unknown."""
        if self.corners is None or self.is_empty:
            return None
        columns = self.board[0] if self.ordered else 0
        return any(g.ij is not None and judged(g.xy, g.ij, self.corners, columns)[1] for g in grids)


def chosen(folder: Path, default_size: Size) -> list[Photograph]:
    """Of each set listed in `truth.json` (docs/formats.md) in `folder`, the first and the middle one of the pictures
    with known truth, by name; of a set without boards 20, evenly spaced. Without that file, all pictures of the folder,
    as one set without known truth.

    `default_size`: the board size given to detectors where there is no board, or no single size. Raises ConfigError if
    no picture remains, FormatError for an invalid `truth.json`.
    """
    if not folder.is_dir():
        raise ConfigError(f"--photographs {folder}: no folder")
    truth = folder / "truth.json"
    out = _listed(folder, truth, default_size) if truth.is_file() else _unknown(folder, default_size)
    if not out:
        raise ConfigError(f"--photographs {folder}: no pictures there")
    return out


def _unknown(folder: Path, default_size: Size) -> list[Photograph]:
    paths = [path for path in expand([folder])[0] if not is_video(path)]
    return [Photograph(folder.resolve().name, path.name, _read(path), default_size) for path in paths]


def _listed(folder: Path, truth: Path, default_size: Size) -> list[Photograph]:
    try:
        sets = json.loads(truth.read_text())
        return [
            _photograph(folder, name, file, record, default_size)
            for name, record in sorted(sets.items())
            for file in _files(record)
        ]
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{truth}: not a file of truth as `rcdn render` writes it: {error!r}") from error


def _files(record: dict[str, Any]) -> list[str]:
    """The selected files of a set."""
    known = sorted(file for file, image in record["images"].items() if image["xy"] is not None)
    empty = not any(record["images"][file]["xy"] for file in known)
    count = min(len(known), EMPTY if empty else EACH)
    return [known[k * len(known) // count] for k in range(count)]


def _photograph(folder: Path, name: str, file: str, record: dict[str, Any], default_size: Size) -> Photograph:
    known = record["images"][file]
    board = default_size if record["board"] is None else (int(record["board"][0]), int(record["board"][1]))
    one = record["board"] is not None or not known["xy"]
    corners = np.array(known["xy"], float).reshape(-1, 2) if one else None
    return Photograph(name, file, _read(folder / name / file), board, corners, bool(known.get("ordered")))


def _read(path: Path) -> Array:
    image = read_image(path)
    return image if image.dtype == np.uint8 else np.clip(np.rint(image), 0, 255).astype(np.uint8)
