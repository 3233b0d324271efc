"""Calibration with a known lens, which is held constant: poses of the boards, checks of the lens by their residuals,
and the board's shape."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rcdn.calibration import choose, fit_checks, robust, view_checks
from rcdn.calibration.advice import notes
from rcdn.calibration.bundle import State, default_free
from rcdn.calibration.calibrate import check_arguments, names_of, pictures_of, result_of, with_geometries
from rcdn.calibration.coded import Geometries
from rcdn.calibration.facts import measure
from rcdn.calibration.near_duplicates import alike
from rcdn.calibration.shape import FEWEST_SHAPED, FUNCTIONS
from rcdn.calibration.start import poses
from rcdn.calibration.usable import Usable, usable, with_poses
from rcdn.calibration.verdict import Check, sentences, verdict_of
from rcdn.errors import CalibrationError
from rcdn.types import Array, Board, Calibration, Camera, ModelScore, Reason

FEWEST_POSES = 1
"""fewest views: a camera with a known lens needs no more"""
CHECKS: tuple[Check, ...] = (
    view_checks.picture_size,
    view_checks.spacing,
    view_checks.board_size,
    view_checks.left_out,
    fit_checks.dropped,
    fit_checks.systematic,
    fit_checks.smooth,
    fit_checks.uneven,
    fit_checks.rms,
)
"""checks of a camera with a given lens: without those on whether its views determine a lens"""
LENS_CHECKS = ("systematic", "smooth", "rms", "crowded")
"""checks that a wrong lens fails"""
ANOTHER_LENS = (
    "Calibrate without the given lens, so that it is solved for: zoom, focus or the picture's size may have changed."
)


def with_known_lens(
    boards: Sequence[Board], geometries: Geometries, names: Sequence[str], camera: Camera, strict: bool = False
) -> Calibration:
    """The calibration with `camera` held constant, without a verdict: poses, residuals, and the board's shape if it
    predicts held-out images better. `strict`: plain boards that cannot be part of the whole board are refused.

    One view is enough. The lens has no standard deviations; its covariance is zero. Raises CalibrationError if the
    images have another size than the camera, or no board has a pose.
    """
    _check_size(boards, camera)
    whole = geometries.main
    labels = geometries.labelled(boards, strict)
    task = usable(boards, labels, names, camera.image_size, whole, FEWEST_POSES)
    task, T = with_poses(task, poses(camera, task.seen), FEWEST_POSES)
    start = State.mono(camera, T)
    start, noise = robust.initial_fit(start, task.corners, task.sigma, default_free(start, lens=False))
    flat = _fitted(task, start, noise, whole.spacing)
    fit = flat
    if task.settled >= FEWEST_SHAPED and choose.enough_pictures(task.picture):
        shaped = replace(flat.state, shape=np.zeros((len(FUNCTIONS), 3)), prior=None)
        curved = _fitted(task, shaped, flat.noise, whole.spacing)
        common = choose.Task(task.corners, curved.weight, task.picture)
        errors = [choose.held_out_rms(f.state, common, _free(f.state)) for f in (curved, flat)]
        fit = curved if errors[0] * choose.SIMPLER < errors[1] else flat
    lens = camera.model if camera.correction is None else f"{camera.model} with spline"
    score = ModelScore(lens, choose.rms(fit.residuals, fit.weight), float("nan"))
    return result_of(task, boards, labels, names, fit, whole, (score,), FEWEST_POSES)


def with_lens(
    boards: Sequence[Board],
    geometries: Geometries,
    names: Sequence[str] | None,
    lens: str | Camera,
    strict: bool = False,
) -> Calibration:
    """The calibration of one camera with a lens model or with a known lens, without a verdict; `strict`: plain boards
    that cannot be part of the whole board are refused."""
    check_arguments(boards, names, lens if isinstance(lens, str) else "auto", None)
    if isinstance(lens, Camera):
        return with_known_lens(boards, geometries, names_of(boards, names), lens, strict)
    return with_geometries(boards, geometries, names_of(boards, names), lens, strict=strict)


def _fitted(task: Usable, start: State, noise: float, spacing: float) -> robust.Fit:
    """Fit of the poses, and of the board's shape if the state has one."""
    cluster = alike(task.corners, start.cameras[0].image_size, pictures_of(task))
    return robust.fit(start, noise, task.corners, task.sigma, _free(start), cluster, spacing)


def _free(state: State) -> Array:
    """Which shared parameters are unknown: the board's shape, if the state has one."""
    return default_free(state, shape=True, lens=False)


def _check_size(boards: Sequence[Board], camera: Camera) -> None:
    if boards and not any(b.image_size == camera.image_size for b in boards):
        (w, h), (width, height) = boards[0].image_size, camera.image_size
        raise CalibrationError(
            f"its pictures have {w}×{h} px, but the camera given is one of {width}×{height}: give a camera of this "
            "size, or none, so that its lens is solved for"
        )


def judged_known(calibration: Calibration) -> Calibration:
    """`calibration` with the verdict on a camera with a given lens: whether it explains its images."""
    facts = measure(calibration)
    found = verdict_of([_of_given(reason) for check in CHECKS for reason in check(calibration, facts)])
    return replace(calibration, verdict=found, advice=sentences(found) + notes(calibration))


def _of_given(reason: Reason) -> Reason:
    """A reason against a camera whose lens was given: what to do where that lens may be the wrong one."""
    return replace(reason, action=ANOTHER_LENS) if reason.action and reason.key in LENS_CHECKS else reason
