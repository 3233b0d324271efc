"""A complete calibration as rcdn's JSON with all digits; docs/formats.md describes every field."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import numpy as np

from rcdn.errors import FormatError, shown
from rcdn.io.cameras import ours
from rcdn.io.fields import located, names_of, nullable, number, numbers, read_text, rigid, take, two_whole_numbers
from rcdn.io.files import write_text
from rcdn.types import (
    LEVELS,
    NOT_JUDGED,
    Array,
    BoardShape,
    BoardView,
    Calibration,
    Level,
    ModelScore,
    Orientation,
    Pattern,
    Plane,
    Pose,
    Reason,
    StereoCalibration,
    Target,
    Verdict,
)
from rcdn.types.arrays import Real
from rcdn.types.ranges import BOX, LABEL, POSITION, SPACING, in_words, is_spacing
from rcdn.types.target import target_of, target_record

MOST_ID = 10**9
ROUNDING = 1e-6
"""tolerance for rounding errors of correlations"""
KINDS = {Calibration: "calibration", StereoCalibration: "stereo calibration"}


def write_calibration(path: str | Path, found: Calibration | StereoCalibration) -> None:
    """Write a calibration of one camera or of two, one view per line, whole or not at all.

    The same input gives the same bytes. Unknown numbers (NaN) are written as null. Raises OutputError as `write_text`.
    """
    record = calibration_record(found) if isinstance(found, Calibration) else _stereo_record(found)
    write_text(path, ours.to_text(KINDS[type(found)], record))


def read_calibration(path: str | Path) -> Calibration:
    """Read the calibration of one camera from a file of `write_calibration`: equal in every number.

    Unknown fields, and those that follow from others (rms, held_out, std), are ignored. Raises FormatError, naming the
    file and the field, if the file can't be read, isn't JSON, is of another version or kind, or doesn't have the
    structure of docs/formats.md.
    """
    return calibration_of(load_kind(path, "calibration"), str(path))


def read_stereo_calibration(path: str | Path) -> StereoCalibration:
    """Read the calibration of two cameras from a file of `write_calibration`; as `read_calibration`."""
    data, where = load_kind(path, "stereo calibration"), str(path)
    left, right = (calibration_of(take(data, side, dict, where), f"{where}: {side}") for side in ("left", "right"))
    T = rigid(data, "T_right_left", where)
    R_left, R_right, P_left, P_right, Q = (numbers(data, n, where, shape=shape) for n, shape in ours.SHAPES.items())
    rms, epipolar = known(data, "rms", where), known(data, "epipolar", where)
    cov = _covariance(data, where, 6)
    advice = _texts(data, "advice", where)
    rectified = (R_left, R_right, P_left, P_right, Q)
    given = names_of(data.get("given", []), f"{where}: given")
    verdict = verdict_of(data, where)
    pairs = None if data.get("pairs") is None else max(take(data, "pairs", int, where), 0)
    with located(where):
        return StereoCalibration(left, right, T, cov, rms, epipolar, *rectified, advice, verdict, given, pairs)


# ---- values → JSON


def calibration_record(found: Calibration) -> dict[str, Any]:
    """The fields of one camera's calibration."""
    names = found.camera.parameter_names
    return {
        "camera": ours.camera_record(found.camera),
        "verdict": found.verdict.level if found.verdict.judged else None,
        "rms": nullable(found.rms),
        "held_out": nullable(found.held_out),
        "std": dict(zip(names, nullable(found.std), strict=True)),
        "spacing": float(found.spacing),
        "size": None if found.size is None else [int(n) for n in found.size],
        "orientation": found.orientation,
        "target": None if found.target is None else target_record(found.target),
        "shape": None if found.shape is None else nullable(found.shape.offsets),
        "noise": nullable(found.noise),
        "models": [{"model": m.model, "rms": nullable(m.rms), "held_out": nullable(m.held_out)} for m in found.models],
        "reasons": [reason_record(r) for r in found.verdict.reasons],
        "advice": list(found.advice),
        "cov": nullable(found.cov),
        "views": [_view_record(view) for view in found.views],
    }


def _stereo_record(found: StereoCalibration) -> dict[str, Any]:
    return {
        "verdict": found.verdict.level if found.verdict.judged else None,
        "T_right_left": found.T_right_left.tolist(),
        **{name: nullable(getattr(found, name)) for name in ours.SHAPES},
        "rms": nullable(found.rms),
        "epipolar": nullable(found.epipolar),
        "baseline": nullable(found.baseline),
        "pairs": found.pairs,
        "given": list(found.given),
        "reasons": [reason_record(r) for r in found.verdict.reasons],
        "advice": list(found.advice),
        "cov": nullable(found.cov),
        "left": calibration_record(found.left),
        "right": calibration_record(found.right),
    }


def reason_record(reason: Reason) -> dict[str, Any]:
    """The fields of a reason."""
    return vars(reason) | {
        "value": nullable(reason.value),
        "limit": nullable(reason.limit),
    }  # in the order of the fields


def _view_record(view: BoardView) -> dict[str, Any]:
    return {
        "name": view.name,
        "board": int(view.board),
        "reason": view.reason,
        "settled": bool(view.settled),
        "rms": nullable(view.rms),
        "pose": None if view.pose is None else nullable(view.pose.T_cam_board),
        "ij": view.ij.tolist(),
        "xy": nullable(view.xy),
        "sigma": nullable(view.sigma),
        "residuals": nullable(view.residuals),
        "used": view.used.astype(int).tolist(),
        **_print_record(view),
    }


def _print_record(view: BoardView) -> dict[str, Any]:
    """The fields of a view that describe the printed board: its plane, the side of its squares and, if its codes were
    read, its target and the corners' ids."""
    record: dict[str, Any] = {}
    if view.plane is not None:
        record |= {"pattern": view.plane.pattern, "gap": view.plane.gap}
    if view.spacing is not None:
        record["spacing"] = float(view.spacing)
    if view.target is not None and view.ids is not None:
        record |= {"target": target_record(view.target), "ids": [None if n < 0 else n for n in view.ids.tolist()]}
    return record


# ---- JSON → values


def load_kind(path: str | Path, kind: str) -> Any:
    data = ours.load(str(path), read_text(path))
    if (found := data.get("kind")) != kind:
        other = "no calibration" if found is None else f"{shown(found)}, not {kind!r}"
        raise FormatError(f"{path}: holds {other}; write it with `rcdn calibrate --json`")
    return data


def calibration_of(data: Any, where: str) -> Calibration:
    camera = ours.camera_of(data, where)
    many = len(camera.parameters) + 6
    size = None if data.get("size") is None else two_whole_numbers(data, "size", where)
    if size is not None and size[0] * size[1] > BOX:
        raise FormatError(f"{where}: 'size' of the board must hold at most {BOX} corners, not {size[0]}×{size[1]}")
    models = [_score(m, f"{where}: models[{k}]") for k, m in enumerate(take(data, "models", list, where))]
    views = [_view(v, f"{where}: views[{k}]") for k, v in enumerate(take(data, "views", list, where))]
    return Calibration(
        camera=camera,
        spacing=_spacing(data, where),
        views=tuple(views),
        cov=_covariance(data, where, many),
        noise=known(data, "noise", where),
        models=tuple(models),
        size=size,
        orientation=_orientation(data, where),
        shape=_shape(data, where),
        advice=_texts(data, "advice", where),
        verdict=verdict_of(data, where),
        target=_target(data, where),
    )


def _spacing(data: Any, where: str) -> float:
    spacing = number(data, "spacing", where)
    if not is_spacing(spacing):
        raise FormatError(f"{where}: 'spacing' must be {in_words(*SPACING)} m, not {spacing:g}")
    return spacing


def _covariance(data: Any, where: str, many: int) -> Array:
    cov = numbers(data, "cov", where, shape=(many, many))
    variance = np.diag(cov)
    if (variance < 0).any() or (np.isfinite(cov).all() and not _is_positive(cov)):
        raise FormatError(
            f"{where}: 'cov' must be a covariance: symmetric, with no negative variance; write the file again"
        )
    return cov


def _is_positive(cov: Real[Array, "p p"]) -> bool:
    """Whether `cov` (P, P) is a covariance up to rounding: its correlation matrix is symmetric and has no negative
    eigenvalue."""
    size = np.sqrt(np.diag(cov))
    size[size == 0] = 1
    with np.errstate(all="ignore"):
        correlation = cov / size[:, None] / size
    if not (np.abs(correlation) <= 1 + ROUNDING).all() or not np.allclose(correlation, correlation.T, atol=ROUNDING):
        return False
    return bool(np.linalg.eigvalsh(correlation).min() >= -ROUNDING * len(cov))


def _shape(data: Any, where: str) -> BoardShape | None:
    if data.get("shape") is None:
        return None
    offsets = numbers(data, "shape", where, finite=True)
    if offsets.ndim != 3 or offsets.shape[2] != 3:
        raise FormatError(f"{where}: 'shape' must have shape (rows, columns, 3), not {offsets.shape}")
    return BoardShape(offsets)


def verdict_of(data: dict[str, Any], where: str) -> Verdict:
    """The verdict; `NOT_JUDGED` if the file has none: it was written before calibrations had verdicts."""
    if data.get("verdict") is None:
        return NOT_JUDGED
    reasons = take(data, "reasons", list, where)
    return Verdict(
        _level(data, "verdict", where), tuple(_reason(r, f"{where}: reasons[{k}]") for k, r in enumerate(reasons))
    )


def _reason(record: Any, where: str) -> Reason:
    texts = {name: take(record, name, str, where) for name in ("key", "what", "unit", "sentence", "action")}
    value, limit = known(record, "value", where), known(record, "limit", where)
    return Reason(level=_level(record, "level", where), value=value, limit=limit, **texts)


def _level(record: Any, key: str, where: str) -> Level:
    value = take(record, key, str, where)
    for known in LEVELS:
        if value == known:
            return known
    raise FormatError(f"{where}: {key!r} must be one of {', '.join(LEVELS)}, not {shown(value)}")


def _view(record: Any, where: str) -> BoardView:
    pose = record.get("pose") if isinstance(record, dict) else None
    ij, used = (numbers(record, key, where, finite=True, within=LABEL) for key in ("ij", "used"))
    if (ij != np.floor(ij)).any() or not np.isin(used, (0, 1)).all():
        raise FormatError(f"{where}: 'ij' must hold whole numbers and 'used' 0 or 1")
    with located(where):
        return BoardView(
            name=take(record, "name", str, where),
            board=take(record, "board", int, where),
            ij=ij,
            xy=numbers(record, "xy", where, within=POSITION),
            sigma=numbers(record, "sigma", where),
            pose=None if pose is None else Pose(rigid(record, "pose", where)),
            residuals=numbers(record, "residuals", where),
            used=used.astype(bool),
            reason=take(record, "reason", str, where),
            settled=take(record, "settled", bool, where),
            **_print(record, where),
        )


def _target(record: Any, where: str) -> Target | None:
    """The target; None if there is none: the board is plain, or the file was written before coded boards were
    supported."""
    if record.get("target") is None:
        return None
    with located(where):
        return target_of(record["target"])


def _print(record: Any, where: str) -> dict[str, Any]:
    """The arguments of a BoardView that describe the printed board: target, ids, plane, spacing."""
    target = _target(record, where)
    ids = None
    if target is not None:
        ids = [-1 if n is None else n for n in take(record, "ids", list, where)]
        if not all(type(n) is int and -1 <= n <= MOST_ID for n in ids):
            raise FormatError(f"{where}: 'ids' must hold whole numbers or null")
    plane = None
    if record.get("pattern") is not None:
        if record["pattern"] not in get_args(Pattern):
            raise FormatError(f"{where}: 'pattern' must be one of {', '.join(get_args(Pattern))}")
        plane = Plane(record["pattern"], None if record.get("gap") is None else number(record, "gap", where))
    spacing = None if record.get("spacing") is None else _spacing(record, where)
    return {"target": target, "ids": ids, "plane": plane, "spacing": spacing}


def _score(record: Any, where: str) -> ModelScore:
    name = take(record, "model", str, where)
    return ModelScore(name, known(record, "rms", where), known(record, "held_out", where))


def known(record: Any, key: str, where: str) -> float:
    """A number, NaN if it is null; the field must be present."""
    if not isinstance(record, dict) or key not in record:
        raise FormatError(f"{where}: {key!r} must be a number or null")
    return float(numbers({key: [record[key]]}, key, where, shape=(1,))[0])


def _texts(record: dict[str, Any], key: str, where: str) -> tuple[str, ...]:
    values = take(record, key, list, where)
    if not all(isinstance(v, str) for v in values):
        raise FormatError(f"{where}: {key!r} must hold text")
    return tuple(values)


def _orientation(record: dict[str, Any], where: str) -> Orientation | None:
    value = record.get("orientation")
    for known in (None, *get_args(Orientation)):
        if value == known:
            return known
    raise FormatError(f"{where}: 'orientation' must be null or one of {', '.join(get_args(Orientation))}")
