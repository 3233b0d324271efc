"""One calibration session: evaluates frames by the guide, stores accepted ones, and finally writes the camera's
files."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.live.facts import moment_facts, progress_facts
from rcdn.live.folder import Folder, Settings
from rcdn.live.follow import Detect, Follower, yielding
from rcdn.live.frames import check_sides
from rcdn.live.guides import AnyGuide, OneCamera
from rcdn.live.sources import APART
from rcdn.types import Array, Board

NEAR = 6.0
"""px: largest median distance of the board detected at full size from the tracked one"""
AGAIN = 1.0
"""s: pause after a discarded picture before the next one is taken"""
SPACINGS = (0.0005, 2.0)
"""m: range of the side of a square that the page accepts"""


@dataclass(frozen=True)
class Written:
    """The result of writing the camera: `files`, and the verdict's `level` and `lines`."""

    files: tuple[Path, ...]
    level: str
    lines: tuple[str, ...]


Moment = tuple[Board | None, ...]
"""the board in each camera's picture of one moment, None where there is none or it isn't used"""
Sizes = tuple[tuple[int, int], ...]
"""(width, height) px of each camera's pictures"""
MakeGuide = Callable[[Any, float], Any]
"""creates a `Guide` for pictures of a size (width, height) px and squares of a side, m; for two cameras a `PairGuide`
for the sizes of both"""
Write = Callable[[Path, Sequence[str], Sequence[Any], Settings], Written]
"""writes the camera's files into a folder, given the names of the pictures and their boards; of two cameras those of
both, None where one isn't used"""


@dataclass(frozen=True)
class Tools:
    """The functions that a session uses: `make_guide`; `follow`, fast detection in reduced pictures; `detect`, accurate
    detection in full pictures; `write`."""

    make_guide: MakeGuide
    follow: Detect
    detect: Callable[[Array], Sequence[Board]]
    write: Write


class Session:
    """The state of a session with the cameras of its `folder`. `see` is called by one thread, in the order of
    frames; all other methods by any thread.

    `changed()` is called, by any thread, when `state()` has changed.
    """

    def __init__(
        self, folder: Folder, settings: Settings, tools: Tools, changed: Callable[[], None] = lambda: None
    ) -> None:
        self.folder, self.settings, self.changed = folder, settings, changed
        self._tools = tools
        self._followers = [Follower(tools.follow) for _ in range(folder.cameras)]
        self._slow = ThreadPoolExecutor(1, "calibration", initializer=yielding)
        self._lock = threading.RLock()
        self._guide: AnyGuide | None = None
        self._sizes: Sizes | None = None
        self._busy, self._trouble, self._written = "", "", None  # type: tuple[str, str, Written | None]
        self._views: list[str] = folder.names()
        self._worst: list[float | None] = []
        self._by_hand = self._done = False
        self._again = 0.0
        self.notice = ""
        """an additional message for the page, for example about the source"""
        if self._views:
            self._run("Taking up the session", self._resume)

    def close(self) -> None:
        """Stop all threads and unlock the folder."""
        for follower in self._followers:
            follower.close()
        self._slow.shutdown(wait=True, cancel_futures=True)
        self.folder.close()

    # ---- state for the page

    def state(self) -> dict[str, Any]:
        """The state, apart from the frames, as values for JSON."""
        with self._lock:
            guide, views, done = self._guide, list(self._views), self._written
            record = {
                "type": "state",
                "spacing": self.settings.spacing,
                "folder": str(self.folder.path),
                "cameras": self.folder.cameras,
                "size": self._sizes[0] if self._sizes and self.folder.cameras == 1 else self._sizes,
                "views": views,
                "busy": self._busy,
                "trouble": self._trouble or self.notice,
                "history": list(self._worst),
                "written": None
                if done is None
                else {"level": done.level, "lines": done.lines, "files": [p.name for p in done.files]},
            }
        return {**record, **progress_facts(None if guide is None else guide.progress)}

    # ---- requests of the page

    def begin(self, spacing: float) -> None:
        """Set the side of a square, m. Raises RcdnError if it is out of range, if pictures were taken with another one,
        or if one is being taken."""
        if not SPACINGS[0] <= spacing <= SPACINGS[1]:
            raise RcdnError(f"the side of a square must be {SPACINGS[0] * 1000:g} to {SPACINGS[1] * 1000:g} mm")
        with self._lock:
            if spacing != self.settings.spacing:
                if self._busy and self._guide is not None:
                    raise RcdnError("a picture is being taken; set the side of a square once that is done")
                self.settings = self.folder.agree(replace(self.settings, spacing=spacing))
                self._guide = None
        self.changed()

    def take(self) -> None:
        """Accept the next frame that the guide doesn't refuse."""
        self._by_hand = True

    def remove(self, name: str) -> None:
        """Remove an accepted picture. Raises RcdnError if there is none with that name."""
        with self._lock:
            if name not in self._views:
                raise RcdnError("there is no such picture")
            at = self._views.index(name)
            self._views.remove(name)
            del self._worst[at:]
            self._written = None
        self.folder.remove(name)
        self._run("Calculating", lambda: self._forget(name))

    def write(self) -> None:
        """Calibrate again, as `rcdn calibrate` does, and write the camera's files."""
        if not self._busy:
            self._run("Writing the camera", self._write)

    # ---- frames

    def see(self, greys: tuple[Array, ...], times: Sequence[float]) -> dict[str, Any]:
        """The guide's response to a frame (H, W) uint8 of each camera, taken at `times`, s, as values for JSON;
        accepted frames are stored, those of two cameras whose times differ by more than APART are refused.

        Raises ImageError for an unsupported size."""
        apart = max(times) - min(times)
        if apart > APART:
            why = f"The cameras' pictures are {apart * 1000:.0f} ms apart; at most {APART * 1000:.0f} ms are allowed"
            return moment_facts((None,) * len(greys), None, why)
        return moment_facts(*self._see(greys, times[0]))

    def _see(self, greys: tuple[Array, ...], at: float) -> tuple[Moment, Any, str]:
        """The boards of one moment and the guide's response, or None and the reason; an accepted moment is stored."""
        nothing = (None,) * len(greys)
        sizes = tuple((g.shape[1], g.shape[0]) for g in greys)
        for size in sizes:
            check_sides(*size)
        guide, refused = self._ready(sizes)
        if guide is None:
            return nothing, None, refused
        boards = tuple(f.see(g) for f, g in zip(self._followers, greys, strict=True))
        assessment = guide.look(boards, at, greys)
        used = tuple(b if u else None for b, u in zip(boards, assessment.used, strict=True))
        with self._lock:
            free = not self._busy and time.monotonic() >= self._again
            there = any(b is not None for b in used)
            if free and there and (assessment.take or (self._by_hand and not assessment.refused)):
                self._by_hand = False
                self._run("Taking the picture", lambda: self._accept([g.copy() for g in greys], used))
        return boards, assessment, ""

    def _ready(self, sizes: Sizes) -> tuple[AnyGuide | None, str]:
        """The guide for pictures of `sizes` (width, height), or None and the reason."""
        with self._lock:
            if self.settings.spacing is None:
                return None, "Say how long the side of a square is"
            if self._guide is not None and self._sizes == sizes:
                return self._guide, ""
            if self._views:
                if self._sizes is None or self._guide is None:
                    return None, "Taking up the session"
                now, there = (" and ".join(f"{w} × {h}" for w, h in s) for s in (sizes, self._sizes))
                gives = "camera gives" if len(sizes) == 1 else "cameras give"
                return None, f"The {gives} {now} px now, the pictures so far have {there}"
            self._sizes = sizes
            self._guide = self._made(sizes, self.settings.spacing)
        self.changed()
        return self._guide, ""

    def _made(self, sizes: Sizes, spacing: float) -> AnyGuide:
        if len(sizes) == 1:
            return OneCamera(self._tools.make_guide(sizes[0], spacing))
        guide: AnyGuide = self._tools.make_guide(sizes, spacing)
        return guide

    # ---- slow tasks, executed one after the other in a thread

    def _run(self, busy: str, work: Callable[[], None]) -> None:
        with self._lock:
            self._busy = busy
            self._slow.submit(self._guarded, busy, work)
        self.changed()

    def _guarded(self, busy: str, work: Callable[[], None]) -> None:
        trouble = ""
        try:
            self._set_busy(busy)
            work()
        except RcdnError as error:
            trouble = str(error)
        except Exception as error:  # one bad picture must not end the session
            trouble = f"{busy}: {type(error).__name__}: {error}"
        with self._lock:
            self._busy, self._trouble = "", trouble
            self._again = time.monotonic() + AGAIN * bool(trouble)
        self.changed()
        self._write_once_enough()

    def _set_busy(self, text: str) -> None:
        with self._lock:
            self._busy = text
        self.changed()

    def _resume(self) -> None:
        """Add the boards accepted earlier to the guide; unreadable ones are skipped and reported."""
        moments: dict[str, Moment] = {}
        lost, sizes = [], None
        for name in list(self._views):
            try:
                moments[name] = self.folder.moment(name)
                sizes = sizes or self.folder.sizes(name)
            except RcdnError as error:
                lost.append(f"{name}: {error}")
        guide = None if sizes is None else self._made(sizes, self.settings.spacing or 1.0)
        with self._lock:
            self._views, self._sizes, self._guide = list(moments), sizes, guide
        if guide is not None:
            progress = guide.add_all(moments)
            with self._lock:
                self._worst = [*[None] * (len(moments) - 1), _finite(progress.worst)]
                self._done = progress.done
        if lost:
            raise RcdnError("; ".join(lost))

    def _accept(self, greys: Sequence[Array], followed: Moment) -> None:
        """Detect the boards at full size, store them with their pictures, and add them to the guide."""
        boards = tuple(None if b is None else self._found(g, b) for g, b in zip(greys, followed, strict=True))
        name = self.folder.add_moment(greys, boards)
        with self._lock:
            self._views.append(name)
            self._written = None
        self._set_busy("Calculating")
        try:
            self._add(boards, name)
        except RcdnError:
            with self._lock:
                self._views.remove(name)
            self.folder.remove(name)
            raise

    def _found(self, grey: Array, followed: Board) -> Board:
        board = max(self._tools.detect(grey), key=len, default=None)
        if board is None or not _same(board, followed):
            raise RcdnError("That picture wasn't sharp enough; hold the board a little longer")
        return board

    def _add(self, boards: Moment, name: str) -> None:
        if self._guide is None:
            return
        progress = self._guide.add(boards, name)
        with self._lock:
            self._worst.append(_finite(progress.worst))
        self.changed()

    def _forget(self, name: str) -> None:
        if self._guide is None:
            return
        progress = self._guide.remove(name)
        with self._lock:
            missing = len(self._views) - len(self._worst)
            self._worst += [_finite(progress.worst)] * max(missing, 0)
            self._done = self._done and progress.done

    def _write_once_enough(self) -> None:
        """Write the camera automatically when the guide first reports that the pictures suffice."""
        with self._lock:
            guide = self._guide
            enough = guide is not None and guide.progress.done and not self._done and bool(self._views)
            self._done = self._done or enough
        if enough:
            self._run("Writing the camera", self._write)

    def _write(self) -> None:
        names = list(self._views)
        if not names:
            raise RcdnError("there is no picture yet")
        moments: list[Any] = [self.folder.moment(name) for name in names]
        boards = [m[0] for m in moments] if self.folder.cameras == 1 else moments
        # the guide has determined the board's size from a frame that showed the whole board
        size = self.settings.size or (None if self._guide is None else self._guide.size)
        written = self._tools.write(self.folder.path, names, boards, replace(self.settings, size=size))
        with self._lock:
            self._written = written


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _same(board: Board, followed: Board) -> bool:
    """Whether the board detected at full size is the tracked one: a similar number of corners at the same positions."""
    if len(board) < 0.8 * len(followed):
        return False
    apart = np.linalg.norm(board.xy[:, None] - followed.xy[None], axis=2).min(axis=0)
    return bool(np.median(apart) < NEAR)
