"""What a rig's solution shows: pairs of cameras, parts that no board connects, cameras out of step, and whether to use it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration.advice import judged
from rcdn.calibration.board_points import board_points
from rcdn.calibration.known_lens import judged_known
from rcdn.calibration.limits import growth, reason
from rcdn.calibration.rig import matrix
from rcdn.calibration.rig_start import Key
from rcdn.calibration.verdict import verdict_of
from rcdn.types import (
    Array,
    BoardView,
    Calibration,
    MissingLink,
    Reason,
    Rig,
    RigCalibration,
    RigPair,
    TimeShift,
)

FEWEST_MOVES = 6
"""moments at which a board moved that tell a time shift"""
STILL = 1e-3
"""share of the board's distance that it must move from one moment to the next to count as moving"""


def pairs_of(
    order: Sequence[str], cameras: Sequence[Calibration], sights: Sequence[Mapping[Key, int]]
) -> tuple[RigPair, ...]:
    """Every two cameras that saw boards together."""
    out = []
    for a in range(len(order)):
        for b in range(a + 1, len(order)):
            shared = [(sights[a][key], sights[b][key]) for key in sights[a] if key in sights[b]]
            views = [(cameras[a].views[k], cameras[b].views[m]) for k, m in shared]
            good = [v for pair in views for v in pair if not pair[0].reason and not pair[1].reason]
            if shared:
                out.append(RigPair(order[a], order[b], len(shared), len(good) // 2, _rms(good)))
    return tuple(out)


def _rms(views: Sequence[BoardView]) -> float:
    gaps = np.concatenate([v.residuals[v.used] for v in views] or [np.zeros((0, 2))])
    return float(np.sqrt((gaps**2).sum(axis=1).mean())) if len(gaps) else float("nan")


def links_of(
    order: Sequence[str],
    cameras: Sequence[Calibration],
    parts: Sequence[Sequence[int]],
    when: Mapping[str, Sequence[str]],
) -> tuple[MissingLink, ...]:
    """For each part but the largest, the two cameras and pictures that come nearest to joining it to the others.

    Pictures of one moment that show the most corners to both cameras, else those of most corners.
    """
    links = []
    for part in parts[1:]:
        rest = [c for other in parts if other is not part for c in other]
        links.append(
            max((_link(order, cameras, when, a, b) for a in rest for b in part), key=lambda scored: scored[0])[1]
        )
    return tuple(links)


def _link(
    order: Sequence[str], cameras: Sequence[Calibration], when: Mapping[str, Sequence[str]], a: int, b: int
) -> tuple[tuple[bool, int], MissingLink]:
    one, two = (
        dict(sorted(zip(when[order[c]], cameras[c].views, strict=True), key=lambda i: len(i[1]))) for c in (a, b)
    )
    common = [m for m in one if m in two]
    if common:
        best = max(common, key=lambda m: min(len(one[m]), len(two[m])))
        views, score = (one[best], two[best]), min(len(one[best]), len(two[best]))
    else:
        views = tuple(max(side.values(), key=len) for side in (one, two))  # type: ignore[assignment]
        score = min(map(len, views))
    return (bool(common), score), MissingLink(order[a], order[b], views[0].name, views[1].name, bool(common))


def shifts_of(
    rig: Rig, cameras: Mapping[str, Calibration], sights: Mapping[str, Mapping[Key, int]]
) -> dict[str, TimeShift]:
    """How late each camera is, from boards that moved: where it sees them by itself, against the path on which the others saw them.

    Moments count in the order of their names (numbers as numbers). Cameras that saw too few moving boards aren't in it.
    """
    tracks = {name: _track(rig, name, cameras[name], sights[name]) for name in rig.names}
    moments = sorted({key for track in tracks.values() for key in track}, key=_in_order)
    out = {}
    for name in rig.names:
        others = {key: _mean([t[key] for other, t in tracks.items() if other != name and key in t]) for key in moments}
        found = _shift(tracks[name], others, moments)
        if found is not None:
            out[name] = found
    return out


def _in_order(key: Key) -> tuple[int, float, str]:
    digits = key[0].lstrip("#")
    return (key[1], float(digits), "") if digits.isdigit() else (key[1], float("inf"), key[0])


def _mean(places: Sequence[Array]) -> Array | None:
    return np.mean(places, axis=0) if places else None


def _track(rig: Rig, name: str, calibration: Calibration, sights: Mapping[Key, int]) -> dict[Key, Array]:
    """Where the middles of the boards are in the rig's frame as one camera alone sees them."""
    back = np.linalg.inv(rig.poses[rig.index(name)].T_cam_board)
    out = {}
    for key, k in sights.items():
        view = calibration.views[k]
        if view.pose is None or view.reason:
            continue
        middle = board_points(calibration, view).mean(axis=0)
        own = _own_pose(calibration, view)
        if own is not None:
            out[key] = (back @ own @ np.append(middle, 1.0))[:3]
    return out


def _own_pose(calibration: Calibration, view: BoardView) -> Array | None:
    """The pose that the view's corners alone give, near the joint one."""
    from rcdn.calibration.bundle import Corners3, State, default_free
    from rcdn.calibration.solver import solve

    places = board_points(calibration, view)[:, :2]
    none = np.zeros(len(view), int)
    corners = Corners3(none, none, places, view.xy, np.zeros((len(view), 0)))
    state = State.mono(calibration.camera, matrix(view)[None])
    found = solve(state, corners, view.used.astype(float), default_free(state, lens=False), iterations=8).state.poses[0]
    return found if np.isfinite(found).all() else None


def _shift(track: Mapping[Key, Array], others: Mapping[Key, Array | None], moments: Sequence[Key]) -> TimeShift | None:
    """The time by which the track is ahead of the path of the others, by least absolute misses (reweighted)."""
    speed, miss = [], []
    for before, here, after in zip(moments, moments[1:], moments[2:], strict=False):
        a, b, c = (others[key] for key in (before, here, after))
        if here in track and a is not None and b is not None and c is not None and before[1] == after[1]:
            v = (c - a) / 2
            if np.linalg.norm(v) > STILL * np.linalg.norm(b):
                speed.append(v)
                miss.append(track[here] - b)
    if len(speed) < FEWEST_MOVES:
        return None
    v, d = np.array(speed), np.array(miss)
    weight, tau = np.ones(len(v)), 0.0
    for _ in range(20):
        tau = float((weight * (v * d).sum(axis=1)).sum() / (weight * (v * v).sum(axis=1)).sum())
        gap = np.linalg.norm(d - tau * v, axis=1)
        weight = 1 / np.maximum(gap, 0.1 * np.median(gap) + 1e-12)
    score = weight * ((d - tau * v) * v).sum(axis=1)
    return TimeShift(tau, float(np.sqrt((score**2).sum()) / (weight * (v * v).sum(axis=1)).sum()))


def judged_rig(found: RigCalibration) -> RigCalibration:
    """`found` with its verdict and those of its cameras."""
    cameras = {
        name: judged_known(camera) if name in found.given else judged(camera) for name, camera in found.cameras.items()
    }
    reasons = [
        *_rig_reasons(found),
        *(r for name, c in cameras.items() for r in _of_camera(name, c, name in found.given)),
    ]
    return replace(found, cameras=cameras, verdict=verdict_of(reasons))


def _rig_reasons(found: RigCalibration) -> list[Reason]:
    late = {name: s for name, s in (found.shifts or {}).items() if s.clear}
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
            f"An RMS of {found.rms:.2f} px of all cameras is high.", "Look at the pairs of the highest RMS.", factor=factor,
        ),
        reason(
            "time_shift", len(late), "No camera is out of step, as far as moving boards tell.",
            "Out of step: " + ", ".join(f"{n} by {s.moments:+.2f} ± {s.std:.2f} of a frame" for n, s in late.items()) + ".",
            "Trigger the cameras together, or hold the board still.",
        ),
    ]  # fmt: skip


def _flips(found: RigCalibration) -> list[str]:
    """What to try for cameras outside the largest part that seem to see boards from behind."""
    apart = [name for part in found.components[1:] for name in part]
    names = [name for name in apart if _from_behind(found.cameras[name])]
    return [f"If the pictures of {', '.join(names)} are mirrored (selfie mode), flip them."] if names else []


def _from_behind(camera: Calibration) -> bool:
    """Whether most of the boards with codes show their backs: their z is towards the camera."""
    sides = [float(v.pose.R[:, 2] @ v.pose.t) > 0 for v in camera.views if v.target is not None and v.pose is not None]
    return bool(sides) and 2 * sum(sides) < len(sides)


def _join(link: MissingLink) -> str:
    pictures = f"{link.first_picture} of {link.first} and {link.second_picture} of {link.second}"
    if link.same_moment:
        return f"{pictures} would join them if both showed the whole board."
    return (
        f"{link.first} and {link.second} would join them: show both the whole board at one moment (as in {pictures})."
    )


LENS_CHECKS = ("systematic", "smooth", "rms", "crowded")
"""what a lens that is wrong fails"""


def _of_camera(name: str, camera: Calibration, given: bool) -> list[Reason]:
    against = camera.verdict.against if camera.verdict else ()

    def action(r: Reason) -> str:
        anew = "Leave the camera that was given for it away, so that its lens is solved for: zoom, focus or the picture may have changed."
        return anew if given and r.key in LENS_CHECKS else r.action

    return [
        replace(r, key=f"{name}.{r.key}", what=f"{name}: {r.what}", sentence=f"{name}: {r.sentence}", action=action(r))
        for r in against
    ]
