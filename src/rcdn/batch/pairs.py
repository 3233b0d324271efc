"""Pairing the pictures of two cameras that were taken at the same moment: by name, else by number, else by time stamps
that differ, else by order."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import PurePath

from rcdn.batch.spellings import composed
from rcdn.batch.time_stamps import FEWEST, by_time
from rcdn.errors import ConfigError, many

SIDES = (("left", "right"), ("cam0", "cam1"), ("l", "r"), ("0", "1"), ("1", "2"))
"""words in file names that denote the left and the right camera"""
SHOWN = 3
"""the largest number of names listed in a sentence"""
LAST_NUMBER = re.compile(r"\d+(?=\D*$)")


@dataclass(frozen=True)
class Pairing:
    """`pairs`: (index of the left picture, index of the right one), in the order of the left ones; `way`: the rule that
    was used: `name`, `number`, `order`, or `time` with how far the stamps of a pair are apart."""

    pairs: list[tuple[int, int]]
    way: str


def pair_names(left: Sequence[str], right: Sequence[str]) -> Pairing:
    """Pair the pictures of the left camera with those of the right one.

    By the file names without the word that denotes the camera (a/01.png and b/01.png, left_01 and right_01), else by
    the last number in the names, provided that most pictures of the camera with fewer then have a partner. Else, or if
    that adds pairs to them, by time stamps in the names that differ by little (`by_time`). Else by name or number if
    that gives FEWEST pairs or more that `a_few_tell`, else by order if both have equally many. Frames of two videos are
    paired by frame number. Raises ConfigError if none of these rules applies.
    """
    keys = list(_keys(left, right))
    found = [Pairing(_with_partner(one, two), way) for way, one, two in keys]
    most = next((each for each in found if 2 * len(each.pairs) > min(len(left), len(right))), None)
    timed = _by_time(left, right)
    if most is not None:
        return timed if timed is not None and {*most.pairs} < {*timed.pairs} else most
    if timed is not None:
        return timed
    for each, (way, *of_both) in zip(found, keys, strict=True):
        if len(each.pairs) >= FEWEST and a_few_tell(way, of_both, (left, right)):
            return each
    if len(left) == len(right):
        return Pairing([(k, k) for k in range(len(left))], "order")
    raise ConfigError(
        f"{len(left)} pictures of the left camera and {len(right)} of the right one don't pair by name (a/01.png and "
        "b/01.png, or left_01.png and right_01.png); give names that do, or as many of each in the same order, "
        f"or {_way_out(left, right)}"
    )


def _by_time(left: Sequence[str], right: Sequence[str]) -> Pairing | None:
    timed = by_time([stems(left), stems(right)])
    if timed is None:
        return None
    return Pairing(_with_partner(*timed.keys), f"time, at most {timed.apart} apart")


def _keys(left: Sequence[str], right: Sequence[str]) -> Iterator[tuple[str, list[str], list[str]]]:
    """Each rule under which the pictures of both cameras differ, and their keys by it."""
    by_words = [("name", _without(one), _without(other)) for one, other in SIDES]
    for way, of_left, of_right in (
        ("name", stems, stems), *by_words, ("number", trailing_numbers, trailing_numbers)
    ):  # fmt: skip
        one, two = of_left(left), of_right(right)
        if distinct_keys(one) and distinct_keys(two):
            yield way, one, two


def _with_partner(left: Sequence[str], right: Sequence[str]) -> list[tuple[int, int]]:
    """The indices of the same key on both sides."""
    at = {key: k for k, key in enumerate(right)}
    return [(k, at[key]) for k, key in enumerate(left) if key in at]


def pairing_hint(left: Sequence[str], right: Sequence[str], found: Pairing) -> str:
    """A sentence on how the pictures were paired and how to change that; "" if the names are unambiguous."""
    alone = [
        [n for k, n in enumerate(names) if k not in {p[c] for p in found.pairs}]
        for c, names in enumerate((left, right))
    ]
    if found.way == "name" and not (alone[0] and alone[1]):
        return ""
    a, b = found.pairs[0]
    text = (
        f"paired by {found.way}, {many(len(found.pairs), 'pair')}: {_short(left[a])} with {_short(right[b])}, and so on"
    )
    text += "".join(
        f"; without a partner on the {side}: {_some(names)}"
        for side, names in zip(("left", "right"), alone, strict=True)
        if names
    )
    return f"{text}. If that is wrong, {_way_out(left, right, found.pairs[0])}"


def _way_out(left: Sequence[str], right: Sequence[str], pair: tuple[int, int] = (0, 0)) -> str:
    if not left or not right:
        return "name the pairs: --pairs pairs.txt"
    example = f"{quoted(_short(left[pair[0]]))} {quoted(_short(right[pair[1]]))}"
    return f"name the pairs: --pairs pairs.txt, a file with a line for each, such as `{example}`"


def _short(name: str) -> str:
    """A picture's name without its folder; the number of a video's frame is kept."""
    return re.split(r"[/\\]", name)[-1]


def quoted(name: str) -> str:
    """`name` as it is written in a file of pairs: in double quotes if it contains a separator."""
    return f'"{name}"' if re.search(r"[\s,;]", name) else name


def _some(names: Sequence[str]) -> str:
    return ", ".join(_short(n) for n in names[:SHOWN]) + (
        f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
    )


def _stem(name: str) -> str:
    path, mark, frame = name.rpartition("#")
    return f"#{frame}" if mark and path else composed(PurePath(name).stem).lower()


def stems(names: Sequence[str]) -> list[str]:
    """The names without folders and endings, in lower case and one spelling of accents; for a frame of a video, its
    number."""
    return [_stem(n) for n in names]


def _without(word: str) -> Callable[[Sequence[str]], list[str]]:
    """A function that gives the stems with `word` replaced by `*`; "" for a stem that doesn't contain it as a separate
    word."""
    pattern = re.compile(rf"(?<![a-z]){word}(?![a-z])" if word.isalpha() else rf"(?<!\d){word}(?!\d)")

    def keys(names: Sequence[str]) -> list[str]:
        return [pattern.sub("*", _stem(n), count=1) if pattern.search(_stem(n)) else "" for n in names]

    return keys


def trailing_numbers(names: Sequence[str]) -> list[str]:
    """The last number in each name; "" if there is none."""
    found = [re.findall(r"\d+", _stem(n)) for n in names]
    return [str(int(f[-1])) if f else "" for f in found]


def one_counter(names: Sequence[str]) -> bool:
    """Whether the names differ in their last number only, which then counts the pictures of this camera."""
    return len({LAST_NUMBER.sub("", _stem(n)) for n in names}) == 1


def a_few_tell(way: str, keys: Sequence[Sequence[str]], pictures: Sequence[Sequence[str]]) -> bool:
    """Whether a few equal keys of cameras say what belongs together: names, and numbers if each camera counts its
    pictures; but not if all count theirs without a gap, since each may have a counter of its own."""
    return (way == "name" or all(map(one_counter, pictures))) and not all(map(_without_a_gap, keys))


def _without_a_gap(keys: Sequence[str]) -> bool:
    """Whether the keys differ in their last number only, which takes all values from the least to the largest; False
    for frames of a video, whose numbers are its own."""
    if keys[0].startswith("#") or len({LAST_NUMBER.sub("", key) for key in keys}) > 1:
        return False
    numbers = [int(found[0]) for found in map(LAST_NUMBER.search, keys) if found]
    return len(numbers) == len(keys) == len({*numbers}) == max(numbers) - min(numbers) + 1


def distinct_keys(keys: Sequence[str]) -> bool:
    """Whether there are keys, none empty and all different."""
    return bool(keys) and all(keys) and max(Counter(keys).values()) == 1
