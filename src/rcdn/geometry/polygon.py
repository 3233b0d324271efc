"""Points in polygons."""

from __future__ import annotations

import numpy as np

from rcdn.native import bind
from rcdn.types import Array

_depth = bind("rcdn_depth")


def depth(polygon: Array, xy: Array) -> Array:
    """How deep points `xy` (M, 2) lie in a `polygon` (N, 2): their distances (M,) from its outline, negative outside."""
    polygon, xy = (np.ascontiguousarray(a, np.float64).reshape(-1, 2) for a in (polygon, xy))
    out = np.empty(len(xy))
    _depth(polygon, xy, out)
    return out
