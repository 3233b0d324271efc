"""The camera without its smooth correction, solved from the same corners, for files that hold coefficients only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rcdn.calibration.bundle import default_free, with_fixed
from rcdn.calibration.difference import camera_difference
from rcdn.calibration.influence import corners_of, held_fixed, state_of
from rcdn.calibration.solver import solve
from rcdn.errors import CalibrationError, FormatError
from rcdn.geometry import lens_trouble
from rcdn.geometry.fit_lens import ALONG
from rcdn.geometry.spline_grid import frame_pixels
from rcdn.io import CameraFormat, LensFit, check_lens, lens_fit
from rcdn.types import Calibration, Camera


def plain_lens(calibration: Calibration, start: Camera) -> Camera:
    """The camera without a correction, of the lens model of `start`, with the least reprojection error in the corners
    that the calibration uses.

    All corners have the same weight: what a plain lens leaves is its misfit, not their noise. The poses are solved
    again, and the shape of the board is kept. Unlike the lens nearest to the corrected one over the frame, it follows
    the corners, not what the correction extrapolates beyond them; its axes differ slightly from those of
    `calibration.camera`. Raises CalibrationError if the result is not usable.
    """
    views = calibration.used_views
    corners, _ = corners_of(calibration, views, [view.used for view in views])
    state = replace(state_of(calibration, views), cameras=(start,), smooth=())
    state = with_fixed(state, held_fixed(calibration))
    camera = solve(state, corners, np.ones(len(corners)), default_free(state)).state.cameras[0]
    if trouble := lens_trouble(camera):
        raise CalibrationError(f"without its correction, {trouble}")
    return camera


def plain_fit(path: str, calibration: Calibration, format: CameraFormat | None = None) -> LensFit | None:
    """What a camera file holds of a calibration whose camera has a correction that the file's format can't represent:
    the `plain_lens` of the calibration's own model, if the format has it, else of that of `lens_fit`. None if the
    format represents the camera exactly or by a spline. Raises FormatError as `lens_fit`."""
    found = lens_fit(path, calibration.camera, format)
    if found is None or not isinstance(found.held, Camera):
        return found
    start = replace(calibration.camera, correction=None)
    try:
        check_lens(path, start, format)
    except FormatError:
        start = found.held
    try:
        camera = plain_lens(calibration, start)
        check_lens(path, camera, format)
    except (CalibrationError, FormatError):
        return found
    lengths = camera_difference(camera, calibration.camera, frame_pixels(camera.image_size, ALONG)).lengths
    if not np.isfinite(lengths).any():
        return found
    rms, largest = float(np.sqrt(np.nanmean(lengths**2))), float(np.nanmax(lengths))
    return LensFit(camera, camera.model, rms, largest, solved=True)
