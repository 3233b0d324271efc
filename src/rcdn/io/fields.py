"""Fields of a file that was read, each checked when it is taken: a message names the file, the field and the fix."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import FormatError
from rcdn.types import Array

MOST = 2**31
"""no size in a file is larger"""

_KINDS = {list: "a list", dict: "an object", str: "text", int: "a whole number", bool: "true or false"}


def read_text(path: str | Path) -> str:
    """The text of `path`, UTF-8 with or without its mark. Raises FormatError if it can't be read or isn't text."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file; check the path") from error
    except OSError as error:
        raise FormatError(f"{path}: can't be read ({error.strerror or error}); check the path") from error
    except ValueError as error:
        raise FormatError(f"{path}: not a text file; name the file that rcdn wrote") from error


def read_json(path: str | Path, text: str, fix: str) -> Any:
    """The JSON value of `text`, which was read from `path`. Raises FormatError with `fix`; NaN and Infinity are refused."""
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: not JSON ({error}); {fix}") from error


def take(record: Any, key: str, kind: type, where: str) -> Any:
    """The value of `key`, which must be there and be a `kind`. Raises FormatError that opens with `where`."""
    if not isinstance(record, dict):
        raise FormatError(f"{where} must be an object")
    value = record.get(key)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise FormatError(f"{where}: {key!r} must be {_KINDS[kind]}")
    return value


def numbers(
    record: dict[str, Any], key: str, where: str, *, finite: bool = False, shape: tuple[int, ...] | None = None
) -> Array:
    """The numbers of a list, null as NaN. `shape`: the one that they must have, −1 for any length; else their owner checks it."""
    value = take(record, key, list, where)
    if shape is not None and not _has_shape(value, shape):
        words = " × ".join("any" if n < 0 else str(n) for n in shape)
        raise FormatError(f"{where}: {key!r} must hold {words} numbers" + (", row by row" if len(shape) > 1 else ""))
    try:
        array = np.array(value, dtype=float)
    except (ValueError, TypeError, OverflowError) as error:
        raise FormatError(f"{where}: {key!r} must hold numbers in rows of equal length") from error
    if finite and not np.isfinite(array).all():
        raise FormatError(f"{where}: {key!r} must hold finite numbers")
    return array.reshape([len(array) if n < 0 else n for n in shape]) if shape is not None else array


def number(record: Any, key: str, where: str) -> float:
    """One finite number, text such as 1e-05 counting as one (YAML 1.1 takes it for text)."""
    value = record.get(key) if isinstance(record, dict) else None
    try:
        found = float("nan") if value is None or isinstance(value, bool) else float(value)
    except (ValueError, TypeError, OverflowError):
        found = float("nan")
    if not np.isfinite(found):
        raise FormatError(f"{where}: {key!r} must be a finite number")
    return found


def two_whole_numbers(record: Any, key: str, where: str) -> tuple[int, int]:
    """A list of two whole numbers."""
    pair = numbers(record, key, where, finite=True, shape=(2,))
    if (pair != np.floor(pair)).any() or (np.abs(pair) > MOST).any():
        raise FormatError(f"{where}: {key!r} must hold two whole numbers")
    return int(pair[0]), int(pair[1])


def nullable(values: Any) -> Any:
    """Numbers or an array of them for JSON, every digit kept: NaN is None and an infinity is text, as `numbers` reads them."""
    array = np.asarray(values, float)
    if array.ndim and not np.isfinite(array).all():
        return [nullable(v) for v in array]
    value = array.tolist()
    if array.ndim or np.isfinite(array):
        return value
    return None if np.isnan(array) else str(value)


def _has_shape(value: Any, shape: tuple[int, ...]) -> bool:
    if not shape:
        return value is None or (isinstance(value, (int, float, str)) and not isinstance(value, bool))
    if not isinstance(value, list) or (shape[0] >= 0 and len(value) != shape[0]):
        return False
    return all(_has_shape(v, shape[1:]) for v in value)


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is not a JSON number")
