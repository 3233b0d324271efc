"""Text printed by `rcdn calibrate` and `rcdn pose`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from rcdn.errors import many
from rcdn.geometry.rigid import rotation_angle
from rcdn.geometry.spline_grid import largest_shift
from rcdn.terminal.group import one_line
from rcdn.types.pose import pose_std
from rcdn.types.shown import decimals

if TYPE_CHECKING:
    from rcdn.types import Array, Calibration, ModelScore, PoseEstimate, StereoCalibration, Verdict

BESIDE = 45.0
"""degrees between two cameras, up to which one is to the left or right of the other"""


def verdict_line(verdict: Verdict, several: bool = False) -> list[str]:
    """The line of the verdict on a camera, or on `several`, which is printed first; empty if there is none."""
    from rcdn.calibration.verdict import headline

    return [headline(verdict, several)] if verdict.judged else []


def advice_lines(verdict: Verdict, advice: Sequence[str]) -> list[str]:
    """Lines of advice, without the most severe reason, which is already in the first line."""
    from rcdn.calibration.verdict import sentences

    headline = sentences(verdict)[:1] if verdict.judged else ()
    return [f"- {text}" for text in advice if text not in headline]


def camera_lines(calibration: Calibration) -> list[str]:
    """The camera's parameters with standard deviations, its reprojection error, and the compared lens models."""
    from rcdn.calibration.influence import held_fixed

    c = calibration
    used, corners = c.used_views, sum(int(v.used.sum()) for v in c.used_views)
    width, height = c.camera.image_size
    board = "" if c.size is None else f", board {c.size[0]}×{c.size[1]}"
    board += "" if c.target is None else f" ({c.target})"
    lines = [
        f"{c.models[0].model} camera, {width}×{height} px: {len(used)} of {many(len(c.views), 'view')}, "
        f"{many(corners, 'corner')} ({c.outliers} left out){board}"
    ]
    few = c.camera.coefficients
    values = _values(c.camera.parameters[:few], c.std[:few])
    if "principal_point" in held_fixed(c):
        centre = zip(c.camera.parameters[2:4], values[2:4], strict=True)
        values[2:4] = [f"{f'{v:z.1f}':>{text.index('.') + 2}} (held)" for v, text in centre]
    lines += [f"  {n:<3} {v}" for n, v in zip(c.camera.parameter_names[:few], values, strict=True)]
    if (correction := c.camera.correction) is not None:
        rows, columns, _ = correction.control.shape
        lines.append(
            f"  and a smooth correction of {columns}×{rows} control points, up to {largest_shift(c.camera):.2f} px"
        )
    lines.append(f"RMS {c.rms:.3f} px; {_held_out(c)}")
    if len(c.models) > 1:
        lines.append(
            f"models, × the RMS of {c.models[0].model}: " + ", ".join(_model(m, c.models[0]) for m in c.models)
        )
    if c.shape is not None:
        lines.append(
            f"board: corners {1e3 * c.shape.print_error:.3f} mm off their places in its plane, "
            f"bent by {1e3 * c.shape.bend:.2f} mm"
        )
    return lines


def _held_out(c: Calibration) -> str:
    """The held-out error as a multiple of that in the pictures themselves. Both are weighted as in the fit, over the
    corners on which models were compared, some of which the final calibration may exclude."""
    if np.isnan(c.held_out):
        return "too few pictures to hold any out"
    from rcdn.calibration.facts import multiple

    return f"in pictures held out {multiple(c.held_out, c.models[0].rms):.2f} times that"


def _model(score: ModelScore, chosen: ModelScore) -> str:
    """`brown 1.00 (held out 1.03)`; models no better than a simpler one aren't evaluated on held-out pictures."""
    from rcdn.calibration.facts import multiple

    held = "" if np.isnan(score.held_out) else f" (held out {multiple(score.held_out, chosen.rms):.2f})"
    return f"{score.model} {multiple(score.rms, chosen.rms):.2f}{held}"


def _values(values: Array, std: Array) -> list[str]:
    """`value ± deviation`, with as many digits as are significant, aligned at the decimal point."""
    digits = [decimals(s) for s in std]
    texts = [f"{v:z.{d}f}" for v, d in zip(values, digits, strict=True)]
    before = max(t.index(".") for t in texts)
    return [f"{' ' * (before - t.index('.'))}{t} ± {s:.{d}f}" for t, s, d in zip(texts, std, digits, strict=True)]


def left_out_lines(calibration: Calibration) -> list[str]:
    """A line for each excluded view, with the reason."""
    return [f"left out: {one_line(v.name)}: {v.reason}" for v in calibration.left_out]


def cut_lines(calibration: Calibration) -> list[str]:
    """Lines about apparently complete boards that are cut off by the picture's border: the visible part, and the names
    of the pictures."""
    from rcdn.geometry.cut import cut_text

    if calibration.size is None:
        return []
    names: dict[str, list[str]] = {}
    for view in calibration.used_views:
        if text := cut_text(view.ij, view.xy, calibration.camera.image_size, calibration.size):
            names.setdefault(text, []).append(one_line(view.name))
    cols, rows = calibration.size
    return [f"{text}, of {cols}×{rows}: {', '.join(mine)}" for text, mine in names.items()]


def stereo_lines(stereo: StereoCalibration) -> list[str]:
    """The pose of the right camera, and the reprojection error of both."""
    std = pose_std(stereo.T_right_left, stereo.cov)
    t = stereo.T_right_left[:3, 3]
    turn = rotation_angle(stereo.T_right_left[:3, :3])
    place = ", ".join(f"{v:.5f} ± {s:.5f}" for v, s in zip(t, std[3:], strict=True))
    rows = (
        f"corners off their epipolar lines {stereo.epipolar:.3f} px"
        if stereo.epipolar == stereo.epipolar
        else "no corner seen by both"
    )
    return [
        *(
            f"{side}: {'lens as given, ' if side in stereo.given else ''}{camera_lines(c)[0]}"
            for side, c in (("left", stereo.left), ("right", stereo.right))
        ),
        f"baseline {stereo.baseline:.5f} m, cameras turned by {turn:.3f}°; T_right_left: t = ({place}) m",
        f"RMS {stereo.rms:.3f} px, {rows}",
    ]


def swapped_hint(stereo: StereoCalibration) -> str:
    """A note if the right camera stands to the left of the left one, beside it and upright; "" otherwise."""
    T = np.linalg.inv(stereo.T_right_left)
    x, y, z = T[:3, 3]
    if x >= 0 or abs(x) < 2 * np.hypot(y, z) or rotation_angle(T[:3, :3]) > BESIDE:
        return ""
    return (
        f"note: the right camera stands {-x:.3g} m to the left of the left one, so that disparities are negative; if "
        "that isn't meant, give the inputs the other way round"
    )


def pose_line(name: str, pose: PoseEstimate) -> str:
    """A board's pose on one line: the position of its corner (0, 0), or of the origin of its target's own tools."""
    T = pose.T_cam_board if pose.T_cam_target is None else pose.T_cam_target
    turn = np.degrees(np.arccos(np.clip(abs(pose.R[2, 2]), 0, 1)))
    doubt = "  AMBIGUOUS: a second pose fits as well" if pose.ambiguous else ""
    return (
        f"{one_line(name)}  {position(T, pose.cov)}  tilt {turn:.1f}° (± {np.degrees(pose.std[:2].max()):.2f}°)  "
        f"rms {pose.rms:.3f} px{doubt}"
    )


def position(T: Array, cov: Array) -> str:
    """The translation of a pose with its standard deviations, to two digits of the smallest."""
    std = pose_std(T, cov)[3:]
    digits = decimals(float(std.min()))
    x, y, z = (f"{v:z.{digits}f}" for v in T[:3, 3])
    return f"x {x}  y {y}  z {z}  (± {' '.join(f'{s:.{digits}f}' for s in std)})"
