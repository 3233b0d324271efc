"""Videos that were not started together: by how many frames each camera is late, from boards in evenly spaced frames of
all of them, and the frames to use then."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from rcdn.batch.calibration_runs import Problem, Run, flat
from rcdn.batch.pairs import stems
from rcdn.errors import CalibrationError, many
from rcdn.terminal import console
from rcdn.terminal.spacing import metres

if TYPE_CHECKING:
    from rcdn.batch.inputs import Gathered
    from rcdn.types import Calibration, Camera

DENSE, FOR_LENS = 300, 30
"""largest numbers of evenly spaced frames of each video that are looked at, and of boards that determine its lens"""


def lags_of_videos(
    run: Run,
    cameras: Mapping[str, Sequence[str]],
    found: Mapping[str, Gathered],
    problem: Problem,
    known: Mapping[str, Camera],
) -> dict[str, int]:
    """By camera, how many frames its video is late against those that most are in step with; empty if nothing tells,
    or if an input isn't one video. `found`: the boards of each camera, which determine its lens well enough if it isn't
    `known`."""
    from rcdn.calibration.lags import lags_of
    from rcdn.calibration.rig_graph import sights_of
    from rcdn.calibration.rig_start import components_of, edges_of
    from rcdn.calibration.time_shift import times_of
    from rcdn.types.limits import READ_IN_A_MIRROR

    if not all(got.one_video for got in found.values()):
        return {}
    last = max(max(got.frames[0], default=0) for got in found.values())
    numbers = tuple(range(0, last + 1, -(-(last + 1) // DENSE)))
    console.note(
        f"the cameras don't agree on where they stand: looking at {many(len(numbers), 'frame')} of each video for how "
        "far they are out of step"
    )
    try:
        dense = {name: run.gather(inputs, (numbers,), silent=READ_IN_A_MIRROR) for name, inputs in cameras.items()}
        lenses = [known.get(name) or _lens(run, found[name], problem) for name in cameras]
        posed = [_posed(run, dense[name], problem, lens) for name, lens in zip(cameras, lenses, strict=True)]
    except CalibrationError:
        return {}
    when = [stems([view.name for view in each.views], 0) for each in posed]
    sights = sights_of(posed, when)
    parts = components_of(len(posed), edges_of(posed, sights))
    lags = lags_of(posed, sights, times_of(m for each in when for m in each), parts)
    return {name: lags[c] for c, name in enumerate(cameras) if c in lags}


def _lens(run: Run, found: Gathered, problem: Problem) -> Camera:
    from rcdn.calibration import calibrate

    boards, names = flat(found.images)
    some = slice(None, None, -(-len(boards) // FOR_LENS))
    return calibrate(
        boards[some], metres(problem.spacing), names=names[some], model=problem.model, size=run.size
    ).camera


def _posed(run: Run, found: Gathered, problem: Problem, lens: Camera) -> Calibration:
    """The poses of all boards of a camera."""
    from rcdn.calibration.coded import Geometries
    from rcdn.calibration.known_lens import with_known_lens

    boards, names = flat(found.images)
    return with_known_lens(boards, Geometries.of(boards, metres(problem.spacing), run.size), names, lens)
