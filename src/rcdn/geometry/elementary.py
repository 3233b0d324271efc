"""Elementary functions with bit-identical results on every processor; those of NumPy and of the C library depend on the
processor's vector instructions.

Detection uses these; for results that are only displayed or compared with a tolerance, NumPy's functions suffice.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rcdn.native import bind
from rcdn.types import Array

_exp, _log, _erf = bind("rcdn_exp"), bind("rcdn_log"), bind("rcdn_erf")
_cos_sin, _arctan2 = bind("rcdn_cos_sin"), bind("rcdn_arctan2")


def exp(x: Any) -> Array:
    """exp x, of the shape of `x`, with a relative error below 2e-16; 0 below −707."""
    x = _doubles(x)
    out = np.empty_like(x)
    _exp(x.ravel(), out.ravel())
    return out


def log(x: Any) -> Array:
    """ln x, of the shape of `x`; −inf at 0, NaN for negative x."""
    x = _doubles(x)
    out = np.empty_like(x)
    _log(x.ravel(), out.ravel())
    return out


def erf(x: Any) -> Array:
    """The error function of x, of the shape of `x`, with an error below 1e-15."""
    x = _doubles(x)
    out = np.empty_like(x)
    _erf(x.ravel(), out.ravel())
    return out


def cos_sin(x: Any) -> tuple[Array, Array]:
    """cos x and sin x, each of the shape of `x`, radians; NaN beyond a million."""
    x = _doubles(x)
    cosine, sine = np.empty_like(x), np.empty_like(x)
    _cos_sin(x.ravel(), cosine.ravel(), sine.ravel())
    return cosine, sine


def arctan2(y: Any, x: Any) -> Array:
    """The angle of (x, y) in [−π, π], of their broadcast shape, radians; 0 for (0, 0)."""
    y, x = (_doubles(v) for v in np.broadcast_arrays(y, x))
    out = np.empty_like(x)
    _arctan2(y.ravel(), x.ravel(), out.ravel())
    return out


def _doubles(x: Any) -> Array:
    return np.array(x, np.float64, order="C")
