"""Advice to the user: the reasons of the verdict, followed by notes that do not affect it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

from rcdn.calibration.labels import fits
from rcdn.calibration.verdict import judge, sentences
from rcdn.calibration.view_checks import box
from rcdn.errors import a_board, many
from rcdn.types import Calibration


def judged(calibration: Calibration) -> Calibration:
    """`calibration` with its verdict, and with advice that contains the same reasons."""
    found = judge(calibration)
    return replace(calibration, verdict=found, advice=sentences(found) + notes(calibration))


def notes(calibration: Calibration) -> tuple[str, ...]:
    """Sentences on the board's size, symmetry and codes; () if there is nothing to note."""
    return tuple(text for note in (_sizes, _symmetric, _targets, _unread) if (text := note(calibration)))


def _sizes(c: Calibration) -> str:
    if c.size is None:
        return "No view shows a whole board: name its size (inner corners) to settle labels."
    sizes = Counter("{}×{}".format(*box(v.ij)) for v in c.used_views if not v.settled and not fits(box(v.ij), c.size))
    if not sizes:
        return ""
    what = ", ".join(f"{s} in {many(n, 'view')}" for s, n in sizes.most_common())
    return (
        f"Boards that aren't part of the {c.size[0]}×{c.size[1]} one were used, too ({what}): distances hold only if "
        "their squares are as large. Name the size to leave them out."
    )


def _symmetric(c: Calibration) -> str:
    if c.orientation in (None, "unique") or c.size is None:
        return ""
    board = a_board(c.size)
    turn = "half a turn" if c.orientation == "ambiguous_180" else "quarter turns"
    return (
        f"{board[0].upper()}{board[1:]} looks the same after {turn}: lens and RMS don't mind, but poses may be turned "
        "by that. A board with one odd and one even side (9×6) has only one way up."
    )


def _targets(c: Calibration) -> str:
    shown = Counter(str(v.target or "a plain board") for v in c.used_views)
    if len(shown) < 2 or (
        len(shown) == 2 and all(v.spacing == c.spacing for v in c.used_views) and "a plain board" in shown
    ):
        return ""
    what = ", ".join(f"{name} in {many(n, 'view')}" for name, n in shown.most_common())
    return f"The views show several targets ({what}): each counts with its own places and spacing."


def _unread(c: Calibration) -> str:
    unread = sum(v.target is None and v.spacing == c.spacing for v in c.used_views) if c.target is not None else 0
    if not unread:
        return ""
    return (
        f"The codes of {unread} of the used views were not read: these boards count as parts of the "
        f"{c.target} at an unknown place."
    )
