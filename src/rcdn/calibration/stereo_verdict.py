"""The verdict on a pair of cameras: as `verdict`, for the pair and for each camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.calibration.advice import judged, notes
from rcdn.calibration.known_lens import judged_known
from rcdn.calibration.limits import growth, reason
from rcdn.calibration.verdict import against_camera, judge, sentences, verdict_of
from rcdn.errors import many
from rcdn.types import Calibration, Reason, StereoCalibration, Verdict
from rcdn.types.calibration import SIDES


def judge_stereo(stereo: StereoCalibration) -> Verdict:
    """The verdict on a pair: its own checks, then the reasons against each camera."""
    of_cameras = (r for name, c in _sides(stereo) for r in _of_camera(name, c, name in stereo.given))
    return verdict_of([*_pair_reasons(stereo), *of_cameras])


def judged_stereo(stereo: StereoCalibration) -> StereoCalibration:
    """`stereo` with its verdict and those of its cameras, and with advice that contains the same reasons.

    Advice about the pairs themselves (which were left out) is kept and comes first.
    """
    of_cameras = {f"{name.capitalize()}: {text}" for name, camera in _sides(stereo) for text in camera.advice}
    of_pairs = tuple(text for text in stereo.advice if text not in of_cameras)
    left, right = (judged_known(c) if name in stereo.given else judged(c) for name, c in _sides(stereo))
    done = replace(stereo, left=left, right=right)
    verdict = judge_stereo(done)
    noted = [f"{name.capitalize()}: {text}" for name, c in _sides(done) for text in notes(c)]
    return replace(done, verdict=verdict, advice=tuple(dict.fromkeys([*of_pairs, *sentences(verdict), *noted])))


def _sides(stereo: StereoCalibration) -> tuple[tuple[str, Calibration], ...]:
    return tuple(zip(SIDES, (stereo.left, stereo.right), strict=True))


def baseline_std(stereo: StereoCalibration) -> float:
    """Standard deviation of the baseline, m: that of the translation along its direction; a rotation does not change
    its length."""
    along = stereo.T_right_left[:3, 3] / max(stereo.baseline, 1e-12)
    return float(np.sqrt(along @ stereo.cov[3:, 3:] @ along))


def _pair_reasons(stereo: StereoCalibration) -> list[Reason]:
    used = sum(not a.reason and not b.reason for a, b in stereo.view_pairs)
    factor = growth(stereo.left.camera.image_size)
    share = baseline_std(stereo) / max(stereo.baseline, 1e-12)
    shared = np.isfinite(stereo.epipolar)
    return [
        reason(
            "pairs", used, "Enough pairs for chance to average out.",
            f"Only {many(used, 'pair')}: one bad pair can bend the result.",
            "Take 10 to 30 pairs, of the board in different places, distances and tilts.",
        ),
        reason(
            "pair_rms", stereo.rms, "Both cameras explain the corners about as well as they can be found.",
            f"An RMS of {stereo.rms:.2f} px of both cameras is high.", "Look at the worst pairs in the report.",
            factor=factor,
        ),
        reason(
            "epipolar", stereo.epipolar, "Matching points lie on one row of the rectified pictures.",
            f"Matching corners lie {stereo.epipolar:.2f} px off their epipolar lines: the cameras moved against each "
            "other, or weren't triggered together." if shared
            else "No corner was seen by both cameras: nothing tells how far off the rows are.",
            "Trigger both cameras at one moment, with the board held still." if shared
            else "Add pairs in which both see the same part of the board.", factor=factor,
        ),
        reason(
            "baseline", share, "The pairs settle how far the cameras stand apart.",
            f"The baseline is known only to ±{share:.1%}.",
            "Add pairs with the board near and tilted.",
        ),
    ]  # fmt: skip


def _of_camera(name: str, camera: Calibration, given: bool) -> list[Reason]:
    verdict = camera.verdict if camera.verdict.judged else (judged_known(camera).verdict if given else judge(camera))
    return against_camera(name, name.capitalize(), verdict)
