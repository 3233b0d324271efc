"""Access to photographs by the names used in detections, for drawings: picture files and frames of videos."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.types import Array


class Pictures:
    """`pictures(name)`: the grey picture of that name, or None if it can't be read any more. All frames of a video that
    are among `names` are read in one pass, when the first of them is requested.

    `folders`: for names from a file of saved detections, the folder of that file. Its author could name any picture on
    this machine, which would then appear in a report that is passed on. Therefore only pictures in that folder, or in
    one of the places (folders or files) that the user `named`, are read; links are resolved first. `left_out`: a
    sentence on the others, or "".
    """

    def __init__(
        self, names: Iterable[str], folders: Mapping[str, Path] | None = None, named: Sequence[Path] = ()
    ) -> None:
        self._names = frozenset(names)
        self._named = [os.path.realpath(p) for p in named]
        self._barred = {n for n in self._names & (folders or {}).keys() if not self._inside(n, (folders or {})[n])}
        self._frames: dict[str, Array] = {}
        self._opened: set[str] = set()
        self.left_out = ""
        if self._barred:
            self.left_out = (
                f"{len(self._barred)} of {len(self._names)} photographs lie outside the folder of the file that names "
                "them and are left out; --pictures FOLDER shows them."
            )

    def __call__(self, name: str) -> Array | None:
        from rcdn.io.images import read_named_image

        if name in self._barred:
            return None
        try:
            if video := _video_of(name):
                self._open(video)
                return self._frames.get(name)
            return read_named_image(name)
        except RcdnError:
            return None

    def _inside(self, name: str, folder: Path) -> bool:
        try:
            place = Path(os.path.realpath(_video_of(name) or name))
            return any(place.is_relative_to(root) for root in (os.path.realpath(folder), *self._named))
        except (OSError, ValueError):  # not a valid path
            return False

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


def _video_of(name: str) -> str:
    """The path of the video in a frame's name, or "" if `name` isn't that of a frame."""
    from rcdn.io import is_video

    video = name.rpartition("#")[0]
    return video if video and is_video(video) else ""
