"""The compiled kernels (src/native), called through ctypes: what would be a Python loop over pixels or corners.

A kernel is a C function that takes arrays, integers and reals, and returns nothing or an integer. The module that owns an algorithm
binds its kernel, prepares arrays, and says in its docstring what the kernel computes: `_kernel = bind("rcdn_name", "pfN", ...)`.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from rcdn.errors import RcdnError
from rcdn.types import Array

KINDS: dict[str, Any] = {
    "f": np.float32, "d": np.float64, "b": np.uint8, "c": np.int8, "i": np.int32, "l": np.int64,
}  # fmt: skip
"""letters of arrays; capitals are written to"""


def bind(name: str, arguments: str, result: bool = False) -> Callable[..., Any]:
    """The kernel `name` as a Python function. `arguments`: a letter each, of `KINDS` (C-contiguous arrays; capitals: written to),
    `n` an integer, `r` a real, `p` a picture (H, W) uint8 or float32. `result`: it returns an integer.

    Arrays of another type or order raise ctypes.ArgumentError: kernels convert nothing.
    """
    function: Any = None

    def call(*values: Any) -> Any:
        nonlocal function
        if function is None:
            function = _library()[name]
            function.argtypes = [kind for letter in arguments for kind in _kinds(letter)]
            function.restype = ctypes.c_ssize_t if result else None
        if "p" in arguments:
            values = tuple(v for letter, value in zip(arguments, values, strict=True) for v in _values(letter, value))
        return function(*values)

    return call


def _kinds(letter: str) -> tuple[Any, ...]:
    if letter == "n":
        return (ctypes.c_ssize_t,)
    if letter == "r":
        return (ctypes.c_double,)
    if letter == "p":
        return ctypes.c_void_p, ctypes.c_ssize_t, ctypes.c_ssize_t, ctypes.c_int
    flags: Any = ["C_CONTIGUOUS", "WRITEABLE"] if letter.isupper() else ["C_CONTIGUOUS"]
    return (np.ctypeslib.ndpointer(KINDS[letter.lower()], flags=flags),)


def _values(letter: str, value: Any) -> tuple[Any, ...]:
    return picture(value) if letter == "p" else (value,)


def picture(grey: Array) -> tuple[int, int, int, int]:
    """Address, height, width and whether it is float32, of a grey picture (H, W): contiguous uint8 or float32."""
    if grey.ndim != 2 or not grey.flags.c_contiguous or grey.dtype not in (np.uint8, np.float32):
        raise RcdnError(
            f"a kernel needs a contiguous (H, W) picture of uint8 or float32, not {grey.shape} {grey.dtype}"
        )
    return grey.__array_interface__["data"][0], grey.shape[0], grey.shape[1], int(grey.dtype == np.float32)


@functools.cache
def _library() -> ctypes.CDLL:
    found = find_spec("rcdn._native")
    if found is None or found.origin is None:
        raise RcdnError(
            "rcdn's compiled kernels are missing: install it again (pip install .), with a C compiler at hand"
        )
    return ctypes.CDLL(found.origin)
