"""Reading and writing YAML: PyYAML reads it, including OpenCV's dialect; the few written forms are generated as
text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from rcdn.errors import FormatError
from rcdn.types import Array
from rcdn.types.ranges import LARGEST

YAML = (".yaml", ".yml")
"""endings of its files' names"""
MOST_VALUES = 1_000_000
"""largest number of values in a file: with aliases, a short text can expand to any number of them"""


class Matrix(dict[str, Any]):
    """A matrix of OpenCV's YAML with its fields as in the file. `array()` returns (rows, cols), of an array of one
    dimension, which OpenCV 5 writes, one column; or raises FormatError with a message that begins with `where`."""

    def array(self, where: str) -> Array:
        try:
            rows, cols = map(int, self._shape())
            array = np.array(self["data"], dtype=float).reshape(max(rows, 0), max(cols, 0))
        except (KeyError, ValueError, TypeError, OverflowError) as error:
            lengths = "one number in sizes," if "sizes" in self else "rows, cols"
            raise FormatError(f"{where} must have {lengths} and as many numbers in data; export it again") from error
        if (np.isfinite(array) & (np.abs(array) > LARGEST)).any():
            raise FormatError(f"{where} must hold numbers within ±{LARGEST:g}")
        return array

    def _shape(self) -> tuple[Any, Any]:
        if "sizes" not in self:
            return self["rows"], self["cols"]
        (count,) = self["sizes"]
        return count, 1


class _Loader(yaml.SafeLoader):
    """A loader of plain YAML values and OpenCV's matrices."""


def _matrix(loader: Any, node: Any) -> Matrix:
    return Matrix(loader.construct_mapping(node, deep=True))


for _tag in ("opencv-matrix", "opencv-nd-matrix"):
    _Loader.add_constructor(f"tag:yaml.org,2002:{_tag}", _matrix)


def load(path: str, text: str) -> Any:
    """The value of a YAML file, OpenCV's matrices as `Matrix`. Raises FormatError with the line of the error."""
    plain = re.sub(r"\A%YAML[: ]1\.\d[^\n]*\n", "", text)  # OpenCV's first line isn't valid YAML
    plain = re.sub(r"\n---\s*\Z", "\n", plain)  # as ROS ends a message
    try:
        value = yaml.load(plain, _Loader)
    except (yaml.YAMLError, ValueError, TypeError, OverflowError, RecursionError) as error:
        reason = " ".join(str(error).split()).replace('"<unicode string>", ', "") or type(error).__name__
        raise FormatError(f"{path}: not YAML ({reason[:300]}); mend that line, or export the file again") from error
    if _holds(value) > MOST_VALUES:
        raise FormatError(f"{path}: its aliases (*) say more than {MOST_VALUES} values; export the file again")
    return value


def _holds(value: Any) -> int:
    """The number of values, with those of an alias counted at each occurrence; counting stops above MOST_VALUES."""
    many, waiting = 0, [value]
    while waiting and many <= MOST_VALUES:
        many += 1
        found = waiting.pop()
        if isinstance(found, dict):
            waiting += [*found.keys(), *found.values()]
        elif isinstance(found, (list, tuple, set)):
            waiting += found
    return many


def digits(value: float) -> str:
    """A number with all digits needed to read back the same value, in a form that YAML 1.1 parses as a number."""
    text = repr(float(value) + 0.0)  # + 0.0: no "-0.0"
    return text if "." in text else text.replace("e", ".0e")


def flow(values: Iterable[float]) -> str:
    """A flow sequence, `[a, b, c]`."""
    return "[" + ", ".join(digits(v) for v in values) + "]"


def block_matrix(key: str, array: Array, tag: str = "") -> str:
    """A matrix with rows, cols and data, as ROS writes it, or with a `tag` as OpenCV does; one row per line."""
    array = np.atleast_2d(array)
    rows = (", " if array.shape[1] == 1 else ",\n      ").join(", ".join(digits(v) for v in row) for row in array)
    depth = "   dt: d\n" if tag else ""
    return f"{key}:{tag}\n   rows: {array.shape[0]}\n   cols: {array.shape[1]}\n{depth}   data: [{rows}]\n"
