"""Facts on a rig's solution: pairs of cameras, components that no board connects, time shifts, and the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration.advice import judged
from rcdn.calibration.known_lens import judged_known
from rcdn.calibration.limits import growth, reason
from rcdn.calibration.rig_start import Key
from rcdn.calibration.verdict import against_camera, verdict_of
from rcdn.errors import present
from rcdn.types import (
    BoardView,
    Calibration,
    MissingLink,
    Reason,
    RigCalibration,
    RigPair,
    TimeShift,
)


def pairs_of(
    order: Sequence[str],
    cameras: Sequence[Calibration],
    sights: Sequence[Mapping[Key, int]],
    epipolar: Mapping[tuple[str, str], float],
) -> tuple[RigPair, ...]:
    """All pairs of cameras that saw boards together. `epipolar`: their distances from epipolar planes, px, as far as
    known."""
    out = []
    for a in range(len(order)):
        for b in range(a + 1, len(order)):
            shared = [(sights[a][key], sights[b][key]) for key in sights[a] if key in sights[b]]
            views = [(cameras[a].views[k], cameras[b].views[m]) for k, m in shared]
            good = [v for pair in views for v in pair if not pair[0].reason and not pair[1].reason]
            if shared:
                gap = epipolar.get((order[a], order[b]), float("nan"))
                out.append(RigPair(order[a], order[b], len(shared), len(good) // 2, _rms(good), gap))
    return tuple(out)


def least_known(found: RigCalibration) -> tuple[str, str] | None:
    """The camera, except the first, with the most uncertain centre, and the one it shared the most boards with ("":
    none); None without a choice."""
    rig = found.rig
    if rig.covariance is None or len(rig) < 3:
        return None
    spread = {name: float(np.trace(present(rig.centre_covariance(name), "covariance"))) for name in rig.names[1:]}
    name = max(spread, key=lambda n: spread[n])
    shared = {p.second if p.first == name else p.first: p.used for p in found.pairs if name in (p.first, p.second)}
    return name, max(shared, key=lambda n: shared[n], default="")


def _rms(views: Sequence[BoardView]) -> float:
    gaps = np.concatenate([v.residuals[v.used] for v in views] or [np.zeros((0, 2))])
    return float(np.sqrt((gaps**2).sum(axis=1).mean())) if len(gaps) else float("nan")


def links_of(
    order: Sequence[str],
    cameras: Sequence[Calibration],
    parts: Sequence[Sequence[int]],
    when: Sequence[Sequence[str]],
) -> tuple[MissingLink, ...]:
    """For each component but the largest, the two cameras and images that come nearest to joining it to the others.

    These are images of one moment in which both cameras see the most corners, or else the images with the most corners.
    """
    links = []
    for part in parts[1:]:
        rest = [c for other in parts if other is not part for c in other]
        links.append(
            max((_link(order, cameras, when, a, b) for a in rest for b in part), key=lambda scored: scored[0])[1]
        )
    return tuple(links)


def _link(
    order: Sequence[str], cameras: Sequence[Calibration], when: Sequence[Sequence[str]], a: int, b: int
) -> tuple[tuple[bool, int], MissingLink]:
    one, two = (dict(sorted(zip(when[c], cameras[c].views, strict=True), key=lambda i: len(i[1]))) for c in (a, b))
    common = [m for m in one if m in two]
    if common:
        best = max(common, key=lambda m: min(len(one[m]), len(two[m])))
        views, score = (one[best], two[best]), min(len(one[best]), len(two[best]))
    else:
        views = tuple(max(side.values(), key=len) for side in (one, two))  # type: ignore[assignment]
        score = min(map(len, views))
    return (bool(common), score), MissingLink(order[a], order[b], views[0].name, views[1].name, bool(common))


def judged_rig(found: RigCalibration, correct_time: bool = False) -> RigCalibration:
    """`found` with its verdict and those of its cameras; `correct_time`: a correction of its time shifts was tried."""
    cameras = {
        name: judged_known(camera) if name in found.given else judged(camera) for name, camera in found.cameras.items()
    }
    reasons = [
        *_rig_reasons(found, correct_time),
        *(r for name, c in cameras.items() for r in against_camera(name, name, c.verdict)),
    ]
    return replace(found, cameras=cameras, verdict=verdict_of(reasons))


def _rig_reasons(found: RigCalibration, correct_time: bool) -> list[Reason]:
    late = {name: s for name, s in (found.shifts or {}).items() if s.clear and name not in found.corrected}
    in_step = _lateness({name: s for name, s in (found.shifts or {}).items() if name in found.corrected})
    factor = max(growth(c.image_size) for c in found.rig.cameras)
    return [
        reason(
            "components", len(found.components), "Boards connect all cameras.",
            f"Boards connect only {' – '.join(', '.join(part) for part in found.components)}.",
            " ".join([*map(_join, found.links), *_flips(found)]),
        ),
        reason(
            "thin", len(found.thin), "Every camera shares several boards with the others.",
            f"One board alone tells where {', '.join(found.thin)} stands." if len(found.thin) == 1
            else f"One board alone tells where each of {', '.join(found.thin)} stands.",
            "Film the board where that camera and a neighbour both see it whole, in 5 places or more.",
        ),
        reason(
            "rig_rms", found.rms, "All cameras explain the corners about as well as they can be found.",
            f"An RMS of {found.rms:.2f} px of all cameras is high.", "Look at the pairs of the highest RMS.",
            factor=factor,
        ),
        reason(
            "time_shift", len(late),
            f"Brought into step: {in_step}." if in_step else "No camera is out of step, as far as moving boards tell.",
            f"Out of step: {_lateness(late)}.",
            "Trigger the cameras together, or hold the board still: correcting it did not explain the corners better."
            if correct_time
            else "Trigger the cameras together, hold the board still, or have it corrected (--correct-time; in Python "
            "correct_time=True).",
        ),
        *_of_boards(found),
    ]  # fmt: skip


def _of_boards(found: RigCalibration) -> list[Reason]:
    """Whether boards that are said to be fixed to each other are."""
    sets: dict[int, list[str]] = {}
    for board in found.fixed_boards:
        sets.setdefault(board.first, []).append(board.name)
    parts = " – ".join(", ".join(names) for names in sets.values())
    return [
        reason(
            "fixed_boards", len(sets), "The boards keep their places to each other.",
            f"Only these boards keep their places to each other: {parts}.",
            "Show boards of different parts at one moment, turned to several sides; "
            "or leave --fixed-boards (in Python fixed_boards) out if they were moved.",
        )
    ] if sets else []  # fmt: skip


def _lateness(shifts: Mapping[str, TimeShift]) -> str:
    return ", ".join(f"{name} is {lateness(s)}" for name, s in shifts.items())


def lateness(shift: TimeShift) -> str:
    """How late or early a camera is, with its standard deviation, if that is known."""
    spread = f" ± {shift.std:.3f}" if np.isfinite(shift.std) else ""
    return f"{abs(shift.moments):.3f}{spread} frames {'late' if shift.moments >= 0 else 'early'}"


def _flips(found: RigCalibration) -> list[str]:
    """Advice for cameras outside the largest component that appear to see boards from behind."""
    apart = [name for part in found.components[1:] for name in part]
    names = [name for name in apart if _from_behind(found.cameras[name])]
    return [f"If the pictures of {', '.join(names)} are mirrored (selfie mode), flip them."] if names else []


def _from_behind(camera: Calibration) -> bool:
    """Whether most of the boards with codes show their backs: their z axis points towards the camera."""
    sides = [float(v.pose.R[:, 2] @ v.pose.t) > 0 for v in camera.views if v.target is not None and v.pose is not None]
    return bool(sides) and 2 * sum(sides) < len(sides)


def _join(link: MissingLink) -> str:
    pictures = f"{link.first_picture} of {link.first} and {link.second_picture} of {link.second}"
    if link.same_moment:
        return f"{pictures} would join them if both showed the whole board."
    return (
        f"{link.first} and {link.second} would join them: show both the whole board at one moment (as in {pictures})."
    )
