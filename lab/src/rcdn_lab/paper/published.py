"""The paper's Tables 2 and 3, as printed."""

from __future__ import annotations

COLUMNS = ("Mesa", "uEye", "GoPro")
"""The data sets of section 4.1: Mesa SR4000, IDS uEye, GoPro Hero 3."""
CROSS_ENTROPY, SQUARED = "A + cross entropy", "A + MSE"
Rates = dict[str, tuple[float, float]]
"""data set → precision and recall"""


def _rates(*values: float) -> Rates:
    return {name: (values[2 * k], values[2 * k + 1]) for k, name in enumerate(COLUMNS)}


TABLE2: dict[tuple[str, str], Rates] = {
    (CROSS_ENTROPY, "0.5"): _rates(0.9675, 1.0000, 0.9296, 0.9996, 0.9452, 0.9996),
    (CROSS_ENTROPY, "std"): _rates(0.9996, 0.9980, 0.9987, 0.9942, 0.5123, 1.0000),
    (CROSS_ENTROPY, "max"): _rates(0.9992, 0.9988, 0.9961, 0.9976, 1.0000, 0.9983),
    (CROSS_ENTROPY, "adaptive"): _rates(0.9996, 0.9977, 0.9993, 0.9899, 1.0000, 0.9970),
    (SQUARED, "0.5"): _rates(0.9831, 1.0000, 0.9263, 0.9995, 0.9881, 0.9996),
    (SQUARED, "std"): _rates(0.9992, 0.9960, 0.9939, 0.9937, 0.1703, 1.0000),
    (SQUARED, "max"): _rates(0.9973, 0.9985, 0.9959, 0.9957, 1.0000, 0.9963),
    (SQUARED, "adaptive"): _rates(0.9988, 0.9970, 0.9982, 0.9850, 1.0000, 0.9959),
}
"""(network, threshold) → rates. `std` is Std-(0.8) and Std-(1.7), `max` is 0.41*maximum and 0.57*maximum."""

TABLE3: dict[str, Rates] = {
    "A": TABLE2[CROSS_ENTROPY, "adaptive"],
    "B": _rates(0.9996, 0.9988, 0.9979, 0.9958, 1.0000, 0.9980),
    "C": _rates(0.9984, 0.9975, 0.9776, 0.9987, 1.0000, 0.9980),
    "D-1": _rates(0.9996, 0.9991, 0.9989, 0.9961, 1.0000, 0.9987),
    "D-3": _rates(0.9995, 0.9987, 0.9984, 0.9957, 1.0000, 0.9983),
    "E-16": _rates(0.9995, 0.9987, 0.9924, 0.9977, 1.0000, 0.9994),
    "E-32": _rates(0.9984, 0.9993, 0.9955, 0.9991, 1.0000, 0.9994),
    "F": _rates(0.9997, 0.9992, 0.9986, 0.9996, 0.9994, 0.9996),
    "G": _rates(0.9990, 0.9993, 0.9933, 0.9993, 1.0000, 0.9994),
    "H": _rates(0.9996, 0.9995, 0.9961, 0.9987, 1.0000, 0.9991),
    "MATE": _rates(0.9988, 0.9970, 0.9982, 0.9850, 1.0000, 0.9959),
    "ChESS": _rates(0.9640, 0.8191, 0.9884, 0.9622, 0.9602, 0.8267),
}
"""Network → rates under the adaptive threshold. The paper's Table 3 has no row for A: it is taken from Table 2."""
