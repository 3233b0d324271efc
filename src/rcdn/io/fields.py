"""Access to the fields of a parsed file with checks: error messages name the file, the field and the fix."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import FormatError, RcdnError, shown
from rcdn.types import Array
from rcdn.types.arrays import Real
from rcdn.types.ranges import LARGEST, SIDE, is_rigid

MOST_BYTES = 1 << 30
"""largest size of a file: a larger one would take tens of gigabytes of memory"""

_KINDS = {list: "a list", dict: "an object", str: "text", int: "a whole number", bool: "true or false"}


def check_path(path: object, error: type[RcdnError] = FormatError) -> None:
    """Raise `error` if `path` isn't a path."""
    if not isinstance(path, str | os.PathLike):
        raise error(f"path must be the name of a file, not {shown(path)}")


def read_text(path: str | Path) -> str:
    """The text of `path`, UTF-8 with or without a byte order mark. Raises FormatError if it can't be read or isn't
    text, or `path` isn't a path."""
    check_path(path)
    try:
        with open(path, "rb") as file:
            data = file.read(MOST_BYTES + 1)
        if len(data) > MOST_BYTES:
            raise FormatError(f"{path}: larger than {MOST_BYTES >> 20} MB; name the file that rcdn wrote")
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError as error:
        raise FormatError(f"{path}: no such file; check the path") from error
    except IsADirectoryError as error:
        raise FormatError(f"{path}: a folder, where a file is needed; name a file in it") from error
    except OSError as error:
        raise FormatError(f"{path}: can't be read ({error.strerror or error}); check the path") from error
    except ValueError as error:
        raise FormatError(f"{path}: not a text file; name the file that rcdn wrote") from error


def read_json(path: str | Path, text: str, fix: str) -> Any:
    """The JSON value of `text`, which was read from `path`. Raises FormatError, with the advice `fix`, if it isn't
    valid JSON or contains NaN or Infinity."""
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: not JSON ({error}); {fix}") from error


@contextmanager
def located(where: str) -> Iterator[None]:
    """An RcdnError that is raised inside becomes a FormatError whose message begins with `where`; FormatErrors name
    their place already."""
    try:
        yield
    except FormatError:
        raise
    except RcdnError as error:
        raise FormatError(f"{where}: {error}") from error


def take(record: Any, key: str, kind: type, where: str) -> Any:
    """The value of `key`, which must be present and of type `kind`. Raises FormatError with a message that begins with
    `where`."""
    if not isinstance(record, dict):
        raise FormatError(f"{where} must be an object")
    value = record.get(key)
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise FormatError(f"{where}: {key!r} must be {_KINDS[kind]}")
    return value


def numbers(
    record: dict[str, Any],
    key: str,
    where: str,
    *,
    finite: bool = False,
    shape: tuple[int, ...] | None = None,
    within: float = LARGEST,
) -> Array:
    """The numbers of a list as an array, null as NaN; finite numbers must be within ±`within`. `shape`: the required
    shape, −1 for any length; None: the caller checks the shape."""
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
    if (np.isfinite(array) & (np.abs(array) > within)).any():
        raise FormatError(f"{where}: {key!r} must hold numbers within ±{within:g}")
    return array.reshape([len(array) if n < 0 else n for n in shape]) if shape is not None else array


def number(record: Any, key: str, where: str) -> float:
    """One finite number within ±LARGEST; text such as 1e-05 is accepted as a number (YAML 1.1 parses it as text)."""
    value = record.get(key) if isinstance(record, dict) else None
    try:
        found = float("nan") if value is None or isinstance(value, bool) else float(value)
    except (ValueError, TypeError, OverflowError):
        found = float("nan")
    if not abs(found) <= LARGEST:
        raise FormatError(f"{where}: {key!r} must be a finite number within ±{LARGEST:g}")
    return found


def two_whole_numbers(record: Any, key: str, where: str) -> tuple[int, int]:
    """A list of two whole numbers from 1 to SIDE: the size of a picture or of a board."""
    pair = numbers(record, key, where, finite=True, shape=(2,), within=np.inf)
    if (pair != np.floor(pair)).any() or (pair < 1).any() or (pair > SIDE).any():
        raise FormatError(f"{where}: {key!r} must hold two whole numbers from 1 to {SIDE}")
    return int(pair[0]), int(pair[1])


def rigid(record: Any, key: str, where: str) -> Real[Array, "4 4"]:
    """A rigid transformation (4, 4), stored row by row. Raises FormatError if it isn't rigid."""
    T = numbers(record, key, where, finite=True, shape=(4, 4))
    if not is_rigid(T):
        raise FormatError(f"{where}: {key!r} is no rotation and translation (4 × 4); write or export the file again")
    return T


def nullable(values: Any) -> Any:
    """A number or an array of numbers for JSON with all digits: NaN becomes None and an infinity text, as `numbers`
    reads them."""
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


def names_of(values: Any, where: str) -> tuple[str, ...]:
    """A list of names. Raises FormatError for anything else."""
    if not isinstance(values, list) or not all(isinstance(v, str) for v in values):
        raise FormatError(f"{where} must be a list of names, not {shown(values)}")
    return tuple(values)
