"""The response of a network in the central part of a small picture, without computing the rest."""

from __future__ import annotations

import cv2
import numpy as np

from rcdn.corners.normalise import normaliser
from rcdn.corners.response import ResponseModel
from rcdn.corners.sieve import every_cell
from rcdn.errors import RcdnError
from rcdn.types import Array


def middle_response(model: ResponseModel, grey: Array, low: int, high: int) -> Array:
    """Rows and columns `low` to `high` - 1 of `model(grey)`, (high - low, high - low) float32.

    `grey` (H, W) uint8, square. The whole picture is normalised, the network is evaluated on the central part and its
    margins only. Raises RcdnError unless 0 <= `low` < `high` <= the picture's side.
    """
    side = min(grey.shape)
    if not 0 <= low < high <= side:
        raise RcdnError(f"middle_response: low and high must be 0 <= low < high <= {side}, not {low} and {high}")
    before, after = model.margins
    start = low // model.cell * model.cell
    stop = start - (start - high) // model.cell * model.cell
    if model.cells is not None:
        cells = np.zeros_like(every_cell(grey))
        cells[start // model.cell : stop // model.cell, start // model.cell : stop // model.cell] = True
        return model(grey, 1, cells=cells)[low:high, low:high]
    normal = normaliser(grey, model.normalisation)(grey)
    lack = max(0, before - start), max(0, stop + after - side)
    if any(lack):  # the mirror image of the normalised picture is the normalised mirror image
        normal = cv2.copyMakeBorder(normal, *lack, *lack, cv2.BORDER_REFLECT_101)
    span = slice(start - before + lack[0], stop + after + lack[0])
    out = model.session.run(None, {"image": np.ascontiguousarray(normal[span, span])[None, None]})[0]
    return np.asarray(out[0, 0, low - start : high - start, low - start : high - start])
