"""Files of targets, read and written: a small YAML description of the print, in metres, and Kalibr's target YAML."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rcdn.errors import FormatError, RcdnError, shown
from rcdn.io import write_text
from rcdn.io.cameras.yaml_text import digits, load
from rcdn.io.fields import read_text
from rcdn.targets.dictionaries import dictionary_name, family_name
from rcdn.targets.drawing import check
from rcdn.types import AprilGrid, Charuco, Checkerboard, Deltille, Print, Printed, PuzzlePart
from rcdn.types.target import PUZZLE

ROUND = 9
"""decimals to which a ratio of two lengths is rounded"""
_NOTES = {
    "charuco": ("squares", "side of a square, m"),
    "aprilgrid": ("tags", "side of a tag, m"),
    "puzzleboard": ("corners", "side of a square, m"),
    "deltille": ("inner corners", "side of a triangle, m"),
}
_KALIBR_FIELDS = {
    "aprilgrid": ("tagCols", "tagRows", "tagSize", "tagSpacing", "codeOffset"),
    "checkerboard": ("targetCols", "targetRows", "rowSpacingMeters", "colSpacingMeters"),
}
_KALIBR_SPACING = {"aprilgrid": "tagSize", "checkerboard": "rowSpacingMeters"}


def spacing_field(path: str | Path) -> str:
    """The field of a target's file from which `read_target` takes the spacing. Raises FormatError."""
    record = load(str(path), read_text(path))
    kind = record.get("target_type") if isinstance(record, dict) else None
    return _KALIBR_SPACING.get(kind, "spacing") if isinstance(kind, str) else "spacing"


def read_target(path: str | Path) -> Printed:
    """The target in a YAML file of rcdn's own format (`kind: …`) or Kalibr's (`target_type: aprilgrid` or
    `checkerboard`).

    Raises FormatError, which names the file, the field and the fix.
    """
    where = str(path)
    record = load(where, read_text(path))
    if not isinstance(record, dict):
        raise FormatError(f"{where}: not a target; the file begins with kind: (rcdn) or target_type: (Kalibr)")
    try:
        printed = _of_kalibr(record) if "target_type" in record else _of_ours(record)
        check(printed.target)
    except RcdnError as error:
        raise FormatError(f"{where}: {error}") from error
    return printed


def write_target(path: str | Path, printed: Printed) -> None:
    """Write the target's YAML: for a checkerboard and a usual AprilGrid in Kalibr's format, which rcdn reads, too, for
    other targets in rcdn's own.

    Raises OutputError.
    """
    write_text(path, target_text(printed))


def target_text(printed: Printed) -> str:
    """The text that `write_target` writes."""
    target, spacing = printed.target, printed.spacing
    if isinstance(target, Checkerboard):
        return _kalibr("checkerboard", target.columns, target.rows, spacing, spacing)
    if isinstance(target, AprilGrid) and (target.family, target.border, target.first_id) == ("tag36h11", 2, 0):
        return _kalibr("aprilgrid", target.columns, target.rows or 0, spacing, target.gap)
    count, side = _NOTES[target.kind]
    lines = [f"kind: {target.kind}", f"columns: {target.columns}  # {count}", f"rows: {target.rows}"]
    lines.append(f"spacing: {digits(spacing)}  # {side}")
    if isinstance(target, Charuco):
        lines += [
            f"marker: {digits(round(target.marker * spacing, 12))}  # side of a marker, m",
            f"dictionary: {target.dictionary}",
        ]
        lines += [
            f"first_id: {target.first_id}",
            f"legacy: {_yes(target.legacy)}",
            f"inverted: {_yes(target.inverted)}",
        ]
    elif isinstance(target, AprilGrid):
        lines += [f"gap: {digits(round(target.gap * spacing, 12))}  # between tags, m", f"family: {target.family}"]
        lines += [f"border: {target.border}  # bits", f"first_id: {target.first_id}"]
    elif isinstance(target, PuzzlePart):
        lines += [
            f"column: {target.column}  # of the first corner on the code of {PUZZLE} x {PUZZLE}",
            f"row: {target.row}",
        ]
    return "\n".join(lines) + "\n"


def _kalibr(kind: str, *values: float) -> str:
    pairs = zip(_KALIBR_FIELDS[kind], values, strict=False)
    fields = (f"{k}: {digits(v) if isinstance(v, float) else v}\n" for k, v in pairs)
    return f"target_type: '{kind}'\n" + "".join(fields)


def _yes(value: bool) -> str:
    return "true" if value else "false"


def _of_kalibr(record: Mapping[Any, Any]) -> Printed:
    kind = record["target_type"]
    if kind not in _KALIBR_FIELDS:
        raise FormatError(f"target_type {shown(kind)} is not supported; aprilgrid and checkerboard are")
    names = _KALIBR_FIELDS[kind]
    _only(record, ("target_type", *names))
    columns, rows = (_whole(record, name) for name in names[:2])
    if kind == "aprilgrid":
        first = _whole(record, "codeOffset", 0)
        return Printed(
            AprilGrid(columns, rows, "tag36h11", _length(record, "tagSpacing"), 2, first), _length(record, "tagSize")
        )
    down, across = _length(record, "rowSpacingMeters"), _length(record, "colSpacingMeters", record["rowSpacingMeters"])
    if abs(down - across) > 1e-9 * down:
        raise FormatError(
            f"rowSpacingMeters {down:g} and colSpacingMeters {across:g} differ; boards of squares only are supported"
        )
    return Printed(Checkerboard(columns, rows), down)


def _of_ours(record: Mapping[Any, Any]) -> Printed:
    kind = record.get("kind")
    if not isinstance(kind, str) or kind not in _READERS:
        raise FormatError(
            f"kind must be one of {', '.join(_READERS)}, not {shown(kind)}; Kalibr's files have target_type"
        )
    spacing = _length(record, "spacing")
    return Printed(_READERS[kind](record, spacing), spacing)


def _read_charuco(record: Mapping[Any, Any], spacing: float) -> Print:
    _only(record, ("kind", "columns", "rows", "spacing", "marker", "dictionary", "first_id", "legacy", "inverted"))
    return Charuco(
        _whole(record, "columns"), _whole(record, "rows"), dictionary_name(_text(record, "dictionary")),
        round(_length(record, "marker") / spacing, ROUND), _whole(record, "first_id", 0),
        legacy=_flag(record, "legacy"), inverted=_flag(record, "inverted"),
    )  # fmt: skip


def _read_aprilgrid(record: Mapping[Any, Any], spacing: float) -> Print:
    _only(record, ("kind", "columns", "rows", "spacing", "gap", "family", "border", "first_id"))
    return AprilGrid(
        _whole(record, "columns"), _whole(record, "rows"), family_name(_text(record, "family")),
        round(_length(record, "gap") / spacing, ROUND), _whole(record, "border", 2), _whole(record, "first_id", 0),
    )  # fmt: skip


def _read_puzzle(record: Mapping[Any, Any], spacing: float) -> Print:
    _only(record, ("kind", "columns", "rows", "spacing", "column", "row"))
    columns, rows = (_whole(record, name, PUZZLE) for name in ("columns", "rows"))
    return PuzzlePart(columns, rows, _whole(record, "column", 0), _whole(record, "row", 0))


def _read_plain(make: type[Checkerboard] | type[Deltille]) -> Callable[[Mapping[Any, Any], float], Print]:
    def read(record: Mapping[Any, Any], spacing: float) -> Print:
        _only(record, ("kind", "columns", "rows", "spacing"))
        return make(_whole(record, "columns"), _whole(record, "rows"))

    return read


_READERS: dict[str, Callable[[Mapping[Any, Any], float], Print]] = {
    "charuco": _read_charuco,
    "aprilgrid": _read_aprilgrid,
    "puzzleboard": _read_puzzle,
    "checkerboard": _read_plain(Checkerboard),
    "deltille": _read_plain(Deltille),
}


def _only(record: Mapping[Any, Any], names: tuple[str, ...]) -> None:
    for key in record:
        if key not in names:
            raise FormatError(f"{shown(key)} is no field of this target; it has {', '.join(names)}")


def _value(record: Mapping[Any, Any], name: str, default: Any) -> Any:
    value = record.get(name, default)
    if value is None:
        raise FormatError(f"{name} is missing")
    return value


def _whole(record: Mapping[Any, Any], name: str, default: int | None = None) -> int:
    value = _value(record, name, default)
    if type(value) is not int:
        raise FormatError(f"{name} must be a whole number, not {shown(value)}")
    return value


def _length(record: Mapping[Any, Any], name: str, default: Any = None) -> float:
    value = _value(record, name, default)
    if type(value) not in (int, float) or not 0 < value < 1e3:
        raise FormatError(f"{name} must be a number above 0 (lengths in metres), not {shown(value)}")
    return float(value)


def _text(record: Mapping[Any, Any], name: str) -> str:
    value = _value(record, name, None)
    if not isinstance(value, str):
        raise FormatError(f"{name} must be a name, not {shown(value)}")
    return value


def _flag(record: Mapping[Any, Any], name: str) -> bool:
    value = record.get(name, False)
    if type(value) is not bool:
        raise FormatError(f"{name} must be true or false, not {shown(value)}")
    return value
