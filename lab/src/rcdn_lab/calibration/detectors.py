"""The detectors compared: our presets and variants of them, and the peers; each has an identity that covers everything
its results depend on."""

from __future__ import annotations

import hashlib
import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from rcdn import __version__
from rcdn.config import DetectorConfig, Sharpen
from rcdn.detector import Detector
from rcdn.errors import ConfigError, RcdnError
from rcdn.io import read_image
from rcdn.types import Array
from rcdn_lab.peers import PEERS, Find, Grid, Peer, base, quiet

OURS = {
    "auto": DetectorConfig.auto(threads=1),
    "paper": DetectorConfig.paper(threads=1),
    "auto-fit": DetectorConfig.auto(threads=1, sharpen=Sharpen(geometry=False)),
    "auto-first": DetectorConfig.auto(threads=1, sharpen=None),
}
"""`auto-fit`: without the refinement by the smoothness of the board; `auto-first`: with the first refinement only"""
DETECTORS = ("auto", "paper", "opencv", "opencv-sb", "boofcv-size")


class Store(Protocol):
    """Results of one detector, kept between runs."""

    def key(self, content: str, *more: object) -> str:
        """The name of an entry."""

    def get(self, key: str) -> Any:
        """The value stored under `key`, or None."""

    def put(self, key: str, value: Any) -> None:
        """Store `value`, made of plain types."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a detector for one picture of `image_size` (width, height): its `grids`; `error`: the message of an
    exception, or ""."""

    image_size: tuple[int, int]
    grids: tuple[Grid, ...]
    error: str = ""


@dataclass(frozen=True, eq=False)
class Contestant:
    """A detector by `name`, made by `load` when first needed; `store` keeps its results; `version`; `sized`: it is
    given the board's size."""

    name: str
    load: Callable[[], Find]
    store: Store
    version: str
    sized: bool = False

    @cached_property
    def _find(self) -> Find:
        with quiet():
            return self.load()

    def result(self, path: Path, content: str, size: tuple[int, int]) -> Answer:
        """The result for the picture at `path` with checksum `content`, from the store if it is there."""
        key = self.store.key(content, "grids", *(size if self.sized else ()))
        if (kept := _unpack(self.store.get(key))) is not None:
            return kept
        answer = self._detect(read_image(path), size)
        if not answer.error:
            self.store.put(key, _pack(answer))
        return answer

    def _detect(self, image: Array, size: tuple[int, int]) -> Answer:
        shape = (image.shape[1], image.shape[0])
        find = self._find
        try:
            with quiet():
                return Answer(shape, tuple(find(image, size)))
        except Exception as error:  # any exception is reported in the detector's row, and the others continue
            return Answer(shape, (), f"{type(error).__name__}: {error}")


PARTS = ("peers", "boards", "corners")
"""folders with the code of the peers implemented here"""


def contestants(
    names: Sequence[str], identify: Callable[[DetectorConfig], str], open_store: Callable[[str], Store]
) -> tuple[list[Contestant], dict[str, str]]:
    """Those of `names` that can run here, and for each of the others the reason why it cannot.

    `identify`: a checksum of everything except the picture that determines our detector's result; `open_store`: a store
    whose entries are separated by the checksum that it is given. Raises ConfigError for an unknown name.
    """
    known = [*OURS, *(p.name for p in PEERS.values() if not p.raw and p.board is None)]
    unknown = sorted(set(names) - set(known))
    if unknown:
        raise ConfigError(f"--detectors: nothing is called {', '.join(unknown)}; known: {', '.join(known)}")
    found, missing = [], {}
    for name in dict.fromkeys(names):
        if name in OURS:
            found.append(Contestant(name, _ours(OURS[name]), open_store(identify(OURS[name])), __version__))
        elif reason := PEERS[name].missing():
            missing[name] = reason
        else:
            peer = PEERS[name]
            found.append(
                Contestant(name, _theirs(peer), open_store(_identity(peer)), peer.version(), peer.size == "given")
            )
    return found, missing


def _ours(config: DetectorConfig) -> Callable[[], Find]:
    def load() -> Find:
        detector = Detector(config)
        return lambda image, _size: [Grid(b.xy, b.ij, b.sigma) for b in detector.boards(image)]

    return load


def _theirs(peer: Peer) -> Callable[[], Find]:
    def load() -> Find:
        find = peer.load()
        return lambda image, size: find(np.clip(np.rint(image), 0, 255).astype(np.uint8), size)  # peers read 8 bits

    return load


def _identity(peer: Peer) -> str:
    """Checksum of a peer's name and version, of its code or of the code that calls it, and of the code that reads
    pictures."""
    code = [inspect.getsource(m) for m in (sys.modules[peer.load.__module__], base, sys.modules[read_image.__module__])]
    if peer.version() == __version__:  # implemented in this package
        folders = [Path(sys.modules["rcdn"].__path__[0]) / part for part in PARTS]
        code += [path.read_text() for folder in folders for path in sorted(folder.glob("*.py"))]
    return hashlib.sha256("\n".join([peer.name, peer.version(), *code]).encode()).hexdigest()


# ---- conversion of answers to plain values and back


def _pack(answer: Answer) -> dict[str, Any]:
    plain = lambda a: None if a is None else a.tolist()  # noqa: E731
    grids = [{"xy": plain(g.xy), "ij": plain(g.ij), "sigma": plain(g.sigma)} for g in answer.grids]
    return {"image_size": list(answer.image_size), "grids": grids}


def _unpack(record: Any) -> Answer | None:
    if record is None:
        return None
    try:
        array = lambda v, kind: None if v is None else np.array(v, kind)  # noqa: E731
        grids = tuple(
            Grid(np.array(g["xy"], float).reshape(-1, 2), array(g["ij"], int), array(g["sigma"], float))
            for g in record["grids"]
        )
        width, height = record["image_size"]
    except (KeyError, TypeError, ValueError, RcdnError):
        return None
    return Answer((int(width), int(height)), grids)
