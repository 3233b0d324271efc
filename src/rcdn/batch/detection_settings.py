"""Settings with which the boards of all inputs of a command are detected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rcdn.batch.cache import Cache
from rcdn.config import DetectorConfig

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered, Numbers


@dataclass(frozen=True)
class DetectionSettings:
    """Settings for detection; `store`: the cache, if any; `size`: (columns, rows) of the boards to use, or None for
    any."""

    config: DetectorConfig
    store: Cache | None
    jobs: int
    size: tuple[int, int] | None

    def gather(
        self,
        inputs: Sequence[str],
        numbers: Numbers | None = None,
        *,
        frames: int | None = None,
        behind: bool = False,
        silent: str | None = None,
    ) -> Gathered:
        """The boards in `inputs`; with `behind` also those whose codes are seen from behind. The rest as in
        `rcdn.batch.inputs.gather`, with its default of `frames`."""
        from rcdn.batch.behind import make_two_sided, two_sided
        from rcdn.batch.inputs import KEPT, gather
        from rcdn.batch.work import make_detector

        store, make = (two_sided(self.store), make_two_sided) if behind else (self.store, make_detector)
        return gather(
            inputs,
            self.config,
            jobs=self.jobs,
            cache=store,
            frames=KEPT if frames is None else frames,
            numbers=numbers,
            size=self.size,
            make=make,
            silent=silent,
        )
