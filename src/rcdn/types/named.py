"""An array whose elements can also be accessed by name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, overload

import numpy as np

from rcdn.types.base import Array


class Named(np.ndarray[Any, np.dtype[np.float64]]):
    """A (N,) float64 array whose elements also have names: `std["fx"]` is `std[0]`.

    It behaves like any array in computations; results and slices have no names, since the names need not apply to them.
    `dict(std.items())` is a plain mapping. Raises KeyError, which lists the names, for an unknown name.
    """

    names: tuple[str, ...]

    def __new__(cls, values: Iterable[float] | Array, names: Sequence[str]) -> Named:
        numbers = np.array(values, np.float64).view(cls)
        if numbers.shape != (len(names),):
            raise ValueError(f"{len(names)} names for numbers of shape {numbers.shape}")
        numbers.names = tuple(names)
        return numbers

    def __array_finalize__(self, source: object) -> None:
        self.names = ()

    def __array_wrap__(self, array: Any, context: Any = None, return_scalar: bool = False) -> Any:
        return np.asarray(array)[()]  # a scalar, not a 0-dimensional array, in all versions of NumPy

    @overload
    def __getitem__(self, key: str) -> float: ...
    @overload
    def __getitem__(self, key: Any) -> Any: ...
    def __getitem__(self, key: Any) -> Any:
        if not isinstance(key, str):
            return np.asarray(self)[key]
        if key not in self.names:
            raise KeyError(f"{key}: not one of {', '.join(self.names)}")
        return float(np.asarray(self)[self.names.index(key)])

    def __contains__(self, key: object) -> bool:
        return key in self.names if isinstance(key, str) else bool((np.asarray(self) == key).any())

    def keys(self) -> tuple[str, ...]:
        """The names, in order."""
        return self.names

    def items(self) -> Iterator[tuple[str, float]]:
        """Each name with its number."""
        return zip(self.names, self.tolist(), strict=True)

    def __repr__(self) -> str:
        some = [f"{name}: {value:.4g}" for name, value in zip(self.names[:MANY], self.tolist(), strict=False)]
        return f"<{', '.join(some)}{f', … {len(self)} in all' if len(self) > MANY else ''}>"

    __str__ = __repr__

    def __copy__(self) -> Named:
        return Named(self, self.names)

    def __deepcopy__(self, memo: object) -> Named:
        return Named(self, self.names)

    def __reduce__(self) -> Any:
        return Named, (np.asarray(self), self.names)


MANY = 12
"""largest number of elements in a `repr`"""
