"""Selection of the pictures from which to calibrate: few whose camera comes near to that of all.

From the views of a calibration, each with its information on the camera (its own pose eliminated), subsets are selected
that minimise the mean variance of projections over the frame: I-optimal design (Atkinson, Donev and Tobias, Optimum
Experimental Designs, 2007, §10.6), first greedily, then by exchanging one picture for another as long as that reduces
the variance (Fedorov 1972). How far the outliers, the weights and the board's shape that few pictures give differ from
those of all is not part of any information. So several such subsets, from randomly weighted information, are
calibrated, and that is selected whose camera differs least from the camera of all.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rcdn.calibration.candidates import frame_grid
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.influence import view_information
from rcdn.calibration.uncertainty import unrotated_jacobian
from rcdn.errors import ConfigError, RcdnError, shown
from rcdn.types import Array, BoardView, Calibration
from rcdn.types.arrays import Real

PRIOR = 1e-4
"""× the information of all views: added as prior information, so that the variance is finite with few views, too"""
ROUNDS = 20
"""most rounds of exchanges"""
TRIED = 16
"""number of subsets that are calibrated"""
GAMMA = 2.0
"""shape of the gamma distribution of mean 1 from which the weights of the pictures' information are drawn"""


def selected(
    calibration: Calibration, many: int, solve: Callable[[tuple[str, ...]], Calibration]
) -> tuple[tuple[str, ...], Calibration]:
    """The `many` pictures of `calibration` to keep, by name, in the order of its views, and their calibration: of
    TRIED informative subsets the one whose camera differs least from that of all, root mean square over the frame. All
    used pictures if there are no more.

    `solve` returns the calibration of the pictures of given names. Raises ConfigError unless `many` is at least 3, and
    the last RcdnError of `solve` if no subset determines a camera.
    """
    best: tuple[tuple[str, ...], Calibration] | None = None
    least = np.inf
    failure: RcdnError = ConfigError("the calibration has no pictures to select from")
    for names in informative_subsets(calibration, many, TRIED):
        try:
            done = solve(names)
            off = camera_difference(calibration.camera, done.camera).rms
        except RcdnError as error:
            failure = error
            continue
        if off < least:
            least, best = off, (names, done)
    if best is None:
        raise failure
    return best


def informative_subsets(calibration: Calibration, many: int, tries: int) -> tuple[tuple[str, ...], ...]:
    """Up to `tries` different subsets of `many` pictures of `calibration`, by name, in the order of its views: first
    that with the most information about its camera, then those with the most if each picture's information is
    multiplied by a random weight. One subset of all used pictures if there are no more. The information of pictures
    whose boards have a larger scatter is reduced accordingly. Raises ConfigError unless `many` is at least 3."""
    if many < 3:
        raise ConfigError(f"many must be at least 3 pictures, not {shown(many)}")
    views = calibration.used_views
    names = list(dict.fromkeys(v.name for v in views))
    if len(names) <= many:
        return (tuple(names),)
    information = _by_picture(calibration, views, names)
    jacobian, there = unrotated_jacobian(calibration.camera, frame_grid(calibration.camera.image_size))
    rows = jacobian[there].reshape(-1, jacobian.shape[2])
    rng = np.random.default_rng(0)
    weights = [np.ones(len(names)), *(rng.gamma(GAMMA, 1 / GAMMA, len(names)) for _ in range(tries - 1))]
    each = (weight[:, None, None] * information for weight in weights)
    subsets = (_exchanged(_greedy(many, one, rows), one, rows) for one in each)
    return tuple(dict.fromkeys(tuple(names[k] for k in sorted(some)) for some in subsets))


def _by_picture(calibration: Calibration, views: Sequence[BoardView], names: list[str]) -> Real[Array, "n p p"]:
    """(N, P, P) information of each picture."""
    each = view_information(calibration).information
    scatter = np.array([v.rms for v in views])
    typical = float(np.median(scatter))
    each = each * np.minimum(1.0, (typical / np.maximum(scatter, 1e-12)) ** 2)[:, None, None]
    out = np.zeros((len(names), *each.shape[1:]))
    np.add.at(out, [names.index(v.name) for v in views], each)
    return out


def _greedy(many: int, information: Array, rows: Array) -> list[int]:
    """The `many` indices that reduce the mean variance most, added one after the other."""
    chosen: list[int] = []
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
