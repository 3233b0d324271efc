"""The report of one calibration: a single HTML file that can be read in a minute."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.calibration.board_points import plane_of
from rcdn.calibration.facts import measure
from rcdn.calibration.limits import LIMITS
from rcdn.calibration.next_view import NextView, next_view
from rcdn.calibration.verdict import judge
from rcdn.io import write_text
from rcdn.provenance import provenance
from rcdn.report.calibration import charts, numbers, sections, space, verdict
from rcdn.report.calibration.environment import render
from rcdn.report.calibration.gallery import Gallery, gallery, straight
from rcdn.report.calibration.histogram import histogram
from rcdn.report.calibration.next_pose import suggested_pose
from rcdn.report.calibration.pictures import Pictures
from rcdn.types import Array, Calibration

LARGEST = 6_000_000
"""maximum size of the page, bytes; thumbnails may use what the other parts leave, less SPARE"""
SPARE = 100_000


def write_report(
    path: str | Path, calibration: Calibration, pictures: Pictures | None = None, title: str = "Camera calibration"
) -> None:
    """Write the report of `calibration` to `path`: one HTML file that needs no network and no script.

    `pictures(name)` returns the photograph (H, W) of a view by its name, or None; it is called once for each picture
    that is shown, and again for the sample. Without it there are only drawings. The page stays below 6 MB for a hundred
    views: thumbnails are reduced in size, and pictures that don't fit are left out with a note. Written whole or not at
    all; the same input gives the same bytes except for the date. Raises OutputError if it can't be written.
    """
    write_text(path, report(calibration, pictures, title))


def report(calibration: Calibration, pictures: Pictures | None = None, title: str = "Camera calibration") -> str:
    """The text of the page that `write_report` writes."""
    facts = measure(calibration)
    judged = calibration.verdict if calibration.verdict.judged else judge(calibration, facts)
    found = next_view(calibration)
    payload = {
        "title": title,
        "facts": sections.camera_facts(calibration, facts),
        "verdict": verdict.shown(judged, [*LIMITS.values()], calibration.camera.image_size, calibration.advice),
        "lens": numbers.lens(calibration),
        "models": numbers.models(calibration),
        "board": numbers.board(calibration),
        "cameras": [sections.drawings(calibration, facts)],
        "next_pose": None if found is None else suggested_pose(calibration, found),
        "boards_in_space": space.boards_in_space(calibration, _outline(calibration, found)),
        "histogram": histogram(calibration),
        "angle": charts.angle_chart(calibration),
        "sample": straight(calibration, pictures),
    }
    return filled("camera", payload, lambda budget: [gallery(calibration, pictures, budget)])


def _outline(calibration: Calibration, found: NextView | None) -> Array | None:
    """The outline (4, 3) of the suggested board, m, camera coordinates."""
    if found is None:
        return None
    plane = plane_of(calibration)
    return space.rectangle(found.pose, np.array([-1, -1]), np.array(found.size), calibration.spacing, plane)


def filled(
    template: str, payload: dict[str, Any], galleries: Callable[[int | None], Sequence[Gallery]] | None = None
) -> str:
    """The page of `template`. `galleries(budget)` are its pictures, with photographs of at most so many bytes, which is
    what the rest leaves; `galleries(None)`, for the size of the rest, without any."""
    payload = {**payload, "made": _origin(provenance())}
    if galleries is None:
        return render(template, **payload)
    bare = render(template, **payload, galleries=galleries(None))
    return render(template, **payload, galleries=galleries(LARGEST - SPARE - len(bare.encode())))


def _origin(made: dict[str, Any]) -> dict[str, str]:
    """The version, commit and date for the footer."""
    commit = str(made.get("commit", "unknown"))
    source = "" if commit == "unknown" else f", commit {commit[:12]}{'+' if commit.endswith('+') else ''}"
    return {"version": str(made["rcdn"]), "commit": source, "date": made["date"][:16].replace("T", " ")}
