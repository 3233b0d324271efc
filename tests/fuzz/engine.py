"""Who makes the bytes: Atheris, which follows what code they reach, or plain chance."""

from __future__ import annotations

import random
import sys
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

LONGEST = 512
"""bytes of an input's choices"""
ENGINES = ("atheris", "random")


def default_engine(guided: bool) -> str:
    """Atheris, where it is installed and the target's decisions are Python's."""
    return "atheris" if guided and find_spec("atheris") else "random"


def chosen_at_random(seed: int, name: str, number: int) -> bytes:
    """The choices of input `number`: the same for the same seed and target."""
    rng = random.Random(f"{seed} {name} {number}")
    return rng.randbytes(rng.choice((8, 24, 64, LONGEST)))


def by_chance(seed: int, name: str, first: int, one: Callable[[bytes], Any]) -> None:
    """Call `one` with one input after another, from number `first` on, until it raises StopIteration."""
    number = first
    try:
        while True:
            one(chosen_at_random(seed, name, number))
            number += 1
    except StopIteration:
        return


def by_coverage(seed: int, one: Callable[[bytes], Any]) -> None:
    """The same with Atheris: it keeps what reaches new code and changes it further. Doesn't return;
    `one` must end the process."""
    import atheris

    options = (
        "-verbosity=0",
        "-rss_limit_mb=0",
        "-timeout=100000",
        "-len_control=20",
        f"-max_len={LONGEST}",
        f"-seed={seed % 2**31 or 1}",
        "-detect_leaks=0",
    )
    signals = ("segv", "bus", "abrt", "ill", "fpe", "int", "term", "xfsz", "usr1", "usr2")
    atheris.Setup([sys.argv[0], *options, *(f"-handle_{s}=0" for s in signals)], one)
    atheris.Fuzz()
