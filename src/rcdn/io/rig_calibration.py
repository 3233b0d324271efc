"""A calibrated rig as rcdn's JSON."""

from __future__ import annotations

from pathlib import Path

from rcdn.io.calibration import calibration_record, reason_record
from rcdn.io.cameras import ours
from rcdn.io.fields import nullable
from rcdn.io.files import write_text
from rcdn.io.rig_files import rig_record
from rcdn.types import RigCalibration


def write_rig_calibration(path: str | Path, found: RigCalibration) -> None:
    """Write a rig with all its views, whole or not at all; the same input gives the same bytes. Raises OutputError as
    `write_text`."""
    rig = found.rig
    places = {name: pose.T_cam_board.tolist() for name, pose in zip(rig.names, rig.poses, strict=True)}
    record = {
        "verdict": found.verdict.level if found.verdict.judged else None,
        "rms": nullable(found.rms),
        "reasons": [reason_record(r) for r in found.verdict.reasons],
        **rig_record(rig),
        "components": [list(part) for part in found.components],
        "links": [dict(vars(link)) for link in found.links],
        "thin": list(found.thin),
        "given": list(found.given),
        "corrected": list(found.corrected),
        "shifts": {n: {"moments": s.moments, "std": nullable(s.std)} for n, s in (found.shifts or {}).items()},
        "pairs": [vars(p) | {"rms": nullable(p.rms), "epipolar": nullable(p.epipolar)} for p in found.pairs],
        "boards": [
            {"moment": m, "target": n, "T_rig_board": T.tolist()} for (m, n), T in found.boards.items()
        ],
        "cameras": [
            {"name": name, "T_cam_rig": places.get(name), **calibration_record(c)} for name, c in found.cameras.items()
        ],
    }  # fmt: skip
    write_text(path, ours.to_text("rig", record))
