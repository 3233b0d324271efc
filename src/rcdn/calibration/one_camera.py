"""Do all views come from one camera at one zoom and focus? If not: which pictures belong together.

Four ways to split the views are tried: by the pictures' names, by their order (zoomed in the middle), by the focal length that each view
asks for, and views that the calibration left out against the rest. A split is suspected if its groups differ by more than views of one
group do among themselves (`rcdn.calibration.influence`), corrected for the number of splits tried, and confirmed by calibrating each group apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtr

from rcdn.calibration.apart import CameraGroup, apart_by, calibrate_apart, significance
from rcdn.calibration.groups import FEWEST, describe, name_partitions, natural_order
from rcdn.calibration.influence import ViewInformation, gains, group_difference, view_information
from rcdn.errors import RcdnError
from rcdn.types import Array, Calibration, Camera
from rcdn.types.arrays import Real

LEVEL = 1e-3
"""probability, corrected for the number of splits, under which one camera is doubted"""
ENOUGH = 6
"""used views, below which nothing is tested"""
LEAST_GROUP = 4
"""views of each side of a change in time or of focal length"""
MOST_CHANGES = 40
"""places where a change is looked for"""
PERMUTATIONS = 2000
"""of the views among groups, for each split tried; the limit of `LEVEL` needs 1000"""
SIMULATIONS = 4000
"""of the views' focal lengths, for two-means"""
HEAVY = 5.0
"""degrees of freedom of the t-distribution that a view's focal length is simulated with"""
BETTER = 0.97
"""× the RMS together: groups by name that aren't told by focal length or principal point must fit that much better apart"""
GROUPED = ((LEVEL, 0.92), (0.03, 0.8))
"""probability of two focal lengths, and × the RMS together: chance and bent boards make groups, too, so these must also fit better apart"""
NEGLIGIBLE = 1e-9
"""of the largest information on the focal length: a view with less has none"""
SURE = 4.0
"""standard deviations by which a figure of groups that were calibrated apart must differ"""
ALIKE = 2.0
"""× the scatter of the used views: views left out that scatter less among themselves are of a camera of their own"""
VISIBLE = 0.5
"""× the RMS: by how much projections of the groups' cameras must differ"""

REMEDY = "Calibrate each group by itself."

By = Literal["names", "order", "focal length", "left out"]


@dataclass(frozen=True, eq=False)
class SeveralCameras:
    """The finding: `groups` of pictures, the largest first; what they were split `by`; `probability` of such a difference if there were one
    camera, corrected for the splits tried; `difference` px of the groups' cameras over the picture, RMS after the best rotation;
    `together` px, the RMS of one camera for all."""

    groups: tuple[CameraGroup, ...]
    by: By
    probability: float
    difference: float
    together: float

    @property
    def sentence(self) -> str:
        """What was found and what to do."""
        return f"{self.finding} {REMEDY}"

    @property
    def finding(self) -> str:
        """Which pictures belong together, and what tells them apart."""
        z = significance(self.groups)
        best = int(np.argmax(z))
        groups = "; ".join(self._group(g, best if z[best] >= SURE else None) for g in self.groups)
        apart = ", ".join(f"{g.rms:.2g}" for g in self.groups)
        return (
            f"The pictures are not of one camera at one zoom and focus: {groups}. RMS apart {apart} px, together "
            f"{self.together:.2g} px."
        )

    def _group(self, group: CameraGroup, parameter: int | None) -> str:
        """A group with the figure in which two groups differ most, if one tells them apart."""
        pictures = f"{len(group.names)} pictures ({group.label})"
        if parameter is None:
            return pictures
        value, std = group.camera.parameters[parameter], group.std[parameter]
        digits = int(np.clip(1 - np.floor(np.log10(max(float(std), 1e-9))), 0, 6))
        return f"{group.camera.parameter_names[parameter]} {value:.{digits}f} ± {std:.{digits}f} in {pictures}"


def one_camera(calibration: Calibration) -> SeveralCameras | None:
    """Whether the views speak against one camera at one zoom and focus; None if they don't.

    With fewer than 6 used views, or without their poses, nothing is tested.
    The probability of a false alarm is about one in a thousand for each way to split.
    """
    views = calibration.used_views
    if any(v.pose is None for v in views):
        return None
    found = _left_out(calibration) if len(views) >= FEWEST else None
    if found is not None or len(views) < ENOUGH or any(v.pose is None for v in views):
        return found
    info = view_information(calibration).at_optimum()
    suspects = sorted(_suspects(calibration, info), key=lambda s: s.probability)
    confirmed = (_confirm(calibration, s) for s in suspects)
    return next((c for c in confirmed if c is not None), None)


@dataclass(frozen=True, eq=False)
class _Suspect:
    """A split of the used views: `members` (V,) number of the group, −1 for none."""

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
    """(P, 3) changes of the parameters: of the logarithm of the focal length, and of the principal point, px."""
    out = np.zeros((len(camera.parameters), 3))
    out[:2, 0] = camera.parameters[:2]
    out[[2, 3], [1, 2]] = 1.0
    return out


def _by_name(names: Sequence[str], info: ViewInformation, directions: Array) -> Iterator[_Suspect]:
    """Each group against all others: by focal length and principal point, and by what a camera of its own would gain among permutations."""
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
    """(n, q) two-sided probabilities of the differences between groups."""
    d = group_difference(info, directions, masks)
    return np.asarray(2 * stdtr(d.freedom, -np.abs(d.value) / np.maximum(d.std, 1e-300)))


def _permuted(info: ViewInformation, mask: Array, splits: int) -> float:
    """The share of random groups of the same size whose own camera gains as much: of few, then,
    if that is small, of enough to correct for `splits`."""
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
    """The most probable change in time, pictures being taken in the order of their names' numbers."""
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
    """Two means of the focal lengths that single views ask for, among simulations of one mean with heavy tails."""
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
    """(n,) by how many times the weighted scatter of `values` (n, V) falls at the best split in two, and (n, V) who is in the lower part.

    Each part has `LEAST_GROUP` views at least, and no part rests on a single one: the largest weight of each part counts only as its second.
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


def _confirm(calibration: Calibration, suspect: _Suspect) -> SeveralCameras | None:
    """Each group calibrated apart, from the common solution; None if the cameras agree after all."""
    views = calibration.used_views
    members = [np.flatnonzero(suspect.members == k) for k in range(int(suspect.members.max()) + 1)]
    groups = [calibrate_apart(calibration, [views[k] for k in m], views) for m in members]
    if any(g is None for g in groups):
        return None
    kept = sorted((g for g in groups if g is not None), key=lambda g: -g.views)
    mean = float(np.sqrt(np.average([g.rms**2 for g in kept], weights=[g.views for g in kept])))
    figures, ratio = bool(significance(kept).max() >= SURE), mean / calibration.rms
    fits = any(suspect.probability < p and ratio < most for p, most in GROUPED)
    agreed = {"names": figures or ratio < BETTER, "order": figures, "focal length": figures and fits}
    if not agreed[suspect.by]:
        return None
    return _finding(calibration, kept, suspect.by, suspect.probability)


def _finding(
    calibration: Calibration, groups: Sequence[CameraGroup], by: By, probability: float
) -> SeveralCameras | None:
    """The finding, if the cameras differ by more than the corners scatter."""
    apart = max(apart_by(groups[0].camera, g.camera) for g in groups[1:])
    if apart < VISIBLE * calibration.rms:
        return None
    return SeveralCameras(tuple(groups), by, min(probability, 1.0), apart, calibration.rms)


def _left_out(calibration: Calibration) -> SeveralCameras | None:
    """Views that were left out as a whole but fit a camera of their own."""
    odd = [v for v in calibration.left_out if v.pose is not None and len(v) >= 2 * FEWEST]
    odd = [v for v in odd if np.median(np.linalg.norm(v.residuals, axis=1)) > ALIKE * calibration.rms]
    if len(odd) < LEAST_GROUP:
        return None
    every = [*calibration.used_views, *odd]
    try:
        other = calibrate_apart(calibration, odd, every, anew=True)
    except (RcdnError, np.linalg.LinAlgError):
        return None
    if other is None or other.rms > ALIKE * calibration.rms or other.views < LEAST_GROUP:
        return None
    names = tuple(dict.fromkeys(v.name for v in calibration.used_views))
    label = describe(names, [v.name for v in odd])
    usual = CameraGroup(names, label, calibration.camera, calibration.std, calibration.rms, len(calibration.used_views))
    if significance((usual, other)).max() < SURE:
        return None
    return _finding(calibration, (usual, other), "left out", 0.0)
