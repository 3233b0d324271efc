"""Detection of boards that are seen from behind, with their codes mirrored."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import Any

from rcdn.batch.cache import Cache, file_digest
from rcdn.batch.work import make_detector
from rcdn.config import DetectorConfig


class TwoSided:
    """A detector that also identifies the corners of boards whose codes appear mirrored, as boards seen from behind."""

    def __init__(self, detector: Any) -> None:
        self._detector = detector

    def detect(self, image: Any) -> Any:
        """The detections of `image`; if the detector warns of `mirrored` codes, boards without a target are replaced by
        those found in the mirror image."""
        from rcdn.calibration.behind import from_behind
        from rcdn.types.limits import READ_IN_A_MIRROR

        found = self._detector.detect(image)
        mirrored = [w for w in found.warnings if w.startswith(READ_IN_A_MIRROR)]
        if not mirrored:
            return found
        behind = from_behind(self._detector.detect(image[:, ::-1].copy()).boards)
        front = [board for board in found.boards if board.target is not None]
        rest = tuple(w for w in found.warnings if w not in mirrored)
        return replace(found, boards=[*front, *behind], warnings=rest) if behind else found


def make_two_sided(config: DetectorConfig) -> TwoSided:
    """Like `make_detector`; a module-level function, so that worker processes can import it by name."""
    return TwoSided(make_detector(config))


def two_sided(cache: Cache | None) -> Cache | None:
    """The same cache folder, with a salt of its own for the detections of `TwoSided` detectors."""
    if cache is None:
        return None
    from rcdn.calibration import behind

    code = " ".join(map(file_digest, (__file__, behind.__file__)))
    return replace(cache, salt=hashlib.sha256(f"{cache.salt} {code}".encode()).hexdigest())
