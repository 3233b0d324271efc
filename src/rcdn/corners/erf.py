"""The error function in single precision, several times faster than the library's."""

from __future__ import annotations

import numpy as np

from rcdn.types import Array

TANH = np.array([3.22497554e-05, -4.15182660e-04, -4.96721319e-04, 1.02932856e-01, 1.12835818], np.float32)
"""erf x = tanh(x · this polynomial of x²), highest power first; fitted to the smallest largest error, 3e-6"""
LARGEST = np.float32(16)
"""x² beyond which erf is 1"""


def erf(x: Array) -> Array:
    """The error function of `x`, float32 (...); within 4e-6."""
    square = np.minimum(x * x, LARGEST)
    slope = TANH[0] * square
    for term in TANH[1:-1]:
        slope += term
        slope *= square
    slope += TANH[-1]
    slope *= x
    return np.asarray(np.tanh(slope, out=slope))
