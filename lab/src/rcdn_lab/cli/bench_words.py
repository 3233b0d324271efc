"""Options of `rcdn bench` that are comma-separated lists."""

from __future__ import annotations

import re

from rcdn.errors import ConfigError

PARTS = ("speed", "first", "memory", "rate")


def parts_of(text: str) -> list[str]:
    """The parts named by `--parts`. Raises ConfigError."""
    names = [] if text.strip() == "none" else words_of(text)
    unknown = sorted(set(names) - set(PARTS))
    if unknown:
        raise ConfigError(f"--parts: nothing is called {', '.join(unknown)}; known: {', '.join(PARTS)}, none")
    return names


def sizes_of(text: str) -> list[tuple[int, int]]:
    """Sizes (width, height) px. Raises ConfigError."""
    out = []
    for word in words_of(text):
        match = re.fullmatch(r"(\d{1,5})[xX×](\d{1,5})", word)
        if match is None or not all(160 <= int(n) <= 10_000 for n in match.groups()):
            raise ConfigError(f"--sizes: {word!r} is none; give width x height from 160 to 10000 px, such as 640x480")
        out.append((int(match[1]), int(match[2])))
    if not out:
        raise ConfigError("--sizes: give at least one, such as 640x480")
    return list(dict.fromkeys(out))


def counts_of(text: str, option: str = "--threads") -> list[int]:
    """Numbers from 1, each once. Raises ConfigError."""
    words = words_of(text)
    if not words or not all(re.fullmatch(r"[1-9]\d{0,2}", word) for word in words):
        raise ConfigError(f"{option}: {text!r} are none; give numbers from 1, such as 1,2")
    return list(dict.fromkeys(map(int, words)))


def words_of(text: str) -> list[str]:
    """The words between commas."""
    return [word.strip() for word in text.split(",") if word.strip()]
