"""Test of whether all views come from one camera at one zoom and focus; if not, which pictures belong together.

Four ways to split the views are tested: by the pictures' names, by their order (a change of zoom in the middle), by the
focal length that each view alone suggests, and views that the calibration left out against the rest. A split is a
candidate if its groups differ by more than the views within one group do (`rcdn.calibration.influence`), corrected for
the number of splits tested, and is confirmed by calibrating each group separately.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from rcdn.calibration.apart import CameraGroup, apart_by, calibrate_apart, rms_of, significance
from rcdn.calibration.groups import FEWEST, describe, name_partitions, natural_order
from rcdn.calibration.influence import ViewInformation, gains, group_difference, view_information
from rcdn.errors import RcdnError, two_digits
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Real

LEVEL = 1e-3
"""significance level, corrected for the number of splits, below which the hypothesis of one camera is rejected"""
ENOUGH = 6
"""least number of used views for the test"""
LEAST_GROUP = 4
"""least number of views on each side of a split by order or by focal length"""
MOST_CHANGES = 40
"""most positions at which a change over time is tested"""
PERMUTATIONS = 2000
"""random assignments of the views to groups, for each split tested; the level `LEVEL` needs 1000"""
SIMULATIONS = 4000
"""simulated sets of focal lengths, for the test of two means"""
HEAVY = 5.0
"""degrees of freedom of the t-distribution from which a view's focal length is simulated"""
BETTER = 0.97
"""× the joint RMS: groups by name that differ neither in focal length nor in principal point must reach a separate RMS
below this"""
GROUPED = ((LEVEL, 0.92), (0.03, 0.8))
"""pairs (probability of two focal lengths, × the joint RMS): chance and bent boards produce groups, too, so that the
separate RMS must also be below the second"""
NEGLIGIBLE = 1e-9
"""× the largest information on the focal length of any view: a view with less does not count as informative"""
SURE = 4.0
"""standard deviations by which a parameter must differ between groups that were calibrated separately"""
ALIKE = 2.0
"""× the scatter of the used views: left-out views that scatter less among themselves come from another camera"""
VISIBLE = 0.5
"""× the RMS: least difference of the projections of the groups' cameras"""

REMEDY = "Calibrate each group by itself."

By = Literal["names", "order", "focal length", "left out"]


@dataclass(frozen=True, eq=False)
class SeveralCameras:
    """The finding: `groups` of pictures, the largest first; the kind of split, `by`; `probability` of such a difference
    under one camera, corrected for the splits tested; `difference` of the groups' cameras over the picture, px RMS
    after the best rotation; `together`, the RMS of one camera for all pictures, px."""

    groups: tuple[CameraGroup, ...]
    by: By
    probability: float
    difference: float
    together: float

    @property
    def finding(self) -> str:
        """Which pictures belong together, and in which parameter the groups differ."""
        z = significance(self.groups)
        best = int(np.argmax(z))
        groups = "; ".join(self._group(g, best if z[best] >= SURE else None) for g in self.groups)
        apart = ", ".join(two_digits(g.rms) for g in self.groups)
        return (
            f"The pictures are not of one camera at one zoom and focus: {groups}. RMS apart {apart} px, together "
            f"{two_digits(self.together)} px."
        )

    def _group(self, group: CameraGroup, parameter: int | None) -> str:
        """A group, with the `parameter` in which the groups differ most, if there is a significant one."""
        pictures = f"{len(group.names)} pictures ({group.label})"
        if parameter is None:
            return pictures
        value, std = group.camera.parameters[parameter], group.std[parameter]
        digits = int(np.clip(1 - np.floor(np.log10(max(float(std), 1e-9))), 0, 6))
        return f"{group.camera.parameter_names[parameter]} {value:.{digits}f} ± {std:.{digits}f} in {pictures}"


def one_camera(calibration: Calibration) -> SeveralCameras | None:
    """The evidence against one camera at one zoom and focus; None if there is none.

    With fewer than 6 used views only the left-out views are tested; if a used view has no pose, nothing is tested.
    The false-positive rate is about one in a thousand for each way to split.
    """
    views = calibration.used_views
    if any(v.pose is None for v in views):
        return None
    found = _left_out(calibration) if len(views) >= FEWEST else None
    if found is not None or len(views) < ENOUGH or any(v.pose is None for v in views):
        return found
    info = view_information(calibration).at_optimum()
    suspects = sorted(_suspects(calibration, info), key=lambda s: s.probability)
    joint = _joint(calibration) if suspects else None
    confirmed = (_confirm(calibration, s, joint) for s in suspects if joint is not None)
    return next((c for c in confirmed if c is not None), None)


def _joint(c: Calibration) -> CameraGroup:
    """All used views as one group: without a smooth correction, as groups are calibrated."""
    views = c.used_views
    found = None if c.camera.correction is None else calibrate_apart(c, views, views)
    names = tuple(dict.fromkeys(v.name for v in views))
    return found or CameraGroup(names, "", c.camera, c.std, c.rms, len(views))


@dataclass(frozen=True, eq=False)
class _Suspect:
    """A candidate split of the used views: `members` (V,) group number of each, −1 for none."""

    by: By
    members: Array
    probability: float


def _suspects(calibration: Calibration, info: ViewInformation) -> Iterator[_Suspect]:
    names = [v.name for v in calibration.used_views]
    directions = _directions(calibration.camera)
    yield from _by_name(names, info, directions)
    yield from _by_order(names, info, directions)
    yield from _by_focal_length(info, directions[:, 0])


def _directions(camera: Camera) -> Real[Array, "p 3"]:
    """(P, 3) directions in the space of the parameters: logarithm of the focal length, and the principal point's x and
    y, px."""
    out = np.zeros((len(camera.parameters), 3))
    out[:2, 0] = camera.parameters[:2]
    out[[2, 3], [1, 2]] = 1.0
    return out


def _by_name(names: Sequence[str], info: ViewInformation, directions: Array) -> Iterator[_Suspect]:
    """Each group against all others: by focal length and principal point, and by the improvement that a separate camera
    brings, compared with random permutations of the views."""
    partitions = [np.array(p) for p in name_partitions(names)]
    splits = [(p, p == k) for p in partitions for k in range(p.max() + (p.max() > 1 or -1 in p))]
    if not splits:
        return
    masks = np.array([mask for _, mask in splits])
    differ = _probabilities(info, directions, masks).min(axis=1) * directions.shape[1]
    for (members, mask), p in zip(splits, differ, strict=True):
        if p * len(splits) >= LEVEL:
            p = min(p, _permuted(info, mask, len(splits)))
        if p * len(splits) < LEVEL:
            yield _Suspect("names", members, float(p * len(splits)))


def _probabilities(info: ViewInformation, directions: Array, masks: Array) -> Real[Array, "n q"]:
    """(n, q) two-sided p-values of the differences between groups."""
    from scipy.special import stdtr  # here: without it a calibration needs no SciPy until its verdict

    d = group_difference(info, directions, masks)
    return np.asarray(2 * stdtr(d.freedom, -np.abs(d.value) / np.maximum(d.std, 1e-300)))


def _permuted(info: ViewInformation, mask: Array, splits: int) -> float:
    """The p-value of a permutation test: the share of random groups of the same size whose separate camera brings at
    least the same improvement. If a first, small number of permutations gives a low share, enough are drawn to correct
    for `splits`."""
    share = 1.0
    for many in (200, PERMUTATIONS * splits):
        rng = np.random.default_rng(0)
        shuffled = rng.permuted(np.broadcast_to(mask, (many, len(mask))), axis=1)
        gain = gains(info, np.concatenate([mask[None], shuffled]))
        share = float((1 + (gain[1:] >= gain[0]).sum()) / (1 + many))
        if share > 0.01:
            break
    return share


def _by_order(names: Sequence[str], info: ViewInformation, directions: Array) -> Iterator[_Suspect]:
    """The most significant change over time, if pictures were taken in the order of the numbers in their names."""
    place = np.empty(len(names), int)
    place[natural_order(names)] = np.arange(len(names))
    changes = np.arange(LEAST_GROUP, len(names) - LEAST_GROUP + 1)
    if not len(changes):
        return
    changes = changes[np.unique(np.linspace(0, len(changes) - 1, MOST_CHANGES).astype(int))]
    masks = place >= changes[:, None]
    p = _probabilities(info, directions, masks)
    best = int(np.argmin(p.min(axis=1)))
    if p.min() * p.size < LEVEL:
        yield _Suspect("order", masks[best].astype(int), float(p.min() * p.size))


def _by_focal_length(info: ViewInformation, direction: Array) -> Iterator[_Suspect]:
    """Two clusters of the focal lengths that single views suggest, tested against simulations of one mean with heavy
    tails."""
    weight = np.einsum("a,vab,b->v", direction, info.information, direction)
    if len(info) < 2 * LEAST_GROUP or not (weight > NEGLIGIBLE * weight.max()).all():
        return
    value = info.score @ direction / weight
    ratio, low = _two_means(value[None], weight)
    drawn = np.random.default_rng(0).standard_t(HEAVY, (SIMULATIONS, len(info))) / np.sqrt(weight)
    p = float((1 + (_two_means(drawn, weight)[0] >= ratio[0]).sum()) / (1 + SIMULATIONS))
    if p < GROUPED[-1][0]:
        yield _Suspect("focal length", np.where(low[0], 0, 1), p)


def _two_means(values: Real[Array, "n v"], weight: Array) -> tuple[Array, Array]:
    """(n,) ratio by which the weighted scatter of `values` (n, V) falls at the best split in two, and (n, V) which
    values are in the lower part.

    Each part has at least `LEAST_GROUP` views.
    """
    order = np.argsort(values, axis=1)
    x, w = np.take_along_axis(values, order, axis=1), weight[order]
    many = np.arange(LEAST_GROUP, values.shape[1] - LEAST_GROUP + 1)
    sums = [np.cumsum(w * x**k, axis=1) for k in range(3)]
    below = [s[:, many - 1] for s in sums]
    above = [s[:, -1:] - b for s, b in zip(sums, below, strict=True)]
    within = sum(b[2] - b[1] ** 2 / b[0] for b in (below, above))
    total = sums[2][:, -1] - sums[1][:, -1] ** 2 / sums[0][:, -1]
    best = np.argmin(within, axis=1)
    rows = np.arange(len(values))
    rank = np.argsort(order, axis=1)
    return total / np.maximum(within[rows, best], 1e-300), rank < many[best][:, None]


def _confirm(calibration: Calibration, suspect: _Suspect, joint: CameraGroup) -> SeveralCameras | None:
    """Each group calibrated separately, starting from the joint solution; None if the cameras do not differ after all.
    `joint`: all of them as one group."""
    views = calibration.used_views
    members = [np.flatnonzero(suspect.members == k) for k in range(int(suspect.members.max()) + 1)]
    groups = [calibrate_apart(calibration, [views[k] for k in m], views) for m in members]
    if any(g is None for g in groups):
        return None
    kept = sorted((g for g in groups if g is not None), key=lambda g: -g.views)
    figures, ratio = bool(significance(kept).max() >= SURE), rms_of(kept) / joint.rms
    fits = any(suspect.probability < p and ratio < most for p, most in GROUPED)
    agreed = {"names": figures or ratio < BETTER, "order": figures, "focal length": figures and fits}
    if not agreed[suspect.by]:
        return None
    return _finding(kept, suspect.by, suspect.probability, joint)


def _finding(groups: Sequence[CameraGroup], by: By, probability: float, joint: CameraGroup) -> SeveralCameras | None:
    """The finding, if the cameras differ by more than the corners' scatter."""
    apart = max(apart_by(groups[0].camera, g.camera) for g in groups[1:])
    if apart < VISIBLE * joint.rms:
        return None
    return SeveralCameras(tuple(groups), by, min(probability, 1.0), apart, joint.rms)


def _left_out(calibration: Calibration) -> SeveralCameras | None:
    """Views that were left out as a whole but are consistent with a camera of their own."""
    odd = [v for v in calibration.left_out if v.pose is not None and len(v) >= 2 * FEWEST]
    odd = [v for v in odd if np.median(np.linalg.norm(v.residuals, axis=1)) > ALIKE * calibration.rms]
    if len(odd) < LEAST_GROUP:
        return None
    every = [*calibration.used_views, *odd]
    try:
        other = calibrate_apart(calibration, odd, every, anew=True)
    except (RcdnError, np.linalg.LinAlgError):
        return None
    joint = _joint(calibration)
    if other is None or other.rms > ALIKE * joint.rms or other.views < LEAST_GROUP:
        return None
    majority = replace(joint, label=describe(joint.names, [v.name for v in odd]))
    if significance((majority, other)).max() < SURE:
        return None
    return _finding((majority, other), "left out", 0.0, joint)
