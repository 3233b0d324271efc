"""Response maps by ONNX Runtime, for pictures of any size, in tiles."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rcdn.corners.normalise import normaliser
from rcdn.errors import ConfigError, RcdnError
from rcdn.types import Array

TILE = 512
"""px of output a tile: memory stays bounded, and the tiles, not the threads, decide what is computed together"""
NAMES = {"auto": "rcdn_q", "paper": "rcdn_f"}


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """A network ready to run.

    `data`: the ONNX file; `normalisation`: see `normalise`; `margins`: px of context before and after a tile;
    `cell`: tiles start at multiples of it.
    """

    data: bytes
    normalisation: str
    margins: tuple[int, int]
    cell: int
    facts: dict[str, Any]

    @cached_property
    def session(self) -> Any:
        """The ONNX Runtime session: one thread each, since tiles run side by side and must not depend on the thread count."""
        import onnxruntime as ort

        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        return ort.InferenceSession(self.data, options, providers=["CPUExecutionProvider"])

    def __call__(self, grey: Array, threads: int = 0, tile: int = TILE) -> Array:
        """Response (H, W) float32, ≥ 0, of `grey` (H, W) uint8 or float32 in 0..255.

        The picture is continued by reflection at its border. `threads`: 0 = all cores; `tile`: px, a multiple of `cell`. The result
        depends on neither.
        """
        if tile < 1 or tile % self.cell:
            raise ConfigError(f"tile must be a positive multiple of {self.cell}, not {tile}")
        height, width = grey.shape
        normal = normaliser(grey, self.normalisation)
        padded = self._padded(grey, normal.reach)
        out = np.empty((height, width), np.float32)
        session, reach, context = self.session, normal.reach, sum(self.margins) + 2 * normal.reach

        def run(spot: tuple[int, int]) -> None:
            y, x = spot
            h, w = min(tile, height - y), min(tile, width - x)
            h_cells, w_cells = -(-h // self.cell) * self.cell, -(-w // self.cell) * self.cell
            part = normal(padded[y : y + h_cells + context, x : x + w_cells + context])
            part = part[reach : part.shape[0] - reach, reach : part.shape[1] - reach]
            result = session.run(None, {"image": np.ascontiguousarray(part)[None, None]})[0]
            out[y : y + h, x : x + w] = result[0, 0, :h, :w]

        spots = list(_spots(height, width, tile))
        count = min(threads or os.cpu_count() or 1, len(spots))
        if count > 1:
            with ThreadPoolExecutor(count) as pool:
                list(pool.map(run, spots))
        else:
            for spot in spots:
                run(spot)
        return out

    def _padded(self, grey: Array, reach: int) -> Array:
        """The picture with all the context that its border tiles need, by reflection."""
        before = self.margins[0] + reach
        extra = [self.margins[1] + reach + -n % self.cell for n in grey.shape]
        if min(grey.shape) > max(before, *extra):
            return np.asarray(cv2.copyMakeBorder(grey, before, extra[0], before, extra[1], cv2.BORDER_REFLECT_101))
        mode = "reflect" if min(grey.shape) > 1 else "edge"  # np.pad reflects again and again in a small picture
        return np.pad(grey, ((before, extra[0]), (before, extra[1])), mode=mode)  # type: ignore[call-overload]


def _spots(height: int, width: int, tile: int) -> Iterator[tuple[int, int]]:
    for y in range(0, height, tile):
        for x in range(0, width, tile):
            yield y, x


def load_model(name: str) -> ResponseModel:
    """Weights by name (`auto`, `paper`, or a file in rcdn/weights without its ending) or by the path of an .onnx file.

    Raises RcdnError if there are none, or if the file isn't the one its .json speaks of.
    """
    folder = files("rcdn") / "weights"
    target: Any = Path(name) if name.endswith(".onnx") else folder / (NAMES.get(name, name) + ".onnx")
    facts_at: Any = (
        target.with_suffix(".json") if isinstance(target, Path) else folder / (NAMES.get(name, name) + ".json")
    )
    try:
        data, facts = target.read_bytes(), json.loads(facts_at.read_text())
    except OSError as error:
        raise RcdnError(
            f"model: no weights {name!r}: {error}; give 'auto', 'paper' or an .onnx file with its .json beside it"
        ) from error
    if hashlib.sha256(data).hexdigest() != facts.get("sha256"):
        raise RcdnError(f"model: {target} is not the file that its .json describes (sha256 differs); export it again")
    before, after = facts["margins"]
    return ResponseModel(data, facts["normalisation"], (int(before), int(after)), int(facts["cell"]), facts)
