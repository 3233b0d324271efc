"""The readers compared: ours, without a target or with it, and others, which are given the complete target. Each is
made once per process."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.errors import ConfigError
from rcdn.types import Array, Target
from rcdn_lab.coded.score import Count, TrueBoard, score
from rcdn_lab.peers import quiet
from rcdn_lab.peers.coded import CODED_PEERS, Labelled, Read

OURS, GIVEN = "rcdn", "rcdn told"
_loaded: dict[str, Read] = {}


def contestants(peers: Sequence[str] = ("auto",)) -> tuple[list[str], dict[str, str]]:
    """Names of the other readers that can run here, and for each of the rest the reason why it cannot.

    `peers`: names, `auto` for all, `none` or nothing for none. Raises ConfigError for an unknown name.
    """
    wanted = list(CODED_PEERS) if "auto" in peers else [name for name in peers if name != "none"]
    if unknown := sorted(set(wanted) - set(CODED_PEERS)):
        raise ConfigError(
            f"--peers: no reader is called {', '.join(unknown)}; known: auto, none, {', '.join(CODED_PEERS)}"
        )
    reasons = {name: CODED_PEERS[name].missing() for name in dict.fromkeys(wanted)}
    return [n for n, why in reasons.items() if why is None], {n: why for n, why in reasons.items() if why is not None}


def load(names: Sequence[str]) -> None:
    """Make the readers of this process."""
    _loaded.clear()
    with quiet():
        ours = {OURS: _ours, GIVEN: _given}
        _loaded.update({name: (ours[name] if _is_ours(name) else CODED_PEERS[name].load)() for name in names})


def _is_ours(name: str) -> bool:
    return name in (OURS, GIVEN)


def _ours() -> Read:
    detector = Detector(DetectorConfig(target="auto", threads=1))
    return lambda image, _target: labelled(detector, image)


def _given() -> Read:
    @lru_cache
    def detector(target: Target) -> Detector:
        return Detector(DetectorConfig(target=target, threads=1))

    return lambda image, target: labelled(detector(target), image)


def labelled(detector: Detector, image: Array) -> list[Labelled]:
    """The boards of a picture whose codes were read."""
    return [Labelled(b.ids, b.xy, b.target) for b in detector.boards(image) if b.ids is not None]


def read(name: str, image: Array, target: Target) -> list[Labelled]:
    """Result of a reader of this process for a picture; it is given the target, unless it is `OURS`."""
    with quiet():
        return _loaded[name](image, target)


def can_read(name: str, target: Target) -> bool:
    """Whether a reader supports such a target."""
    return _is_ours(name) or CODED_PEERS[name].reads(target)


def judged(name: str, image: Array, boards: Sequence[TrueBoard]) -> Count:
    """A reader's score on one picture. Readers that need the target are run for each of its boards in turn, and scored
    on that one alone."""
    count: Callable[[Sequence[TrueBoard]], Count] = lambda some: score(  # noqa: E731
        read(name, image, some[0].target), some
    )
    try:
        if name == OURS:
            return count(boards)
        parts = [count([board]) for board in boards]
        return sum(parts, Count()) + Count(pictures=1 - len(parts))
    except Exception:  # any exception is counted, and the others continue
        return score([], boards) + Count(failed=1)
