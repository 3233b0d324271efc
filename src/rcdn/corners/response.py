"""Response maps of pictures of any size: cell networks by a compiled kernel, all others, and all on a GPU, by ONNX Runtime, in tiles."""

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
from rcdn.corners.threads import Threads
from rcdn.errors import ConfigError, DependencyError, RcdnError, shown
from rcdn.types import Array
from rcdn.types.arrays import Real

TILE = 512
"""px of output a tile: memory stays bounded, and the tiles, not the threads, decide what is computed together"""
PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}
HIGHEST = 1e6
"""of a response; a network's are about 1"""
BATCH = 16
"""tiles that a GPU computes together"""
NAMES = {"auto": "rcdn_q", "paper": "rcdn_f"}


@dataclass(frozen=True, eq=False)
class ResponseModel:
    """A network ready to run.

    `data`: the ONNX file, None: made of `quantised` if it's needed; `normalisation`: see `normalise`; `margins`: px of context
    before and after a tile; `cell`: tiles start at multiples of it; `device`: `cpu` or `cuda`; `quantised`: its stored 8-bit weights,
    if it has any; `pool`: the threads that it runs on; `name`: what errors call it.
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
        """Without what is made at its first use: ONNX Runtime's session can't be copied, and is made again."""
        return {key: value for key, value in self.__dict__.items() if key not in ("session", "cells")}

    @property
    def onnx(self) -> bytes:
        """The ONNX file that ONNX Runtime runs. Raises RcdnError if there is none, and the .json lacks what it would be made with."""
        if self.data is not None:
            return self.data
        if self.quantised is None or self.facts.get("ranges") is None:
            raise self._bad("its .json holds no 'ranges', with which it runs in ONNX Runtime")
        return to_onnx(self.quantised, self.facts["ranges"])

    @cached_property
    def session(self) -> Any:
        """The ONNX Runtime session: one thread each, since tiles run side by side and must not depend on the thread count."""
        ort = _onnxruntime()
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        again = self.device != "cpu"  # on the CPU after a GPU that fails; after the CPU ONNX Runtime only prints
        try:
            return ort.InferenceSession(self.onnx, options, providers=[PROVIDERS[self.device]], enable_fallback=again)
        except Exception as error:  # of a dozen kinds that ONNX Runtime names nowhere
            raise self._bad(f"ONNX Runtime can't load it ({_shortened(error)})") from error

    def _bad(self, message: str) -> RcdnError:
        return RcdnError(f"model: {self.name}: {message}; export it again with `rcdn export`")

    @cached_property
    def cells(self) -> CellNetwork | None:
        """The network as the compiled kernel takes it, or None if that isn't for it or not for the device."""
        if self.quantised is None or self.device != "cpu" or self.normalisation != "local":
            return None
        return replace(self.quantised, pool=self.pool)

    def cells_of(self, grey: Array) -> Array | None:
        """The cells in which an X-corner can be (`sieve.cells_with_saddles`); None: this network is always computed everywhere."""
        return None if self.cells is None else cells_with_saddles(grey)

    def __call__(self, grey: Array, threads: int = 0, tile: int = TILE, cells: Array | None = None) -> Array:
        """Response (H, W) float32, ≥ 0, of `grey` (H, W) uint8 or float32 in 0..255.

        The picture is continued by reflection at its border. `threads`: 0 = all cores; `tile`: px, a multiple of `cell`. The result
        depends on neither. `cells`: as from `cells_of`; outside of them the response is 0. None: everywhere.
        """
        if self.cells is not None:
            return self.cells(grey, every_cell(grey) if cells is None else cells, threads)
        return self.by_onnx_runtime(grey, threads, tile)

    def by_onnx_runtime(self, grey: Array, threads: int = 0, tile: int = TILE) -> Array:
        """As a call, but without the compiled kernel: in floating point. On a GPU, tiles of one shape go together."""
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

        alone = session.get_inputs()[0].shape[0] == 1  # exported before tiles went together
        together = _batches(height, width, tile, 1 if self.device == "cpu" or alone else BATCH)
        count = min(threads or os.cpu_count() or 1, len(together)) if self.device == "cpu" else 1
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
        """The picture with all the context that its border tiles need, by reflection."""
        before = self.margins[0] + reach
        extra = [self.margins[1] + reach + -n % self.cell for n in grey.shape]
        if min(grey.shape) > max(before, *extra):
            return np.asarray(cv2.copyMakeBorder(grey, before, extra[0], before, extra[1], cv2.BORDER_REFLECT_101))
        mode = "reflect" if min(grey.shape) > 1 else "edge"  # np.pad reflects again and again in a small picture
        return np.pad(grey, ((before, extra[0]), (before, extra[1])), mode=mode)  # type: ignore[call-overload]


def _batches(height: int, width: int, tile: int, most: int) -> list[list[tuple[int, int]]]:
    """Where tiles begin (y, x), at most so many of one shape together."""
    alike: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for y in range(0, height, tile):
        for x in range(0, width, tile):
            alike.setdefault((min(tile, height - y), min(tile, width - x)), []).append((y, x))
    return [spots[k : k + most] for spots in alike.values() for k in range(0, len(spots), most)]


def _onnxruntime() -> Any:
    """ONNX Runtime, kept to itself: on being imported it would write an identifier of this machine below the user's cache folder, and queue what
    it observes for its makers. A program that has imported it already keeps its own settings."""
    first = "onnxruntime" not in sys.modules
    os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # read on being imported only, by releases that send telemetry
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
    """Whether ONNX Runtime is installed; it isn't imported for that."""
    return importlib.util.find_spec("onnxruntime") is not None


def _shortened(error: Exception) -> str:
    """What ONNX Runtime says, shortened."""
    return " ".join(str(error).split())[:200]


def device_of(wanted: str) -> str:
    """`cpu` or `cuda`, as `wanted`, or for `auto` as ONNX Runtime can, without which it's the CPU. Raises ConfigError if it can't do what is
    wanted, DependencyError if it isn't installed."""
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
    """A file of the weights `name`, as in `load_model`."""
    if name.endswith(".onnx"):
        return Path(name).with_suffix(ending)
    return files("rcdn") / "weights" / (NAMES.get(name, name) + ending)


def _stored(name: str, facts: object) -> CellNetwork:
    """The 8-bit weights of a network whose .json says `facts` of them."""
    path = _weights(name, ".npz")
    try:
        return read_npz(path.read_bytes(), facts.get("sha256") if isinstance(facts, dict) else None, f"model: {path}")
    except OSError as error:
        raise RcdnError(
            f"model: no 8-bit weights beside {name!r}, of which its .json speaks: {error}; export it again: rcdn export"
        ) from error


def load_model(name: str, device: str = "cpu", stored: bool = True) -> ResponseModel:
    """Weights by name (`auto`, `paper`, or a file in rcdn/weights without its ending) or by the path of an .onnx file.

    A network whose .json speaks of 8-bit weights runs with those of the .npz file beside it, on every device: it needs no .onnx file. Any
    other, and all with `stored` False, run in ONNX Runtime as their .onnx file says. `device`: `cpu`, `cuda`, or `auto`: a GPU if ONNX
    Runtime has one. Raises RcdnError if there are none, or if a file isn't the one its .json speaks of; ConfigError for a device that
    isn't there; DependencyError if ONNX Runtime is needed and isn't installed.
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
