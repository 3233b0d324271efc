"""Calibration of many cameras that see parts of the same boards: lenses, camera poses and boards jointly, with the
covariance of all camera poses."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence, Sized
from dataclasses import replace
from functools import cache, partial
from itertools import combinations

import numpy as np

from rcdn.calibration import robust
from rcdn.calibration.arguments import (
    check_boards,
    check_by_camera,
    check_camera,
    check_own_boards,
    check_truth,
    given_size,
)
from rcdn.calibration.board_paths import times_of
from rcdn.calibration.coded import Geometries, Spacing
from rcdn.calibration.common_model import one_model
from rcdn.calibration.fixed_boards import in_sets
from rcdn.calibration.known_lens import with_lens
from rcdn.calibration.labels import Size
from rcdn.calibration.lags import lags_of, late_moments
from rcdn.calibration.one_thread import one_thread
from rcdn.calibration.rig_facts import judged_rig, links_of, pairs_of
from rcdn.calibration.rig_fit import fitted
from rcdn.calibration.rig_graph import RigGraph, sights_of
from rcdn.calibration.rig_held_out import held_out_epipolar
from rcdn.calibration.rig_solution import RigSolution
from rcdn.calibration.rig_start import Key
from rcdn.calibration.rig_task import RigTask
from rcdn.calibration.time_shift import InStep, by_name, in_step
from rcdn.errors import CalibrationError, ConfigError, many, said_of
from rcdn.types import Array, Board, Calibration, Camera, FixedBoard, RigCalibration


@one_thread()
def calibrate_rig(
    views: Mapping[str, Sequence[Board]],
    spacing: Spacing,
    *,
    moments: Mapping[str, Sequence[str]] | None = None,
    names: Mapping[str, Sequence[str]] | None = None,
    model: str | Mapping[str, str] = "auto",
    size: Size | None = None,
    cameras: Mapping[str, Camera] | None = None,
    correct_time: bool = False,
    fixed_boards: bool = False,
) -> RigCalibration:
    """Calibrate cameras fixed to each other, from boards that each two neighbours saw at the same moment; no board must
    be seen by all.

    `views`: the boards of each camera by its name; partial ones, and those that no other camera saw, help its lens.
    `moments`: for each camera, the moment of each of its boards: boards of one moment (and one target) are the same
    board (default: the k-th boards of all cameras belong together, and each camera must have as many). `names` of the
    boards' images. `model`: of all cameras, or by name. `cameras`: by name those whose lens is known: it is held
    constant, and one image of a board is enough for them. `correct_time`: cameras with a clear time shift, as measured
    with moving boards, are corrected; moments that end in numbers count frames by them. Whole moments by which a camera
    is late, and agrees with no other one for that, are corrected in any case. `fixed_boards`: the different boards are
    fixed to each other (on both sides of a plate, on a frame, in a room), and their relative poses are estimated, too:
    cameras are also connected by different boards at one moment. All else as in `calibrate`; the first camera of the
    largest connected component defines the rig's frame.

    Each camera is calibrated alone first; under `auto`, cameras that see at the same angles get one lens model. Pairs
    that agree on their relative pose are the edges of a graph; its best spanning tree, with rotations and then
    translations averaged over all edges, is the initial guess of one least-squares fit of lenses, camera poses and
    boards, whose poses are eliminated; of the board's shape, too, unless a perfect board predicts held-out moments far
    better. Views that disagree are left out and named. Covariances are estimated from the residuals of whole
    moments. Boards with codes may be seen from behind (`from_behind`). Raises CalibrationError if a camera cannot be
    calibrated, or no two are connected; ConfigError for a wrong argument.
    """
    check_by_camera(views, "views", "lists of boards")
    check_truth(correct_time, "correct_time")
    check_truth(fixed_boards, "fixed_boards")
    order = list(views)
    if len(order) < 2:
        raise ConfigError(f"views must hold two cameras or more, not {len(order)}")
    given, size = _given(order, cameras), given_size(size)
    if names is not None:
        check_by_camera(names, "names", "lists of the boards' pictures")
    if not isinstance(model, str):
        check_by_camera(model, "model", "lens models")
    if not isinstance(model, str) and (missing := [n for n in order if n not in model and n not in given]):
        raise ConfigError(f"model must name a lens model for each camera; it has none for {', '.join(missing)}")
    boards = [b for name in order for b in _checked(name, views[name])]
    when = _moments(views, moments)
    geometries = Geometries.of(boards, spacing, size)
    check_own_boards(order, list(views.values()), when)

    @cache
    def as_model(camera: int, lens: str) -> Calibration:
        name = order[camera]
        with said_of(f"camera {name}", CalibrationError):
            return with_lens(views[name], geometries, (names or {}).get(name), given.get(name, lens), size is not None)

    lenses = [
        given[name].model if name in given else model if isinstance(model, str) else model[name] for name in order
    ]
    alone = [as_model(c, lens) for c, lens in enumerate(lenses)]
    unnamed = [c for c, lens in enumerate(lenses) if lens == "auto"]
    alone = _of_one_make(alone, unnamed, as_model, sights_of(alone, when))
    known = [name in given for name in order]
    graph, time, lags = _graph(alone, when, known, fixed_boards)
    main = graph.parts[0]
    if len(main) < 2:
        raise CalibrationError(_why(order, graph, list(given)))
    edges, places, fits = graph.pairs.placed(main, graph.edges)
    graph = replace(graph, edges=edges, fixed=graph.fixed.only({key[1] for key in fits.boards}))
    fits = in_sets(fits, graph.fixed, places, graph.sights)
    task = RigTask.of(main, alone, graph.sights, fits, graph.when, [known[c] for c in main], graph.fixed)
    state = task.start(alone, places)
    spaced = alone[task.shape].spacing
    fit = fitted(task.joint, state, shaped=alone[task.shape].shape is not None, spacing=spaced)
    step = in_step(task, fit, time, correct_time, spaced, [lags.get(c, 0) for c in main])
    found = _result(task, step, order, alone, graph, tuple(n for n in order if n in given))
    return judged_rig(found, correct_time)


def _checked(name: str, boards: Sequence[Board]) -> Sequence[Board]:
    check_boards(boards, f"views[{name!r}]")
    return boards


def _given(order: Sequence[str], cameras: Mapping[str, Camera] | None) -> dict[str, Camera]:
    """The cameras whose lens is known. Raises ConfigError for a name without views, and for what is no camera."""
    if cameras is not None:
        check_by_camera(cameras, "cameras", "cameras whose lens is known")
    for name, camera in (cameras or {}).items():
        check_camera(camera, f"cameras[{name!r}]")
    if unknown := [name for name in cameras or {} if name not in order]:
        raise ConfigError(
            f"cameras holds {', '.join(unknown)}, which views don't have; they are of {', '.join(order)}: "
            "give the same names"
        )
    return dict(cameras or {})


def _moments(views: Mapping[str, Sequence[Board]], moments: Mapping[str, Sequence[str]] | None) -> list[list[str]]:
    """For each camera, the moment of each of its boards."""
    if moments is None:
        _check_as_many(views)
        return [[str(k) for k in range(len(boards))] for boards in views.values()]
    check_by_camera(moments, "moments", "lists of the boards' moments")
    for name, boards in views.items():
        if name not in moments or not isinstance(moments[name], Sized) or len(moments[name]) != len(boards):
            raise ConfigError(f"moments[{name!r}] must have one entry a board: {len(boards)}")
    return [[str(m) for m in moments[name]] for name in views]


def _check_as_many(views: Mapping[str, Sequence[Board]]) -> None:
    """Raise ConfigError unless all cameras have as many boards, as they must where order alone tells moments."""
    if len({len(boards) for boards in views.values()}) > 1:
        counts = ", ".join(f"{name} has {many(len(boards), 'board')}" for name, boards in views.items())
        raise ConfigError(
            f"views: {counts}: say at which moment each board was seen, moments={{{next(iter(views))!r}: ['0', '1', "
            "…], …}, or leave out the boards of moments at which another camera saw none"
        )


def _of_one_make(
    alone: list[Calibration],
    unnamed: Sequence[int],
    as_model: Callable[[int, str], Calibration],
    sights: Sequence[Mapping[Key, int]],
) -> list[Calibration]:
    """The calibrations, with one lens model for those of the cameras `unnamed` that are of one make (`one_model`,
    pairwise)."""
    found = list(alone)
    for _ in unnamed:
        before = [c.models[0].model for c in found]
        for a, b in combinations(unnamed, 2):
            pairs = [(sights[a][key], sights[b][key]) for key in sights[a].keys() & sights[b].keys()]
            both = partial(_one_as, (a, b), as_model)
            found[a], found[b], _ = one_model((found[a], found[b]), both, pairs)
        if before == [c.models[0].model for c in found]:
            break
    return found


def _one_as(both: tuple[int, int], as_model: Callable[[int, str], Calibration], side: int, lens: str) -> Calibration:
    """The calibration of the first or the second of two cameras with a lens model."""
    return as_model(both[side], lens)


def _graph(
    alone: Sequence[Calibration], when: Sequence[Sequence[str]], known: Sequence[bool], fixed_boards: bool
) -> tuple[RigGraph, dict[str, float], dict[int, int]]:
    """The graph, the time of each moment, and the cameras' lags, by which moments are counted anew if that connects
    more cameras."""
    graph, time = RigGraph.of(alone, when, known, fixed_boards), times_of(m for each in when for m in each)
    lags = lags_of(alone, graph.sights, time, graph.parts)
    if lags:
        later, times = late_moments(when, time, lags)
        anew = RigGraph.of(alone, later, known, fixed_boards)
        if len(anew.parts[0]) > len(graph.parts[0]):
            return anew, times, lags
    return graph, time, {}


def _why(order: Sequence[str], graph: RigGraph, given: Sequence[str]) -> str:
    a, b, most = graph.most_shared()
    return (
        f"no two cameras agree on where they stand: {order[a]} and {order[b]} share most whole boards, {most}; "
        "were the pictures taken at the same moments, and do their names or numbers say which belong together?"
        + (f" And are the lenses given for {', '.join(given)} theirs?" if given else "")
    )


def _result(
    task: RigTask,
    step: InStep,
    order: list[str],
    alone: list[Calibration],
    graph: RigGraph,
    given: tuple[str, ...],
) -> RigCalibration:
    main, fit = task.cameras, step.fit
    solution = RigSolution.of(task, fit, step.taken, step.lost)
    names = tuple(order[c] for c in main)
    rig = solution.rig(names)
    done = solution.cameras(alone, rig)
    boards = {key: T for key, T in task.poses_of(fit.state).items() if not fit.reasons[task.boards[key]]}
    return RigCalibration(
        rig=rig,
        cameras=dict(zip(order, done, strict=True)),
        boards=boards,
        rms=solution.rms,
        pairs=pairs_of(order, done, graph.sights, _epipolar(task, step, names)),
        components=tuple(tuple(order[c] for c in part) for part in graph.parts),
        links=links_of(order, done, graph.parts, graph.when),
        thin=tuple(order[c] for c in main if len(graph.shared(c)) == 1),
        shifts=by_name(step.shifts, names),
        corrected=tuple(names[c] for c in step.late),
        given=given,
        fixed_boards=_boards(task, fit, alone, solution.cov[solution.places.stop :, solution.places.stop :]),
    )


def _boards(task: RigTask, fit: robust.Fit, alone: Sequence[Calibration], cov: Array) -> tuple[FixedBoard, ...]:
    """The boards that are fixed to each other. `cov`: of the parameters from their places on."""
    targets = {key[1]: alone[c].views[k].target for c in task.cameras for key, k in task.sights[c].items()}
    found, at = [], 0
    for each in task.fixed.sets:
        for board in each:
            first = next(iter(each))
            if board == first:
                found.append(FixedBoard(board, _named(targets[board]), first, np.eye(4), np.zeros((6, 6))))
                continue
            T, mine = fit.state.boards[1 + at], slice(6 * at, 6 * at + 6)
            found.append(FixedBoard(board, _named(targets[board]), first, T, cov[mine, mine]))
            at += 1
    return tuple(found)


def _named(target: object) -> str:
    return "plain" if target is None else str(target)


def _epipolar(task: RigTask, step: InStep, names: Sequence[str]) -> dict[tuple[str, str], float]:
    """By two cameras, the distance of their corners from epipolar planes in held-out moments, px."""
    found = held_out_epipolar(step.fit, step.corners, task.ij, task.cluster)
    return {(names[a], names[b]): gap for (a, b), gap in found.items()}
