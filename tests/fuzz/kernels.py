"""The compiled kernels: calls as the software makes them, with other values in their arrays.

Pictures, positions and all other reals become anything; sizes and indices, too, where kernels check them. A kernel may
give any answer or refuse the call, but must come back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from tests.fuzz.source import ODD_INTEGERS, ODD_REALS, Source
from tests.fuzz.target import Target

from rcdn import native
from rcdn.types.base import Array

CHECKED = hasattr(native, "constants")
"""do kernels check their calls?"""
FRAME = 15
"""numbers of a window, which one kernel makes for others"""
SAMPLES = 12
"""calls that are kept of each kernel"""


@dataclass(frozen=True)
class Call:
    """A call of the kernel `name`; arrays as they were before it."""

    name: str
    kernel: Callable[..., Any]
    values: tuple[Any, ...]


_calls: dict[str, list[Call]] = {}
_seen: dict[str, int] = {}


def record() -> None:
    """Keep calls of kernels that are bound from now on: to be called before anything of rcdn is imported."""
    bind = native.bind

    def recorded(name: str, *arguments: Any, **more: Any) -> Callable[..., Any]:
        kernel = bind(name, *arguments, **more)

        def call(*values: Any) -> Any:
            count = _seen[name] = _seen.get(name, 0) + 1
            if (
                count & (count - 1) == 0 and len(_calls.setdefault(name, [])) < SAMPLES
            ):  # the 1st, 2nd, 4th, 8th, … call
                _calls[name].append(Call(name, kernel, _copied(values)))
            return kernel(*values)

        return call

    native.bind = recorded


def _copied(values: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(_copied_value(v) for v in values)


def _copied_value(value: Any) -> Any:
    if isinstance(value, tuple):
        return type(value)(*map(_copied_value, value))
    return value.copy() if isinstance(value, np.ndarray) else value


@cache
def calls() -> tuple[tuple[Call, ...], ...]:
    """Calls of every kernel, made by finding boards and calibrating."""
    from tests.fuzz import samples

    import rcdn
    from rcdn.calibration import calibrate
    from rcdn_lab.camera_scenes import CAMERAS, random_boards

    squares, dense = samples.picture(), samples.picture(7, 5, 11.0, (120, 100))
    for grey in (
        squares,
        squares.astype(np.float32),
        dense,
        samples.picture(3, 3, 8.0, (48, 40)),
        np.ascontiguousarray(dense[20:, 30:]),
    ):
        rcdn.Detector().detect(grey)
        rcdn.Detector(rcdn.DetectorConfig.paper()).detect(grey)
    rcdn.Detector(rcdn.DetectorConfig(target="auto")).detect(samples.coded_picture())
    for method in ("peak", "com", "edge"):
        rcdn.Detector(rcdn.DetectorConfig(refine=rcdn.config.Refine(method))).detect(squares)
    rcdn.Detector(rcdn.DetectorConfig(pattern="deltille")).detect(samples.picture(5, 4, 12.0, (110, 90), "deltille"))
    calibrate(random_boards(CAMERAS["pinhole"], 1, views=5)[0], 0.03, model="splined")
    return tuple(tuple(kept) for _, kept in sorted(_calls.items()))


def _call(source: Source) -> Call:
    call = source.choice(source.choice(calls()))
    return Call(call.name, call.kernel, tuple(_changed(source, v) for v in call.values))


def _changed(source: Source, value: Any) -> Any:
    """Another value of the same kind; of a kernel that checks its calls, whole numbers and sizes may change as well."""
    if isinstance(value, tuple):
        return type(value)(*(_changed(source, v) for v in value))
    if not isinstance(value, np.ndarray):
        return _number(source, value) if CHECKED and source.chance(24) else value
    out = value.copy()
    if not out.size or source.byte() % 3 == 0 or (not CHECKED and out.shape[-1:] == (FRAME,)):
        return out
    if CHECKED and out.ndim and source.chance(24):
        return out[: source.below(len(out))]
    if out.dtype.kind == "f":
        return _reals(source, out)
    return (
        _bytes(source, out) if out.dtype == np.uint8 else _whole(source, out) if CHECKED and source.chance(4) else out
    )


def _number(source: Source, value: Any) -> Any:
    return source.real() if isinstance(value, float) else source.integer() if isinstance(value, int) else value


def _reals(source: Source, out: Array) -> Array:
    kind = source.byte() % 6
    with np.errstate(all="ignore"):
        if kind < 3:
            for _ in range(1 + source.below(4)):
                out.flat[source.below(out.size)] = source.real()
        elif kind == 3:
            out[...] = source.real()
        elif kind == 4:
            out *= source.choice(ODD_REALS)
        else:
            out[...] = source.random().choice(ODD_REALS, out.shape)
    return out


def _whole(source: Source, out: Array) -> Array:
    odd = [n for n in (*ODD_INTEGERS, *out.shape, out.size) if np.iinfo(out.dtype).min <= n <= np.iinfo(out.dtype).max]
    for _ in range(1 + source.below(3)):
        out.flat[source.below(out.size)] = source.choice(odd)
    return out


def _bytes(source: Source, values: Array) -> Array:
    """Grey values become any; marks stay 0 or 1."""
    most = 2 if values.max(initial=0) <= 1 else 256
    return source.random().integers(0, most, values.shape).astype(np.uint8)


def _use(call: Call) -> None:
    try:
        call.kernel(*call.values)
    except (MemoryError, TypeError, ValueError, OverflowError):  # a wrong call is refused
        return


TARGETS = [Target("kernels", _call, _use, share=4)]
