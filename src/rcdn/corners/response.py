"""Response maps of pictures of any size: cell networks run in a compiled kernel; all other networks, and all networks
on a GPU, run in ONNX Runtime, in tiles."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from rcdn.corners.cells import CellNetwork
from rcdn.corners.model_facts import read_facts
from rcdn.corners.normalise import normaliser
from rcdn.corners.onnx_written import to_onnx
from rcdn.corners.quantised import read_npz
from rcdn.corners.sieve import cells_with_saddles, every_cell
from rcdn.corners.threads import Threads, cores
from rcdn.errors import ConfigError, DependencyError, RcdnError, shown
from rcdn.types import Array
from rcdn.types.arrays import Real

TILE = 512
"""side of a tile's output, px: it bounds the memory, and the tiles, not the number of threads, determine what is
computed together"""
PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
HIGHEST = 1e6
"""largest valid magnitude of a response; those of a trained network are about 1"""
BATCH = 16
"""tiles that a GPU computes together"""
NAMES = {"auto": "rcdn_q", "paper": "rcdn_f"}


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """A network ready to run.

    `data`: the ONNX file, or None: written from `quantised` if it is needed; `normalisation`: see `normalise`;
    `margins`: px of context before and after a tile; `cell`: tiles start at multiples of it, px; `facts`: the metadata
    of its .json; `device`: `cpu` or `cuda`; `quantised`: its stored 8-bit weights, if it has any; `pool`: the threads
    that it runs on; `name`: its name in error messages.
    """

    data: bytes | None
    normalisation: str
    margins: tuple[int, int]
    cell: int
    facts: dict[str, Any]
    device: str = "cpu"
    quantised: CellNetwork | None = None
    pool: Threads = field(default_factory=Threads, repr=False)
    name: str = "the network"

    def __getstate__(self) -> dict[str, Any]:
        """The state without the cached properties: ONNX Runtime's session can't be copied, and is created again when
        needed."""
        return {key: value for key, value in self.__dict__.items() if key not in ("session", "cells")}

    @property
    def onnx(self) -> bytes:
        """The ONNX file that ONNX Runtime runs. Raises RcdnError if there is none and the .json lacks the `ranges` to
        write it."""
        if self.data is not None:
            return self.data
        if self.quantised is None or self.facts.get("ranges") is None:
            raise self._bad("its .json holds no 'ranges', with which it runs in ONNX Runtime")
        return to_onnx(self.quantised, self.facts["ranges"])

    @cached_property
    def session(self) -> Any:
        """The ONNX Runtime session, with one thread per call: tiles run in parallel, and results must not depend on the
        thread count."""
        ort = _onnxruntime()
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        again = self.device != "cpu"  # falls back from a GPU that fails; on the CPU, ONNX Runtime would only print
        try:
            return ort.InferenceSession(self.onnx, options, providers=[PROVIDERS[self.device]], enable_fallback=again)
        except Exception as error:  # ONNX Runtime raises a dozen undocumented types
            raise self._bad(f"ONNX Runtime can't load it ({_shortened(error)})") from error

    def _bad(self, message: str) -> RcdnError:
        return RcdnError(f"model: {self.name}: {message}; export it again with `rcdn export`")

    @cached_property
    def cells(self) -> CellNetwork | None:
        """The network for the compiled kernel; None if the kernel doesn't support the network or the device."""
        if self.quantised is None or self.device != "cpu" or self.normalisation != "local":
            return None
        return replace(self.quantised, pool=self.pool)

    def cells_of(self, grey: Array) -> Array | None:
        """The cells that may contain an X-corner (`sieve.cells_with_saddles`); None for a network that is always
        computed everywhere."""
        return None if self.cells is None else cells_with_saddles(grey)

    def __call__(self, grey: Array, threads: int = 0, tile: int = TILE, cells: Array | None = None) -> Array:
        """Response (H, W) float32, ≥ 0, of `grey` (H, W) uint8 or float32 in 0..255.

        The picture is extended by reflection at its border. `threads`: 0 = all cores; `tile`: px, a multiple of `cell`.
        The result depends on neither. `cells`: as from `cells_of`, the cells outside of which the response is 0; None:
        all cells.
        """
        if self.cells is not None:
            return self.cells(grey, every_cell(grey) if cells is None else cells, threads)
        return self.by_onnx_runtime(grey, threads, tile)

    def by_onnx_runtime(self, grey: Array, threads: int = 0, tile: int = TILE) -> Array:
        """As a call, but in floating point, without the compiled kernel. On a GPU, tiles of the same shape form
        batches."""
        if tile < 1 or tile % self.cell:
            raise ConfigError(f"tile must be a positive multiple of {self.cell}, not {tile}")
        height, width = grey.shape
        normal = normaliser(grey, self.normalisation)
        padded = self._padded(grey, normal.reach)
        out = np.empty((height, width), np.float32)
        session, reach, context = self.session, normal.reach, sum(self.margins) + 2 * normal.reach

        def part(spot: tuple[int, int]) -> Array:
            y, x = spot
            h_cells, w_cells = (
                -(-min(tile, n - at) // self.cell) * self.cell for n, at in zip(grey.shape, spot, strict=True)
            )
            seen = normal(padded[y : y + h_cells + context, x : x + w_cells + context])
            return np.ascontiguousarray(seen[reach : seen.shape[0] - reach, reach : seen.shape[1] - reach])

        def run(spots: list[tuple[int, int]]) -> None:
            result = self._answer(session, np.stack([part(spot) for spot in spots])[:, None])
            for (y, x), found in zip(spots, result[:, 0], strict=True):
                h, w = min(tile, height - y), min(tile, width - x)
                out[y : y + h, x : x + w] = found[:h, :w]

        alone = session.get_inputs()[0].shape[0] == 1  # a file exported with a fixed batch size of 1
        together = _batches(height, width, tile, 1 if self.device == "cpu" or alone else BATCH)
        count = min(threads or cores(), len(together)) if self.device == "cpu" else 1
        self.pool(run, together, count)
        return out

    def _answer(self, session: Any, tiles: Array) -> Real[Array, "n 1 h w"]:
        """The network's responses (N, 1, H, W) to `tiles` (N, 1, H + context, W + context)."""
        wanted = (len(tiles), 1, *(n - sum(self.margins) for n in tiles.shape[2:]))
        try:
            result = session.run(None, {"image": tiles})[0]
        except Exception as error:  # as in `session`
            raise self._bad(f"ONNX Runtime can't run it ({_shortened(error)})") from error
        if not isinstance(result, np.ndarray) or result.dtype != np.float32 or result.shape != wanted:
            got = f"{result.dtype} {result.shape}" if isinstance(result, np.ndarray) else type(result).__name__
            raise self._bad(
                f"its response must be float32 {wanted}, not {got}: do 'margins' and 'cell' fit the network?"
            )
        if not (float(result.min()) >= -HIGHEST and float(result.max()) <= HIGHEST):
            raise self._bad("its responses are not finite: are its weights?")
        return result

    def _padded(self, grey: Array, reach: int) -> Array:
        """The picture, padded by reflection with all the context that its border tiles need."""
        before = self.margins[0] + reach
        extra = [self.margins[1] + reach + -n % self.cell for n in grey.shape]
        if min(grey.shape) > max(before, *extra):
            return np.asarray(cv2.copyMakeBorder(grey, before, extra[0], before, extra[1], cv2.BORDER_REFLECT_101))
        mode = "reflect" if min(grey.shape) > 1 else "edge"  # np.pad reflects a small picture as often as needed
        return np.pad(grey, ((before, extra[0]), (before, extra[1])), mode=mode)  # type: ignore[call-overload]


def _batches(height: int, width: int, tile: int, most: int) -> list[list[tuple[int, int]]]:
    """The origins (y, x) of the tiles, in batches of at most `most` tiles of the same shape."""
    alike: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for y in range(0, height, tile):
        for x in range(0, width, tile):
            alike.setdefault((min(tile, height - y), min(tile, width - x)), []).append((y, x))
    return [spots[k : k + most] for spots in alike.values() for k in range(0, len(spots), most)]


def _onnxruntime() -> Any:
    """ONNX Runtime with its telemetry disabled: when imported, it would write an identifier of the machine below the
    user's cache folder and queue usage data for its publisher. A program that has imported it already keeps its own
    settings."""
    first = "onnxruntime" not in sys.modules
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read only at import, by releases that send telemetry
    try:
        import onnxruntime
    except ImportError as error:
        raise _missing("this network", f"can't be loaded ({_shortened(error)})") from error

    if first:
        onnxruntime.disable_telemetry_events()  # on Windows
    return onnxruntime


def _missing(what: str, why: str = "isn't installed") -> DependencyError:
    return DependencyError(f"{what} runs in ONNX Runtime, which {why}; run: pip install 'rcdn[onnx]'")


def _has_onnxruntime() -> bool:
    """Whether ONNX Runtime is installed, without importing it."""
    return importlib.util.find_spec("onnxruntime") is not None


def _shortened(error: Exception) -> str:
    """The message of ONNX Runtime's error, shortened."""
    return " ".join(str(error).split())[:200]


def device_of(wanted: str) -> str:
    """`cpu` or `cuda`, as `wanted`; for `auto`, `cuda` if ONNX Runtime is installed and supports it.

    Raises ConfigError if ONNX Runtime doesn't support the device, DependencyError if it is needed and isn't installed.
    """
    if wanted == "cpu" or (wanted == "auto" and not _has_onnxruntime()):
        return "cpu"
    if not _has_onnxruntime():
        raise DependencyError("device cuda needs ONNX Runtime for graphics cards; run: pip install onnxruntime-gpu")
    has = _onnxruntime().get_available_providers()
    if PROVIDERS["cuda"] in has:
        return "cuda"
    if wanted == "auto":
        return "cpu"
    raise ConfigError(
        f"device cuda: this ONNX Runtime has no CUDA, only {', '.join(has)}; "
        "pip uninstall onnxruntime, then pip install onnxruntime-gpu, or use device auto"
    )


def _weights(name: str, ending: str) -> Any:
    """The path of the file with this `ending` of the weights `name`, as in `load_model`."""
    if name.endswith(".onnx"):
        return Path(name).with_suffix(ending)
    return files("rcdn") / "weights" / (NAMES.get(name, name) + ending)


def _stored(name: str, facts: object) -> CellNetwork:
    """The stored 8-bit weights of a network; `facts`: the entry of its .json about them."""
    path = _weights(name, ".npz")
    try:
        return read_npz(path.read_bytes(), facts.get("sha256") if isinstance(facts, dict) else None, f"model: {path}")
    except OSError as error:
        raise RcdnError(
            f"model: no 8-bit weights beside {name!r}, of which its .json speaks: {error}; export it again: rcdn export"
        ) from error


def load_model(name: str, device: str = "cpu", stored: bool = True) -> ResponseModel:
    """Weights by name (`auto`, `paper`, or a file in rcdn/weights without its ending) or by the path of an .onnx file.

    A network whose .json has an entry for 8-bit weights runs, on every device, with those of the .npz file beside it,
    and needs no .onnx file. Any other network, and every network if `stored` is False, runs in ONNX Runtime from its
    .onnx file. `device`: `cpu`, `cuda`, or `auto`, a GPU if ONNX Runtime supports one. Raises RcdnError if there are no
    such weights, or if a file doesn't match the checksum in its .json; ConfigError for a device that isn't available;
    DependencyError if ONNX Runtime is needed and isn't installed.
    """
    target, facts_at = _weights(name, ".onnx"), _weights(name, ".json")
    try:
        text = facts_at.read_text(encoding="utf-8-sig", errors="replace")
        facts = read_facts(text, f"model: {facts_at}")
        whole = stored and "quantised" in facts
        data = None if whole else target.read_bytes()
    except (OSError, ValueError) as error:
        raise RcdnError(
            f"model: no weights {shown(name)}: {error}; give 'auto', 'paper' or an .onnx file with its .json beside it"
        ) from error
    if data is not None and hashlib.sha256(data).hexdigest() != facts.get("sha256"):
        raise RcdnError(f"model: {target} is not the file that its .json describes (sha256 differs); export it again")
    before, after = facts["margins"]
    model = ResponseModel(
        data,
        facts["normalisation"],
        (before, after),
        facts["cell"],
        facts,
        device_of(device),
        _stored(name, facts["quantised"]) if whole else None,
        name=str(target),
    )
    if model.cells is None and not _has_onnxruntime():
        raise _missing(f"the network {shown(name)}")
    return model
