"""Photographs by the names that detections give them, for drawings: files, and frames of videos."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.types import Array


class Pictures:
    """`pictures(name)`: the grey picture of that name, or None if it can't be read any more. Frames of a video that are among `names` are
    read in one pass, at the first of them."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = frozenset(names)
        self._frames: dict[str, Array] = {}
        self._opened: set[str] = set()

    def __call__(self, name: str) -> Array | None:
        from rcdn.io import is_video, read_image

        video = name.rpartition("#")[0]
        try:
            if video and is_video(video):
                self._open(video)
                return self._frames.get(name)
            return read_image(name)
        except RcdnError:
            return None

    def _open(self, video: str) -> None:
        from rcdn.io import frames

        if video in self._opened:
            return
        self._opened.add(video)
        wanted = {n for n in self._names if n.startswith(f"{video}#")}
        for name, grey in frames(video):
            if name in wanted:
                self._frames[name] = grey
                wanted.discard(name)
            if not wanted:
                return
