"""A calibrated rig as rcdn's JSON."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rcdn.errors import FormatError
from rcdn.io.calibration import calibration_of, calibration_record, known, load_kind, reason_record, verdict_of
from rcdn.io.cameras import ours
from rcdn.io.fields import located, names_of, nullable, numbers, rigid, take
from rcdn.io.files import write_text
from rcdn.io.rig_files import rig_of_record, rig_record
from rcdn.types import Array, Calibration, FixedBoard, MissingLink, RigCalibration, RigPair, TimeShift


def write_rig_calibration(path: str | Path, found: RigCalibration) -> None:
    """Write a rig with all its views, whole or not at all; the same input gives the same bytes. Raises OutputError as
    `write_text`."""
    rig = found.rig
    places = dict(zip(rig.names, rig.T_cam_rig.tolist(), strict=True))
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
        "fixed_boards": [
            {
                "target": b.target, "name": b.name, "first": b.first,
                "T_first_board": b.T_first_board.tolist(), "cov": b.cov.tolist(),
            }
            for b in found.fixed_boards
        ],
        "cameras": [
            {"name": name, "T_cam_rig": places.get(name), **calibration_record(c)} for name, c in found.cameras.items()
        ],
    }  # fmt: skip
    write_text(path, ours.to_text("rig", record))


def read_rig_calibration(path: str | Path) -> RigCalibration:
    """Read the calibration of a rig from a file of `write_rig_calibration`: equal in every number.

    Unknown fields, and those that follow from others, are ignored. Raises FormatError, naming the file and the field,
    if the file can't be read, is of another version or kind, or doesn't have the structure of docs/formats.md.
    """
    data, where = load_kind(path, "rig"), str(path)
    cameras = _calibrations(data, where)
    if not cameras:
        raise FormatError(f"{where}: holds a rig without its views; write it with `rcdn calibrate --rig --json`")
    shifts = {n: _shift(s, f"{where}: shifts[{n!r}]") for n, s in take(data, "shifts", dict, where).items()}
    with located(where):
        return RigCalibration(
            rig=rig_of_record(data, where),
            cameras=cameras,
            boards=dict(_board(r, at) for at, r in _records(data, "boards", where)),
            rms=known(data, "rms", where),
            pairs=tuple(_pair(r, at) for at, r in _records(data, "pairs", where)),
            components=tuple(names_of(part, f"{where}: components") for part in take(data, "components", list, where)),
            links=tuple(_link(r, at) for at, r in _records(data, "links", where)),
            thin=names_of(data.get("thin"), f"{where}: thin"),
            shifts=shifts,
            verdict=verdict_of(data, where),
            given=names_of(data.get("given"), f"{where}: given"),
            corrected=names_of(data.get("corrected"), f"{where}: corrected"),
            fixed_boards=tuple(_fixed(r, at) for at, r in _records(data, "fixed_boards", where)),
        )


def read_rig_members(path: str | Path) -> dict[str, Calibration]:
    """The calibrations of a rig's cameras by name, also of those that nothing connects; none if the file holds the rig
    without its views. Raises FormatError as `read_rig_calibration`."""
    return _calibrations(load_kind(path, "rig"), str(path))


def _calibrations(data: Any, where: str) -> dict[str, Calibration]:
    records = [(f"{where}: cameras[{k}]", r) for k, r in enumerate(take(data, "cameras", list, where))]
    if not any(isinstance(r, dict) and "views" in r for _, r in records):
        return {}
    return {take(r, "name", str, at): calibration_of(r, at) for at, r in records}


def _records(data: Any, key: str, where: str) -> list[tuple[str, Any]]:
    """The objects of a list, each with the place for messages; [] if a file of an earlier version has no such list."""
    every = take(data, key, list, where) if key in data else []
    return [(f"{where}: {key}[{k}]", record) for k, record in enumerate(every)]


def _board(record: Any, where: str) -> tuple[tuple[str, int], Array]:
    key = take(record, "moment", str, where), take(record, "target", int, where)
    return key, rigid(record, "T_rig_board", where)


def _pair(record: Any, where: str) -> RigPair:
    first, second = (take(record, key, str, where) for key in ("first", "second"))
    shared, used = (take(record, key, int, where) for key in ("shared", "used"))
    return RigPair(first, second, shared, used, known(record, "rms", where), known(record, "epipolar", where))


def _link(record: Any, where: str) -> MissingLink:
    texts = {key: take(record, key, str, where) for key in ("first", "second", "first_picture", "second_picture")}
    return MissingLink(**texts, same_moment=take(record, "same_moment", bool, where))


def _shift(record: Any, where: str) -> TimeShift:
    return TimeShift(known(record, "moments", where), known(record, "std", where))


def _fixed(record: Any, where: str) -> FixedBoard:
    target, first = (take(record, key, int, where) for key in ("target", "first"))
    T, cov = rigid(record, "T_first_board", where), numbers(record, "cov", where, finite=True, shape=(6, 6))
    return FixedBoard(target, take(record, "name", str, where), first, T, cov)
