"""Which pictures of two cameras were taken at the same moment: by their names, else by their order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import PurePath

from rcdn.errors import ConfigError

SIDES = (("left", "right"), ("cam0", "cam1"), ("l", "r"), ("0", "1"), ("1", "2"))
"""words that name a camera"""


def pair_names(left: Sequence[str], right: Sequence[str]) -> list[tuple[int, int]]:
    """(index in `left`, index in `right`) of pictures that belong together, in the order of `left`.

    By the file names but for the word that names the camera (a/01.png and b/01.png, left_01 and right_01), else by the last number in the names, else
    by order if there are as many. Frames of two videos belong together by their numbers. Raises ConfigError if nothing of that works.
    """
    for keys in (_stems, *(_without(words) for words in SIDES), _numbers):
        one, two = keys(left, 0), keys(right, 1)
        if _distinct(one) and _distinct(two):
            at = {key: k for k, key in enumerate(two)}
            pairs = [(k, at[key]) for k, key in enumerate(one) if key in at]
            if 2 * len(pairs) > min(len(left), len(right)):
                return pairs
    if len(left) == len(right):
        return [(k, k) for k in range(len(left))]
    raise ConfigError(
        f"{len(left)} pictures of the left camera and {len(right)} of the right one don't pair by name (a/01.png and b/01.png, or left_01.png and "
        "right_01.png); give names that do, or as many of each in the same order"
    )


def _stem(name: str) -> str:
    path, mark, frame = name.rpartition("#")
    return f"#{frame}" if mark and path else PurePath(name).stem.lower()


def _stems(names: Sequence[str], side: int) -> list[str]:
    return [_stem(n) for n in names]


def _without(words: tuple[str, str]) -> Callable[[Sequence[str], int], list[str]]:
    """Stems without the word of their side, where all have it as a word of its own."""

    def keys(names: Sequence[str], side: int) -> list[str]:
        pattern = re.compile(
            rf"(?<![a-z]){words[side]}(?![a-z])" if words[side].isalpha() else rf"(?<!\d){words[side]}(?!\d)"
        )
        return [pattern.sub("*", _stem(n), count=1) if pattern.search(_stem(n)) else "" for n in names]

    return keys


def _numbers(names: Sequence[str], side: int) -> list[str]:
    found = [re.findall(r"\d+", _stem(n)) for n in names]
    return [str(int(f[-1])) if f else "" for f in found]


def _distinct(keys: Sequence[str]) -> bool:
    return bool(keys) and all(keys) and max(Counter(keys).values()) == 1
