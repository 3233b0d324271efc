"""YAML in and out: PyYAML reads, also OpenCV's dialect; the few forms that are written are plain text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
import yaml  # type: ignore[import-untyped]

from rcdn.errors import FormatError
from rcdn.types import Array


class _Loader(yaml.SafeLoader):  # type: ignore[misc]
    """YAML's plain values, and OpenCV's matrices as arrays (rows, cols)."""


def _opencv_matrix(loader: Any, node: Any) -> Array:
    record = loader.construct_mapping(node, deep=True)
    try:
        return np.array(record["data"], dtype=float).reshape(int(record["rows"]), int(record["cols"]))
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise yaml.constructor.ConstructorError(
            None, None, "a matrix needs rows, cols and data that fit", node.start_mark
        ) from error


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)


def load(path: str, text: str) -> Any:
    """The value of a YAML file. Raises FormatError with the line of the trouble."""
    plain = re.sub(r"\A%YAML[: ]1\.\d[^\n]*\n", "", text)  # OpenCV's head is not YAML's
    try:
        return yaml.load(plain, _Loader)
    except (yaml.YAMLError, ValueError, TypeError, RecursionError) as error:
        reason = " ".join(str(error).split()).replace('"<unicode string>", ', "") or type(error).__name__
        raise FormatError(f"{path}: not YAML ({reason}); mend that line, or export the file again") from error


def digits(value: float) -> str:
    """A number with every digit that it needs to come back the same, in a form that YAML 1.1 takes for a number."""
    text = repr(float(value) + 0.0)  # + 0.0: no "-0.0"
    return text if "." in text else text.replace("e", ".0e")


def flow(values: Iterable[float]) -> str:
    """`[a, b, c]`."""
    return "[" + ", ".join(digits(v) for v in values) + "]"


def block_matrix(key: str, array: Array, tag: str = "") -> str:
    """A matrix with rows, cols and data, as ROS writes it, or with OpenCV's tag as OpenCV does; one row a line."""
    array = np.atleast_2d(array)
    rows = ",\n      ".join(", ".join(digits(v) for v in row) for row in array)
    depth = "   dt: d\n" if tag else ""
    return f"{key}:{tag}\n   rows: {array.shape[0]}\n   cols: {array.shape[1]}\n{depth}   data: [{rows}]\n"
