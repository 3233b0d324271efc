"""Table 4 (section 4.4): calibration and pose errors of several detectors with one solver, half and half.

On a rendered stereo pair, for which the truth is known, and on photographs of public sets. One row for each set and
detector: the cameras of a set count together, as the paper's two do.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import CalibrationError, ConfigError, present
from rcdn.synthetic import Scene
from rcdn_lab.calibration import SETS, CameraSet, Contestant, chosen
from rcdn_lab.calibration.detectors import OURS
from rcdn_lab.calibration.pictures import Found, common, detect, whole
from rcdn_lab.calibration.protocol import FEWEST, SEED, SPLITS
from rcdn_lab.calibration.run import ALL, COMMON, core, largest
from rcdn_lab.paper import stereo_pair
from rcdn_lab.paper.table4_figures import Boards, Figures, Rig, Truth, figures, relabelled, rig_of
from rcdn_lab.paper.table4_published import EYE_TRACKER, RATIOS, REFERENCE, WIDE_ANGLE, compared, published_rows
from rcdn_lab.peers import Grid
from rcdn_lab.share_out import share_out
from rcdn_lab.weights import weights_of

DETECTORS = ("auto", "paper", "opencv", "opencv-sb", "boofcv-size", "geiger", "rochade", "ocpad", "ocamcalib")
VIEWS, FULL_VIEWS = 30, 100
"""views of the rendered pair: by default, and as many as in the paper"""
RENDERED = "rendered"
TRUE = "truth"
Row = dict[str, Any]


@dataclass(frozen=True)
class PaperSet:
    """Pictures of one board by the `cameras` of one mount, in the folder `data`; `like`: the paper's set that it
    replaces; `truth` of the cameras, if it is known."""

    name: str
    like: str
    cameras: tuple[CameraSet, ...]
    data: Path | None = None
    truth: tuple[Truth, ...] = ()


def _known(name: str, like: str, *cameras: str) -> PaperSet:
    by_name = {s.name: s for s in SETS}
    return PaperSet(name, like, tuple(by_name[c] for c in cameras))


REAL = (
    _known("opencv-left-right", EYE_TRACKER, "opencv-left", "opencv-right"),
    _known("sourishg-stereo1", EYE_TRACKER, "stereo1-left", "stereo1-right"),
    _known("rochade-gopro-a", WIDE_ANGLE, "gopro"),
    _known("udacity-wide", WIDE_ANGLE, "udacity-wide"),
)
"""Photographs that replace the paper's two sets, which are not public: two stereo pairs and two wide-angle cameras."""
NAMES = (RENDERED, *(s.name for s in REAL))


def rendered(views: int, seed: int, folder: Path) -> tuple[PaperSet, list[tuple[Scene, Path]]]:
    """The rendered pair, with pictures in `folder`, and the drawings to be made there (`table4_work.draw`)."""
    made = stereo_pair.views(views, seed)
    cameras = tuple(CameraSet(f"{RENDERED}, {side}", f"{side}*.png", stereo_pair.SIZE) for side in stereo_pair.SIDES)
    truth = tuple(
        Truth(stereo_pair.camera_of(side), np.array([v.T[c] for v in made]), np.array([v.xy[c] for v in made]))
        for c, side in enumerate(stereo_pair.SIDES)
    )
    return PaperSet(RENDERED, EYE_TRACKER, cameras, folder, truth), stereo_pair.pictures(made, folder)


def sets_of(texts: Sequence[str], data: Path | None) -> tuple[list[PaperSet], dict[str, str]]:
    """The photographs among `texts`, and for each of the others the reason why it cannot be used.

    A name is one of `NAMES`, or an argument of `rcdn evaluate calibration --set`: then one camera, assigned to the
    paper's set by its lens. Raises ConfigError for an unknown name.
    """
    ours = {s.name: s for s in REAL}
    wanted = [s for t in dict.fromkeys(texts) if t != RENDERED for s in ([ours[t]] if t in ours else _single(t))]
    found, missing = [], {}
    for one in wanted:
        try:
            if data is None:
                raise ConfigError("no folder of photographs: name it by --data or RCDN_DATA")
            for camera in one.cameras:
                camera.files(data)
            found.append(replace(one, data=data))
        except ConfigError as error:
            missing[one.name] = str(error)
    return found, missing


def _single(text: str) -> list[PaperSet]:
    return [PaperSet(c.name, WIDE_ANGLE if c.model == "fisheye" else EYE_TRACKER, (c,)) for c in chosen([text])]


def sized_pictures(sets: Sequence[PaperSet]) -> list[tuple[Path, tuple[int, int]]]:
    """All pictures, with the size of the board in each (`table4_work.fill`)."""
    return [(path, c.size) for s in sets if s.data is not None for c in s.cameras for path in c.files(s.data)]


def table(
    sets: Sequence[PaperSet],
    detectors: Sequence[Contestant],
    missing: dict[str, str] | None = None,
    skipped: dict[str, str] | None = None,
    workers: int = 1,
    step: Callable[[int, int], None] | None = None,
) -> list[Row]:
    """The rows: of each set on all pictures that a detector found and on those in common, of what cannot run here, and
    the paper's.

    `on` all: the largest board of each picture, including parts, no corner left out. `on` common: the pictures in which
    all detectors found the whole board, with the same corners for all; a detector that finds less than 60 % of the most
    is excluded and has rows `with NAME`, compared with `auto` and OpenCV; our preset `paper`, where it would reduce the
    comparison, has them compared with all. `missing`: detectors that cannot run, `skipped`: sets without pictures, with
    the reason. `step` is called with the number of rows done and in total. The same arguments give the same rows,
    whatever `workers`. Raises ConfigError if there is no detector.
    """
    if not detectors:
        raise ConfigError("--detectors: none of them can run here; name one that is installed")
    jobs = [job for one in sets for job in _jobs(one, detectors)]
    rows = list(share_out(_measured, jobs, workers, _nothing, (), step))
    rows += [_row(name, "", "-", "-", note=f"skipped: {why}") for name, why in (skipped or {}).items()]
    rows += [_row("-", "", "-", name, note=f"skipped: {why}") for name, why in (missing or {}).items()]
    return compared(rows) + [_row(**p) for p in published_rows()]


def settings_of(sets: Sequence[PaperSet], detectors: Sequence[Contestant], views: int, seed: int) -> dict[str, Any]:
    """Settings recorded with the figures."""
    cameras = [c for s in sets for c in s.cameras]
    return {
        "sets": {c.name: f"{c.pattern}, {c.size[0]}x{c.size[1]}, {c.model}" for c in cameras},
        "detectors": {d.name: d.version for d in detectors}, "weights": weights_of(d.name for d in detectors),
        "rendered views": views, "seed": seed, "first seed": stereo_pair.FIRST,
        "splits": SPLITS, "seed of splits": SEED, "fewest pictures of a camera": FEWEST,
        "error": "root of the mean squared length of observed - projected, px",
    }  # fmt: skip


COUNTS = ("pictures", "whole", "views", "corners")


def _row(
    set: str, like: str, on: str, detector: str, counts: dict[str, int] | None = None, figures: Figures | None = None,
    rig: Rig | None = None, note: str = "", **more: Any,
) -> Row:  # fmt: skip
    """A row; unknown values are None. `counts`: pictures, those with the `whole` board, `views` that are used and their
    `corners`."""
    place = asdict(rig or Rig())
    notes = [note, place.pop("note")]
    numbers = asdict(figures or Figures()) | place
    if figures and any(np.isinf(v) for v in asdict(figures).values()):
        notes.append("a camera couldn't see a corner")
    plain = {k: v if np.isfinite(v) and (k != "pairs" or rig) else None for k, v in numbers.items()}
    row = {"set": set, "like": like, "on": on, "detector": detector} | dict.fromkeys(COUNTS) | (counts or {})
    row |= {"cal": plain.pop("cal"), "pose": plain.pop("pose")} | dict.fromkeys(RATIOS) | plain
    return row | {"note": "; ".join(filter(None, notes))} | more


# ---- one set


@dataclass(frozen=True, eq=False)
class _Job:
    """The data from which one row is computed; `stereo`: the relative pose of the cameras is known."""

    set: str
    like: str
    on: str
    detector: str
    parts: list[Boards]
    counts: dict[str, int]
    note: str
    stereo: bool


def _jobs(one: PaperSet, detectors: Sequence[Contestant]) -> list[_Job]:
    """Run the detectors on all pictures of a set; the jobs of its rows."""
    data = present(one.data, "the data of a set")
    found = [detect(camera, data, detectors) for camera in one.cameras]
    wholes = {d.name: _wholes(one, found, d.name) for d in detectors}
    counts = {n: {"pictures": sum(len(f.names) for f in found), "whole": len(w)} for n, w in wholes.items()}
    stereo = len(one.cameras) == len(one.truth) == 2
    jobs = []
    for name in counts:
        note = "; ".join(n for f in found for n in (f.notes[""], f.notes[name]) if n)
        parts = _all_boards(one, found, name)
        jobs.append(_Job(one.name, one.like, ALL, name, parts, counts[name], note, stereo))
    for on, names in _groups(wholes).items():
        alike, note = _common_boards(one, found, names)
        jobs += [_Job(one.name, one.like, on, n, alike[n], counts[n], note, stereo) for n in names]
    return jobs


def _wholes(one: PaperSet, found: Sequence[Found], name: str) -> set[tuple[int, int]]:
    """Camera and picture of the whole boards of a detector."""
    return {
        (c, k)
        for c, (camera, f) in enumerate(zip(one.cameras, found, strict=True))
        for k, grids in enumerate(f.grids[name])
        if whole(grids, camera.size) is not None
    }


def _groups(wholes: dict[str, set[tuple[int, int]]]) -> dict[str, list[str]]:
    """The detectors compared on the same pictures."""
    many = core(wholes)
    first = [n for n in many if n in ("auto", REFERENCE)] or many[:1]
    return {COMMON: many} | {f"with {n}": [*(many if n in OURS else first), n] for n in wholes if n not in many}


def _nothing() -> None:
    pass


def _measured(job: _Job) -> Row:
    parts, note, seen = job.parts, job.note, Figures()
    counts = job.counts | {"views": sum(len(p.boards) for p in parts), "corners": sum(p.corners for p in parts)}
    if any(len(p.boards) < FEWEST for p in parts):
        note = "; ".join(filter(None, [note, f"under {FEWEST} pictures of a camera"]))
    rig = None
    if job.stereo:
        rig = rig_of(parts[0], parts[1], stereo_pair.SPACING, stereo_pair.right_from_left())
    try:
        seen = figures(parts)
    except (CalibrationError, np.linalg.LinAlgError) as error:
        note = "; ".join(filter(None, [note, f"no calibration: {error}"]))
    return _row(job.set, job.like, job.on, job.detector, counts, seen, rig, note)


def _all_boards(one: PaperSet, found: Sequence[Found], name: str) -> list[Boards]:
    """All boards that a detector found, with true labels where they are known."""
    parts = []
    for c, (camera, f) in enumerate(zip(one.cameras, found, strict=True)):
        truth = one.truth[c] if one.truth else None
        seen = {k: b for k, b in enumerate(map(largest, f.grids[name])) if b is not None}
        if truth is not None:
            seen = {k: (relabelled(ij, xy, truth.xy[k], camera.size), xy) for k, (ij, xy) in seen.items()}
        boards = list(seen.values())
        parts.append(Boards(list(seen), boards, f.image_size, camera.size, camera.model, len(f.names), truth))
    return parts


def _common_boards(one: PaperSet, found: Sequence[Found], names: Sequence[str]) -> tuple[dict[str, list[Boards]], str]:
    """The corners that all of `names` found, by detector and camera, and the number of pictures on which they
    disagree."""
    parts: dict[str, list[Boards]] = {n: [] for n in names}
    disputed = 0
    for c, (camera, f) in enumerate(zip(one.cameras, found, strict=True)):
        some, truth = f.of(names), one.truth[c] if one.truth else None
        if truth is not None:  # the first of them determines the rotation of the boards
            ij = np.stack(np.meshgrid(*map(np.arange, camera.size)), axis=-1).reshape(-1, 2)
            true: list[tuple[Grid, ...]] = [(Grid(xy, ij),) for xy in truth.xy]
            some = replace(some, grids={TRUE: true} | some.grids)
        same = common(some, camera.size)
        disputed += same.disputed
        for n in names:
            boards = [(same.ij, xy) for xy in same.xy[n]]
            parts[n].append(Boards(same.index, boards, f.image_size, camera.size, camera.model, len(same.index), truth))
    return parts, f"{disputed} pictures disputed" if disputed else ""
