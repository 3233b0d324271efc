"""The calibrations of one camera, a pair or a rig in a file of rcdn, by the names of their cameras."""

from __future__ import annotations

from pathlib import Path

from rcdn.io.calibration import KINDS, read_calibration, read_stereo_calibration
from rcdn.io.fields import read_text
from rcdn.io.rig_calibration import read_rig_members
from rcdn.types import Calibration, StereoCalibration


def read_calibrations(path: str | Path) -> dict[str, Calibration]:
    """The calibrations in a file by name: `camera`, `left` and `right` of a pair, or those of a rig's cameras; none if
    `path` isn't a calibration of rcdn, but a camera file of any format. Raises FormatError as `read_calibration`."""
    text = read_text(path)
    kind = next((k for k in (*KINDS.values(), "rig") if f'"kind": "{k}"' in text[:200]), None)
    if kind == KINDS[Calibration]:
        return {"camera": read_calibration(path)}
    if kind == KINDS[StereoCalibration]:
        pair = read_stereo_calibration(path)
        return {"left": pair.left, "right": pair.right}
    return {} if kind is None else read_rig_members(path)
