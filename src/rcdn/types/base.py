"""Common base of the data types: read-only arrays of a stated shape."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rcdn.errors import RcdnError

Array = NDArray[Any]


MOST_ELEMENTS = 100_000_000
"""largest number of elements in an array of a value"""


class Value:
    """Base class of values with arrays: the arrays stay read-only in copies and after unpickling."""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for part in state.values():
            if isinstance(part, np.ndarray):
                part.setflags(write=False)
        self.__dict__.update(state)


def freeze(owner: object, name: str, value: Any, dtype: Any, tail: tuple[int, ...], within: float = np.inf) -> None:
    """Set `owner.name` to `value` as a read-only array of `dtype` and shape (N, *tail); NaN is allowed.

    Raises RcdnError for another shape, for elements that can't be converted to `dtype`, and for numbers beyond
    ±`within`.
    """
    simple = type(value) is np.ndarray and value.dtype == dtype and 0 < value.size <= MOST_ELEMENTS
    if simple and value.ndim == 1 + len(tail) and value.shape[1:] == tail:
        array = value.copy()
    else:
        array = _shaped(value, np.dtype(dtype), tail, f"{type(owner).__name__}.{name}")
    if within < np.inf and array.size and _beyond(array, within):
        raise RcdnError(f"{type(owner).__name__}.{name} must lie within ±{within:g}")
    array.setflags(write=False)
    object.__setattr__(owner, name, array)


def _shaped(value: Any, dtype: np.dtype[Any], tail: tuple[int, ...], called: str) -> Array:
    """A copy of `value` of shape (N, *tail), as `_numbers` makes it."""
    array = _numbers(value, dtype, called)
    if array.size == 0:
        array = array.reshape((0, *tail))
    if array.ndim != 1 + len(tail) or array.shape[1:] != tail:
        raise RcdnError(f"{called} must have shape (N, {', '.join(map(str, tail))}), not {array.shape}")
    return array


def row_of(value: Any, called: str) -> Array:
    """`value` as an array (N,) of floats. Raises RcdnError, whose message begins with `called`, for anything else."""
    if type(value) is np.ndarray and value.dtype == np.float64 and value.ndim == 1:
        return value
    return _shaped(value, np.dtype(np.float64), (), called)


def shape_of(value: Any, called: str) -> tuple[int, ...]:
    """The shape of `value`, an array or convertible to one. Raises RcdnError for rows of unequal length."""
    try:
        return np.shape(value)
    except (ValueError, TypeError, RecursionError) as error:
        raise RcdnError(f"{called} must hold numbers in rows of equal length: {error}") from error


def _beyond(array: Array, within: float) -> bool:
    """Whether any element is beyond ±`within`."""
    high = array.max()
    if np.isnan(high):  # with a NaN, `max` and `min` are NaN
        return bool((np.abs(array) > within).any())
    return bool(high > within or array.min() < -within)


def _numbers(value: Any, dtype: np.dtype[Any], called: str) -> Array:
    """A copy of `value` as a plain array of native byte order, row after row, with every number unchanged."""
    if type(value) is np.ndarray and value.dtype == dtype and value.size <= MOST_ELEMENTS:
        return value.copy()
    if np.ma.is_masked(value):
        raise RcdnError(
            f"{called} must not have masked values; leave them out, or fill them with NaN where it may be unknown"
        )
    try:
        raw = np.asarray(value)
        if raw.size > MOST_ELEMENTS:
            raise RcdnError(f"{called} holds {raw.size} numbers, more than {MOST_ELEMENTS}; leave some out")
        kept = raw.dtype.kind in "buif" or raw.size == 0
        if not kept and raw.dtype.kind != "O":
            raise TypeError(f"not {raw.dtype}")
        if kept and (raw.dtype == dtype or dtype.kind == "f"):
            return np.array(raw, dtype=dtype, order="C")
        if dtype.kind == "f":
            return np.array(value, dtype=dtype, order="C")
        plain = raw if kept else np.array(value, dtype=float)
        with np.errstate(invalid="ignore"):
            array = plain.astype(dtype, order="C")
        whole = bool((array == plain).all())
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        raise RcdnError(f"{called} must hold numbers in rows of equal length: {error}") from error
    if not whole:
        kind = "true or false" if dtype.kind == "b" else f"whole numbers ({dtype})"
        raise RcdnError(f"{called} must hold {kind}")
    return array
