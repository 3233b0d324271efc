"""The guide of one camera with the interface of that of two: boards and frames of a moment are one for each camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rcdn.calibration.guidance import Guide, Look
from rcdn.types import Array


class AnyGuide(Protocol):
    """`rcdn.calibration.guidance.PairGuide`, or `OneCamera`."""

    @property
    def progress(self) -> Any: ...
    @property
    def size(self) -> tuple[int, int] | None: ...
    def look(self, boards: Any, time: float, greys: Sequence[Array] | None = None) -> Any: ...
    def add(self, boards: Any, name: str) -> Any: ...
    def add_all(self, moments: Mapping[str, Any]) -> Any: ...
    def remove(self, name: str) -> Any: ...


@dataclass(frozen=True, eq=False)
class OneAssessment:
    """The assessment of a frame with the fields of `PairLook`."""

    sides: tuple[Look]
    used: tuple[bool]
    refused: str
    take: bool


class OneCamera:
    """A `Guide` as the session uses it."""

    def __init__(self, guide: Guide) -> None:
        self._guide = guide

    @property
    def progress(self) -> Any:
        """As `Guide.progress`."""
        return self._guide.progress

    @property
    def size(self) -> tuple[int, int] | None:
        """The board's size (columns, rows) in corners; None if unknown."""
        wanted = self._guide.progress.wanted
        return None if wanted is None else wanted.size

    def look(self, boards: Any, time: float, greys: Sequence[Array] | None = None) -> OneAssessment:
        """As `Guide.look`."""
        assessment = self._guide.look(boards[0], time, None if greys is None else greys[0])
        return OneAssessment((assessment,), (boards[0] is not None,), assessment.refused, assessment.take)

    def add(self, boards: Any, name: str) -> Any:
        """As `Guide.add`."""
        return self._guide.add(boards[0], name)

    def add_all(self, moments: Mapping[str, Any]) -> Any:
        """As `Guide.add_all`."""
        return self._guide.add_all({name: boards[0] for name, boards in moments.items()})

    def remove(self, name: str) -> Any:
        """As `Guide.remove`."""
        return self._guide.remove(name)
