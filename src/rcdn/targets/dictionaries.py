"""Markers by name: all dictionaries of OpenCV, and the families of AprilTags in their printed orientation."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from rcdn.errors import ConfigError, shown
from rcdn.targets.aprilgrid import NAMES
from rcdn.targets.families import FAMILIES, families
from rcdn.types import Array
from rcdn.types.arrays import Shaped

SIDES = (4, 5, 6, 7)
"""bits along a side of a marker"""


def dictionary_names() -> tuple[str, ...]:
    """OpenCV's names of the dictionaries that the installed version has."""
    known = {name for side in SIDES for family in families(side) for name in family.names}
    return tuple(name for names in FAMILIES for name in names if name in known)


def family_names() -> tuple[str, ...]:
    """The families of AprilTags, by the names that their authors gave them."""
    return tuple(NAMES[name] for name in dictionary_names() if name in NAMES)


def dictionary_name(text: str) -> str:
    """OpenCV's name of a dictionary, from that name in any case, with or without `DICT_`. Raises ConfigError, which
    lists the names."""
    return _known(text, dictionary_names(), "dictionary", lambda name: re.sub("^dict_", "", name.lower()))


def family_name(text: str) -> str:
    """The name of a family of AprilTags: `tag36h11`, also `36h11` and OpenCV's DICT_APRILTAG_36h11. Raises ConfigError,
    which lists the names."""
    return _known(text, family_names(), "family", lambda name: re.sub("^(dict_apriltag_|tag|t)", "", name.lower()))


def marker_bits(dictionary: str) -> Shaped[Array, "b n n"]:
    """The bits (N, n, n) of all markers of one of OpenCV's dictionaries, 1 is white, as OpenCV draws them upright.
    Raises ConfigError."""
    name = dictionary_name(dictionary)
    for side in SIDES:
        for family in families(side):
            if name in family.names:
                return family.bits[: family.sizes[family.names.index(name)]]
    raise ConfigError(f"dictionary {shown(dictionary)}: this OpenCV has none of that name")


def tag_bits(family: str) -> Shaped[Array, "b n n"]:
    """The bits (N, n, n) of all tags of a family, 1 is white, as Kalibr prints them upright. Raises ConfigError."""
    name = family_name(family)
    opencv = next(key for key, value in NAMES.items() if value == name)
    return np.rot90(marker_bits(opencv), 2, (1, 2))  # OpenCV draws AprilTags upside down


def _known(text: str, names: tuple[str, ...], what: str, key: Callable[[str], str]) -> str:
    """The element of `names` with the same `key` as `text`. Raises ConfigError if there is none."""
    wanted = key(str(text).strip())
    found = [name for name in names if key(name) == wanted]
    if not found:
        raise ConfigError(f"{what} {shown(text)} is none that is known; take one of {', '.join(names)}")
    return found[0]
