"""Median of a few values, without the overhead of NumPy's function."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array
from rcdn.types.arrays import Real


def median(values: Array) -> float:
    """Median of all values (…), at least one; NaN if any value is NaN."""
    row = np.sort(values, axis=None)
    middle = 0.5 * (row[(row.size - 1) // 2] + row[row.size // 2])
    return float("nan") if np.isnan(row[-1]) else float(middle)


def medians(values: Real[Array, "k n"]) -> Real[Array, " k"]:
    """Median (K,) of each row of `values` (K, N), N ≥ 1; NaN for a row that contains NaN."""
    rows, count = np.sort(values, axis=1), values.shape[1]
    middle = 0.5 * (rows[:, (count - 1) // 2] + rows[:, count // 2])
    return np.where(np.isnan(rows[:, -1]), np.nan, middle)
