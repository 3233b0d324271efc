"""Views that the user leaves out: found by name, kept with their reason, with poses under the camera estimated from the
others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from difflib import get_close_matches

from rcdn.calibration.coded import Geometries
from rcdn.calibration.labels import Labelled
from rcdn.calibration.pose import estimate_pose
from rcdn.calibration.usable import board_view
from rcdn.errors import CalibrationError, ConfigError
from rcdn.types import Array, Board, BoardView, Calibration, Pose

REASON = "left out by hand"


def view_name(names: Sequence[str], index: int) -> str:
    """The entry that leaves out view `index` of pictures `names`: the picture's file name if no other has it, otherwise
    its whole path; followed by `:` and the board's number, from 1, if the picture has several."""
    name = names[index]
    own = _own_name(name)
    alone = sum(_own_name(n) == own for n in set(names)) == 1
    return (own if alone else name) + (f":{names[:index].count(name) + 1}" if list(names).count(name) > 1 else "")


def chosen(leave_out: Sequence[str], names: Sequence[str]) -> set[int]:
    """Indices of the views that `leave_out` names, among pictures `names` (one for each view, the largest board of a
    picture first).

    An entry is a picture's name, with or without its folders, which leaves out all its boards, or such a name with `:`
    and the board's number, counted from 1 as in the report. Raises ConfigError for a name that no picture has, listing
    the closest ones, and for an ambiguous name.
    """
    return {k for entry in leave_out for k in _indices(entry, names)}


def without(
    solve: Callable[[Sequence[Board], Sequence[str]], Calibration],
    targets: Callable[[Sequence[Board]], Geometries],
    boards: Sequence[Board],
    names: Sequence[str],
    leave_out: Sequence[str],
) -> Calibration:
    """The result of `solve` for all `boards` except those that `leave_out` names; these are included in its views with
    the reason REASON.

    Their poses and residuals are computed under the camera from the others, and their labels start at their own first
    corner; those of boards with codes start at the first corner of their target, one of the `targets` of the others.
    """
    out = chosen(leave_out, names)
    rest = [k for k in range(len(boards)) if k not in out]
    done = solve([boards[k] for k in rest], [names[k] for k in rest])
    found = dict(zip(rest, done.views, strict=True))
    labels = dict(
        zip(
            sorted(out),
            targets([boards[k] for k in rest]).labelled([boards[k] for k in sorted(out)], False),
            strict=True,
        )
    )
    turn: Counter[str] = Counter()
    views = []
    for k, (board, name) in enumerate(zip(boards, names, strict=True)):
        view = found[k] if k in found else _view(board, name, labels[k], done)
        views.append(replace(view, board=turn[name]))
        turn[name] += 1
    return replace(done, views=tuple(views))


def _indices(entry: str, names: Sequence[str]) -> list[int]:
    name, _, number = entry.rpartition(":")
    pictures = _pictures(entry, names)
    counted = number.isdecimal() and len(number) < 10
    if not pictures and counted and (pictures := _pictures(name, names)):
        views = [k for k, n in enumerate(names) if n == pictures[0]]
        if not 1 <= int(number) <= len(views):
            boards = "one board" if len(views) == 1 else f"boards 1 to {len(views)}"
            raise ConfigError(f"leave_out: {pictures[0]} has {boards}, not number {number}")
        _one(name, pictures)
        return [views[int(number) - 1]]
    if not pictures:
        raise ConfigError(f"leave_out: no view is named {entry!r}; {_close(name if counted else entry, names)}")
    _one(entry, pictures)
    return [k for k, n in enumerate(names) if n == pictures[0]]


def _pictures(name: str, names: Sequence[str]) -> list[str]:
    """The pictures with that whole name or, if there are none, that file name, each once."""
    every = list(dict.fromkeys(names))
    return [n for n in every if n == name] or [n for n in every if _own_name(n) == name]


def _one(name: str, pictures: Sequence[str]) -> None:
    if len(pictures) > 1:
        raise ConfigError(f"leave_out: {name!r} is the name of several pictures; name one of {', '.join(pictures[:4])}")


def _close(name: str, names: Sequence[str]) -> str:
    every = list(dict.fromkeys(names))
    known = {_own_name(n): n for n in every} | {n: n for n in every}
    near = list(dict.fromkeys(known[n] for n in get_close_matches(name, list(known), 4)))
    if near:
        return f"did you mean {' or '.join(near[:3])}?"
    return f"the pictures with boards are {', '.join(every[:4])}{', …' if len(every) > 4 else ''}"


def _own_name(name: str) -> str:
    return name.replace("\\", "/").rstrip("/").rsplit("/", 1)[-1] or name


def _view(board: Board, name: str, label: Labelled, done: Calibration) -> BoardView:
    pose: Pose | None = None
    residuals: Array | None = None
    if label.target is None:
        label = replace(label, ij=board.ij - (board.ij.min(axis=0) if len(board) else 0), settled=False)
    placed = replace(board, ij=label.ij, target=label.target, ids=None if label.target is None else board.ids)
    side = done.spacing if label.reason else label.spacing
    if board.image_size == tuple(done.camera.image_size) and (board.pattern != "aprilgrid" or label.target is not None):
        try:
            found = estimate_pose(placed, done.camera, side)
            pose, residuals = Pose(found.T_cam_board), found.residuals
        except CalibrationError:
            pass
    label = replace(label, plane=placed.plane, spacing=side)
    return board_view(board, label, name, pose=pose, residuals=residuals, reason=REASON)
