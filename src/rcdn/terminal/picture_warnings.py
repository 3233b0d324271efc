"""Warnings about pictures: what is said of many is printed for the first of them, and counted for the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

from rcdn.errors import many
from rcdn.terminal.console import first_time

PRINTED = 3
"""pictures for which the same warnings are printed"""


class PictureWarnings:
    """Prints the warnings of pictures by `warn(message)`; `close` says of how many more pictures the same was true."""

    def __init__(self, warn: Callable[[str], None]) -> None:
        self._warn = warn
        self._times: Counter[str] = Counter()

    def add(self, path: str, warnings: Sequence[str]) -> None:
        """Print the `warnings` of a picture as one line, the first time that this run has them for it."""
        text = "; ".join(warnings)
        if not text or not first_time(f"{path}: {text}"):
            return
        self._times[text] += 1
        if self._times[text] <= PRINTED:
            self._warn(f"{path}: {text}")

    def close(self) -> None:
        """Print the number of pictures whose warnings were not printed."""
        for text, times in self._times.items():
            if times > PRINTED:
                self._warn(f"{many(times - PRINTED, 'more picture')}: {text}")
