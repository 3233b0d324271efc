"""Videos that were not started together: by how many frames each camera is late, from boards in evenly spaced frames of
all of them, and the frames to use then."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from rcdn.batch.calibration_runs import BoardReader, Problem, flat
from rcdn.batch.pairs import stems
from rcdn.errors import CalibrationError, many
from rcdn.terminal import console
from rcdn.terminal.spacing import metres

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered
    from rcdn.types import Calibration, Camera

DENSE, FOR_LENS = 300, 30
"""largest numbers of evenly spaced frames of each video that are looked at, and of boards that determine its lens"""


def in_step(
    reader: BoardReader,
    cameras: Mapping[str, Sequence[str]],
    found: Mapping[str, Gathered],
    problem: Problem,
    known: Mapping[str, Camera],
) -> dict[str, Gathered] | None:
    """The detections of each camera in the frames of its video that show what the others show in those that were
    `found`; None if time isn't to be corrected, nothing tells how late the videos are, or an input isn't one video.

    `found` also determines the lens of a camera, well enough, if it isn't `known`.
    """
    from rcdn.types.limits import READ_IN_A_MIRROR

    if not problem.correct_time or not all(got.one_video for got in found.values()):
        return None
    last = max(max(got.frames[0], default=0) for got in found.values())
    numbers = tuple(range(0, last + 1, -(-(last + 1) // DENSE)))
    console.note(
        f"the cameras don't agree on where they stand: looking at {many(len(numbers), 'frame')} of each video for how "
        "far they are out of step"
    )
    try:
        dense = {name: reader.gather(inputs, (numbers,), silent=READ_IN_A_MIRROR) for name, inputs in cameras.items()}
        lenses = [known.get(name) or _lens(reader, found[name], problem) for name in cameras]
        posed = [_posed(reader, dense[name], problem, lens) for name, lens in zip(cameras, lenses, strict=True)]
    except CalibrationError:
        return None
    late = dict(zip(cameras, _lags(posed), strict=True))
    if not any(late.values()):
        return None
    moments = with_neighbours(n + late[name] for name, got in found.items() for n in got.frames[0])
    out = {}
    for name, inputs in cameras.items():
        frames = tuple(sorted(m - late[name] for m in moments if m >= late[name]))
        out[name] = reader.seen_from_behind(name, inputs, reader.gather(inputs, (frames,), silent=READ_IN_A_MIRROR))
    return out


def with_neighbours(numbers: Iterable[int]) -> set[int]:
    """Frame numbers together with those before and after them: they determine how the boards move."""
    return {n + by for n in numbers for by in (-1, 0, 1)}


def _lags(cameras: Sequence[Calibration]) -> list[int]:
    """By how many frames each camera is late against those that most are in step with."""
    from rcdn.calibration.board_paths import times_of
    from rcdn.calibration.lags import lags_of
    from rcdn.calibration.rig_graph import sights_of
    from rcdn.calibration.rig_start import components_of, edges_of

    when = [stems([view.name for view in each.views]) for each in cameras]
    sights = sights_of(cameras, when)
    parts = components_of(len(cameras), edges_of(cameras, sights))
    found = lags_of(cameras, sights, times_of(m for each in when for m in each), parts)
    return [found.get(c, 0) for c in range(len(cameras))]


def _lens(reader: BoardReader, found: Gathered, problem: Problem) -> Camera:
    from rcdn.calibration import calibrate

    boards, names = flat(found.images)
    some = slice(None, None, -(-len(boards) // FOR_LENS))
    return calibrate(
        boards[some], metres(problem.spacing), names=names[some], model=problem.model, size=reader.size
    ).camera


def _posed(reader: BoardReader, found: Gathered, problem: Problem, lens: Camera) -> Calibration:
    """The poses of all boards of a camera."""
    from rcdn.calibration.coded import Geometries
    from rcdn.calibration.known_lens import with_known_lens

    boards, names = flat(found.images)
    geometries = Geometries.of(boards, metres(problem.spacing), reader.size)
    return with_known_lens(boards, geometries, names, lens, strict=reader.size is not None)
