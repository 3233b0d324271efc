"""What all values share: arrays of a stated shape that nobody can change."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from rcdn.errors import RcdnError

Array = NDArray[Any]


def freeze(owner: object, name: str, value: Any, dtype: Any, tail: tuple[int, ...]) -> None:
    array = np.array(value, dtype=dtype)
    if array.size == 0:
        array = array.reshape((0, *tail))
    if array.ndim != 1 + len(tail) or array.shape[1:] != tail:
        raise RcdnError(
            f"{type(owner).__name__}.{name} must have shape (N, {', '.join(map(str, tail))}), not {array.shape}"
        )
    array.setflags(write=False)
    object.__setattr__(owner, name, array)
