"""What `rcdn calibrate` and `rcdn pose` print."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rcdn.cli._group import one_line

if TYPE_CHECKING:
    from rcdn.types import Array, Calibration, ModelScore, PoseEstimate, StereoCalibration


def camera_lines(calibration: Calibration) -> list[str]:
    """The camera with standard deviations, how well it fits, and the models it was chosen from."""
    c = calibration
    used, corners = c.used_views, sum(int(v.used.sum()) for v in c.used_views)
    width, height = c.camera.image_size
    board = "" if c.size is None else f", board {c.size[0]}×{c.size[1]}"
    lines = [
        f"{c.models[0].model} camera, {width}×{height} px: {len(used)} of {len(c.views)} views, {corners} corners"
        f" ({c.outliers} left out){board}"
    ]
    lines += [
        f"  {n:<3} {v}" for n, v in zip(c.camera.parameter_names, _values(c.camera.parameters, c.std), strict=True)
    ]
    held = "too few pictures to hold any out" if np.isnan(c.held_out) else f"{c.held_out:.3f} px in pictures held out"
    lines.append(f"RMS {c.rms:.3f} px, {held}")
    if len(c.models) > 1:
        lines.append("models: " + ", ".join(_model(m) for m in c.models))
    if c.warp is not None and c.warp_std is not None:
        bent = " and ".join(f"{1e3 * w:.2f} ± {1e3 * s:.2f} mm" for w, s in zip(c.warp, c.warp_std, strict=True))
        lines.append(f"board bent by {bent} along its columns and rows")
    return lines


def _model(score: ModelScore) -> str:
    """`brown 0.159 (held out 0.164)`; a model that can't beat a simpler one isn't tried on pictures held out."""
    return f"{score.model} {score.rms:.3f}" + ("" if np.isnan(score.held_out) else f" (held out {score.held_out:.3f})")


def _values(values: Array, std: Array) -> list[str]:
    """`value ± deviation`, with the digits that the deviation leaves."""
    digits = [int(np.clip(1 - np.floor(np.log10(max(s, 1e-9))), 1, 8)) for s in std]
    texts = [f"{v:.{d}f}" for v, d in zip(values, digits, strict=True)]
    before = max(t.index(".") for t in texts)
    return [f"{' ' * (before - t.index('.'))}{t} ± {s:.{d}f}" for t, s, d in zip(texts, std, digits, strict=True)]


def left_out_lines(calibration: Calibration) -> list[str]:
    """A line for each view that was left out, with the reason."""
    return [f"left out: {one_line(v.name)}: {v.reason}" for v in calibration.left_out]


def cut_lines(calibration: Calibration) -> list[str]:
    """What the picture's border has left of boards that look complete, each with the pictures in which it did."""
    from rcdn.calibration.cut import cut_text

    if calibration.size is None:
        return []
    names: dict[str, list[str]] = {}
    for view in calibration.used_views:
        if text := cut_text(view.ij, view.xy, calibration.camera.image_size, calibration.size):
            names.setdefault(text, []).append(one_line(view.name))
    cols, rows = calibration.size
    return [f"{text}, of {cols}×{rows}: {', '.join(mine)}" for text, mine in names.items()]


def stereo_lines(stereo: StereoCalibration) -> list[str]:
    """Where the right camera stands, and how well both fit."""
    std = np.sqrt(np.diag(stereo.cov))
    t = stereo.T_right_left[:3, 3]
    turn = np.degrees(np.arccos(np.clip((np.trace(stereo.T_right_left[:3, :3]) - 1) / 2, -1, 1)))
    place = ", ".join(f"{v:.5f} ± {s:.5f}" for v, s in zip(t, std[3:], strict=True))
    return [
        "left: " + camera_lines(stereo.left)[0],
        "right: " + camera_lines(stereo.right)[0],
        f"baseline {stereo.baseline:.5f} m, cameras turned by {turn:.3f}°; T_right_left: t = ({place}) m",
        f"RMS {stereo.rms:.3f} px, corners off their epipolar lines {stereo.epipolar:.3f} px",
    ]


def pose_line(name: str, pose: PoseEstimate) -> str:
    """A board's place in one line."""
    x, y, z = pose.t
    std = pose.std
    turn = np.degrees(np.arccos(np.clip(abs(pose.R[2, 2]), 0, 1)))
    doubt = "  AMBIGUOUS: a second pose fits as well" if pose.ambiguous else ""
    return (
        f"{one_line(name)}  x {x:.4f}  y {y:.4f}  z {z:.4f}  (± {std[3]:.4f} {std[4]:.4f} {std[5]:.4f})  tilt {turn:.1f}° (± "
        f"{np.degrees(std[:2].max()):.2f}°)  rms {pose.rms:.3f} px{doubt}"
    )
