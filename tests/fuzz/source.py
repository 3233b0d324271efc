"""Choices from bytes: an engine makes the bytes, a target makes an input of them."""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")

ODD_REALS = (
    0.0, -0.0, 1.0, -1.0, 0.5, 1e-9, -1e-9, 1e-30, 5e-324, 1e9, -1e9, 1e19, -1e19, 1e30, 1e38, 1e150, -1e150, 1e308,
    -1e308, math.inf, -math.inf, math.nan, 2.0**31, -(2.0**31), 2.0**53, 2.0**63, -(2.0**63), 255.0, 256.0, 32767.5,
)  # fmt: skip
"""values at which arithmetic, casts and comparisons go wrong"""
ODD_INTEGERS = (
    0,
    1,
    -1,
    2,
    3,
    7,
    255,
    256,
    65535,
    2**31 - 1,
    2**31,
    -(2**31),
    2**32,
    2**53 + 1,
    2**63 - 1,
    -(2**63),
    10**25,
    10**400,
)


class Source:
    """Reads choices off `data`, from its begin; past its end every byte is 0, which is always the plainest choice."""

    def __init__(self, data: bytes) -> None:
        self.data, self.at = data, 0

    def byte(self) -> int:
        """A number in 0..255."""
        self.at += 1
        return self.data[self.at - 1] if self.at <= len(self.data) else 0

    def below(self, n: int) -> int:
        """A number in 0..n − 1."""
        value, room = self.byte(), 256
        while room < n:
            value, room = value << 8 | self.byte(), room << 8
        return value % n

    def between(self, low: int, high: int) -> int:
        """A number in low..high."""
        return low + self.below(high - low + 1)

    def choice(self, values: Sequence[T]) -> T:
        """One of `values`."""
        return values[self.below(len(values))]

    def chance(self, one_in: int) -> bool:
        """True once in `one_in`; never where the data has ended."""
        return self.byte() % one_in == one_in - 1

    def real(self) -> float:
        """Any float64: an odd one, a usual one, or one of random bits."""
        kind = self.byte() % 4
        if kind == 0:
            return self.choice(ODD_REALS)
        if kind == 1:
            return self.between(-1000, 1000) / 8
        if kind == 2:
            return float(struct.unpack("<d", bytes(self.byte() for _ in range(8)))[0])
        return math.ldexp(self.between(-255, 255) / 255, self.between(-40, 40))

    def integer(self) -> int:
        """Any integer: an odd one, or a small one."""
        return self.choice(ODD_INTEGERS) if self.byte() % 2 else self.between(-8, 200)

    def random(self) -> np.random.Generator:
        """A generator of numbers for what needs many."""
        return np.random.Generator(np.random.SFC64([self.byte() for _ in range(4)]))

    def value(self) -> Any:
        """Anything that a JSON, YAML or TOML file can hold in place of what it should."""
        kind = self.byte() % 12
        if kind < 3:
            return self.real()
        if kind < 6:
            return self.integer()
        plain = (
            None,
            True,
            False,
            "",
            [],
            {},
            "nan",
            "x" * 300,
            "\0",
            "\ud800",
            [[]],
            [None],
            [[1, 2], [3]],
            {"a": {}},
            "1e999",
            "-5",
            [0] * 9,
        )
        return self.choice(plain)
