"""Selection of the pictures from which to calibrate: the subset with the most information about the camera.

From the views of a calibration, each with its information on the camera (its own pose eliminated), the subset is
selected that minimises the mean variance of projections over the frame: I-optimal design (Atkinson, Donev and Tobias,
Optimum Experimental Designs, 2007, §10.6), first greedily, then by exchanging one picture for another as long as that
reduces the variance (Fedorov 1972).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rcdn.calibration.candidates import frame_grid
from rcdn.calibration.influence import view_information
from rcdn.calibration.uncertainty import unrotated_jacobian
from rcdn.errors import ConfigError, shown
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Real

PRIOR = 1e-4
"""× the information of all views: added as prior information, so that the variance is finite with few views, too"""
ROUNDS = 20
"""most rounds of exchanges"""


def most_informative(calibration: Calibration, many: int) -> tuple[str, ...]:
    """The names of the `many` pictures of `calibration` with the most information about its camera, in the order of its
    views; all used ones if there are no more. The information of pictures whose boards have a larger scatter is reduced
    accordingly. Raises ConfigError unless `many` is at least 3."""
    if many < 3:
        raise ConfigError(f"many must be at least 3 pictures, not {shown(many)}")
    views = calibration.used_views
    names = list(dict.fromkeys(v.name for v in views))
    if len(names) <= many:
        return tuple(names)
    information = _by_picture(calibration, views, names)
    jacobian, there = unrotated_jacobian(calibration.camera, frame_grid(calibration.camera.image_size))
    rows = jacobian[there].reshape(-1, jacobian.shape[2])
    some = _exchanged(_greedy([], many, information, rows), information, rows)
    return tuple(names[k] for k in sorted(some))


def _by_picture(calibration: Calibration, views: Sequence[BoardView], names: list[str]) -> Real[Array, "n p p"]:
    """(N, P, P) information of each picture."""
    each = view_information(calibration).information
    scatter = np.array([v.rms for v in views])
    typical = float(np.median(scatter))
    each = each * np.minimum(1.0, (typical / np.maximum(scatter, 1e-12)) ** 2)[:, None, None]
    out = np.zeros((len(names), *each.shape[1:]))
    np.add.at(out, [names.index(v.name) for v in views], each)
    return out


def _greedy(chosen: list[int], many: int, information: Array, rows: Array) -> list[int]:
    """`chosen` and the indices that reduce the mean variance most, added one after the other, up to `many`."""
    chosen = list(chosen)
    while len(chosen) < many:
        variance = _with_one_more(chosen, information, rows)
        chosen.append(int(np.argmin(variance)))
    return chosen


def _exchanged(chosen: list[int], information: Array, rows: Array) -> list[int]:
    """`chosen` after exchanges of one index for another that reduce the mean variance."""
    for _ in range(ROUNDS):
        before = list(chosen)
        for k in list(chosen):
            rest = [c for c in chosen if c != k]
            chosen = [*rest, int(np.argmin(_with_one_more(rest, information, rows)))]
        if set(chosen) == set(before):
            break
    return chosen


def _with_one_more(chosen: list[int], information: Array, rows: Array) -> Real[Array, " n"]:
    """(N,) mean variance of projections with each of the others in addition to `chosen`; infinite for those already
    chosen."""
    prior = PRIOR * information.sum(axis=0)
    ridge = 1e-12 * np.diag(np.diag(information.sum(axis=0)))
    total = information + information[chosen].sum(axis=0) + prior + ridge
    scale = np.sqrt(np.diag(information.sum(axis=0)))
    scale = np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(total / np.outer(scale, scale), hermitian=True)
    gram = (rows / scale).T @ (rows / scale) / len(rows)
    variance = np.einsum("nij,ji->n", inverse, gram)
    variance[chosen] = np.inf
    return np.asarray(variance)
