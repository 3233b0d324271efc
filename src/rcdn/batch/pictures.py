"""Access to photographs by the names used in detections, for drawings: picture files and frames of videos."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence, Set
from pathlib import Path
from typing import TYPE_CHECKING

from rcdn.batch.moved_pictures import found_in
from rcdn.errors import RcdnError

if TYPE_CHECKING:
    from rcdn.types import Array


class Pictures:
    """`pictures(name)`: the grey picture of that name, or None if it can't be read any more. All frames of a video that
    are among `names` are read in one pass, when the first of them is requested.

    `folders`: for names from a file of saved detections, the folder of that file. Its author could name any picture on
    this machine, which would then appear in a report that is passed on. Therefore only pictures in that folder, or in
    one of the places (folders or files) that the user `named`, are read; links are resolved first. Those that aren't
    where their names say are searched in the `named` places (`found_in`; `others`: names of other cameras' pictures).
    `left_out`: a sentence on those that aren't shown, or "".
    """

    def __init__(
        self,
        names: Iterable[str],
        folders: Mapping[str, Path] | None = None,
        named: Sequence[Path] = (),
        others: Iterable[str] = (),
    ) -> None:
        names, folders = frozenset(names), folders or {}
        self._named = [os.path.realpath(p) for p in named]
        barred = {n for n in names & folders.keys() if not self._inside(n, folders[n])}
        self._places = {name: name for name in names - barred}
        self._frames: dict[str, Array] = {}
        self._opened: set[str] = set()
        self.left_out = ""
        if named:
            self._search(
                {n for n in names & folders.keys() if n in barred or not _exists(n)}, named, others, len(names)
            )
        elif barred:
            self.left_out = (
                f"{len(barred)} of {len(names)} photographs lie outside the folder of the file that names "
                "them and are left out; --pictures FOLDER shows them."
            )

    def __call__(self, name: str) -> Array | None:
        from rcdn.io.images import read_named_image

        if (place := self._places.get(name)) is None:
            return None
        try:
            if video := _video_of(place):
                self._open(video)
                return self._frames.get(place)
            return read_named_image(place)
        except RcdnError:
            return None

    def _inside(self, name: str, folder: Path) -> bool:
        try:
            place = Path(os.path.realpath(_video_of(name) or name))
            return any(place.is_relative_to(root) for root in (os.path.realpath(folder), *self._named))
        except (OSError, ValueError):  # not a valid path
            return False

    def _search(self, lost: Set[str], named: Sequence[Path], others: Iterable[str], count: int) -> None:
        """Find the pictures of the names `lost` in the places `named`, and say which of `count` aren't there."""
        files = {name: _video_of(name) or name for name in lost}
        rivals = {_video_of(name) or name for name in others if name not in lost and not _exists(name)}
        found, several = found_in(named, {*files.values()}, rivals)
        self._places |= {n: found[file] + n.removeprefix(file) for n, file in files.items() if file in found}
        if missing := [file for file in files.values() if file not in found]:
            many = sum(file in several for file in missing)
            self.left_out = (
                f"{len(missing)} of {count} photographs are left out: neither by path nor by name are they in "
                f"{', '.join(map(str, named))}"
                + (f", or there more than once ({many}): name the folder of the right ones." if many else ".")
            )

    def _open(self, video: str) -> None:
        from rcdn.io import frames

        if video in self._opened:
            return
        self._opened.add(video)
        wanted = {n for n in self._places.values() if n.startswith(f"{video}#")}
        for name, grey in frames(video):
            if name in wanted:
                self._frames[name] = grey
                wanted.discard(name)
            if not wanted:
                return


def _exists(name: str) -> bool:
    try:
        return os.path.exists(_video_of(name) or name)
    except ValueError:  # not a valid path
        return False


def _video_of(name: str) -> str:
    """The path of the video in a frame's name, or "" if `name` isn't that of a frame."""
    from rcdn.io import is_video

    video = name.rpartition("#")[0]
    return video if video and is_video(video) else ""
