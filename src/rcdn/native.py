"""The compiled kernels (src/native), called through ctypes: what would be a Python loop over pixels or corners.

A kernel is a C function that takes arrays, integers and reals, and returns nothing or an integer. The module that owns an algorithm
binds its kernel, prepares arrays, and says in its docstring what the kernel computes: `_kernel = bind("rcdn_name", "pfN", ...)`.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable
from importlib import import_module
from typing import Any

from rcdn.errors import RcdnError


def bind(name: str, arguments: str, result: bool = False) -> Callable[..., Any]:
    """The kernel `name` as a Python function. `arguments`: a letter each, of C-contiguous arrays of `f` float32, `d` float64, `b` uint8,
    `c` int8, `i` int32 and `l` int64 (capitals: written to), `n` an integer, `r` a real, `p` a picture (H, W) uint8 or float32.
    `result`: it returns an integer.

    Arrays of another type or order raise TypeError: kernels convert nothing.
    """
    function: Any = None
    unpack: Any = None
    letters = arguments.encode()

    def call(*values: Any) -> Any:
        nonlocal function, unpack
        if function is None:
            library, unpack = _library()
            made = library[name]
            made.argtypes = [kind for letter in arguments for kind in _kinds(letter)]
            made.restype = ctypes.c_ssize_t if result else None
            function = made
        return function(*unpack(letters, values))

    return call


def _kinds(letter: str) -> tuple[Any, ...]:
    whole = ctypes.c_ssize_t
    several: dict[str, tuple[Any, ...]] = {
        "n": (whole,),
        "r": (ctypes.c_double,),
        "p": (ctypes.c_void_p, whole, whole, ctypes.c_int),
    }
    return several.get(letter, (ctypes.c_void_p,))


@functools.cache
def _library() -> tuple[ctypes.CDLL, Any]:
    """The kernels, and what turns their arguments into what ctypes takes."""
    try:
        module = import_module("rcdn._native")
    except ImportError as error:
        raise RcdnError(
            "rcdn's compiled kernels are missing: install it again (pip install .), with a C compiler at hand"
        ) from error
    return ctypes.CDLL(str(module.__file__)), module.arguments
