"""The compiled kernels (src/native), which replace Python loops over pixels or corners.

A kernel is a C function that takes arrays, pictures, integers and reals, and returns an integer. Its signature is
declared in C (src/native/kernel.h): the dimensions of its arrays, the limits of its integers. Each call is checked
against it. The module that owns an algorithm binds its kernel (`_kernel = bind("rcdn_name")`), prepares the arrays, and
documents what the kernel computes. `help(_kernel)` shows the signature.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any

from rcdn.errors import RcdnError


def bind(name: str, *groups: type[tuple[Any, ...]]) -> Callable[..., int]:
    """The kernel `name` as a function of the arguments in its signature, except SIZE, LET and WHERE. It runs without
    the global interpreter lock.

    `groups`: the named tuples, in order, that the kernel takes for groups of arguments; their fields must match those
    declared in C.

    A call raises TypeError for an array of another type or memory order (kernels convert nothing), a read-only output
    array, or a wrong number of arguments; ValueError for another shape, a number beyond its limits, an index out of
    range, or arrays that share memory; MemoryError if the kernel can't allocate its own memory. Nothing is computed in
    these cases. `bind` raises AttributeError if there is no such kernel, or if a group has other fields.
    """
    library = _library()
    if name not in library.kernels:
        raise AttributeError(f"the compiled kernels have no {name}: build them again (pip install .)")
    fields = [tuple(spec[0] for spec in inner) for _, what, *_, inner in library.arguments[name] if what == "group"]
    for given, known in zip(groups, fields, strict=True):
        if getattr(given, "_fields", ()) != known:
            raise AttributeError(f"{name}: {given.__name__} must have the fields {', '.join(known)}")
    kernel: Callable[..., int] = library.kernels[name]
    return kernel


def constants(unit: str) -> Mapping[str, int]:
    """The constants shared by a file of kernels, src/native/`unit`.c, and its callers. They are defined in C."""
    known: Mapping[str, int] = _library().constants[unit]
    return known


@functools.cache
def _library() -> Any:
    """The extension module: `kernels`, their `arguments`, and `constants`."""
    try:
        return import_module("rcdn._native")
    except ImportError as error:
        raise RcdnError(
            "rcdn's compiled kernels are missing: install it again (pip install .), with a C compiler at hand"
        ) from error
    except ValueError as error:
        raise RcdnError(str(error)) from None
