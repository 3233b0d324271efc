"""Training data: a pool of rendered crops, stored on disk, and random batches drawn from it."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import json
import multiprocessing
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor

from rcdn.children import end_with_parent
from rcdn.corners.normalise import normalise
from rcdn.errors import ConfigError, shown
from rcdn.io import write_bytes, write_text
from rcdn.synthetic import PRESETS, random_crop
from rcdn.training.loss import Targets
from rcdn.training.net import Architecture
from rcdn.types import Array

CHUNK = 1000
MOST_LABELS = 512
LIMITS = {"count": (1, 10**8), "size": (1, 10_000), "seed": (0, 10**9)}


@dataclasses.dataclass(frozen=True)
class PoolConfig:
    """`count` crops of `size` px with the ranges called `ranges`.

    `backgrounds`: a folder of photographs without boards, or '' for synthetic clutter only.
    """

    count: int = 40_000
    size: int = 112
    ranges: str = "training"
    seed: int = 1
    backgrounds: str = ""

    def __post_init__(self) -> None:
        if self.ranges not in PRESETS:
            raise ConfigError(f"config: pool.ranges must be one of {sorted(PRESETS)}, not {shown(self.ranges)}")
        for key, (least, most) in LIMITS.items():
            if not least <= getattr(self, key) <= most:
                raise ConfigError(f"config: pool.{key} must be in [{least}, {most}], not {shown(getattr(self, key))}")


class Pool:
    """Crops: `images` (N, S, S) uint8, `labels` (N, 512, 3) float32 as in `random_crop`, NaN-padded. `labelled`: facts
    about the labelled pictures among their sources, if any."""

    def __init__(self, images: Array, labels: Array, labelled: dict[str, Any] | None = None) -> None:
        self.images, self.labels, self.labelled = images, labels, labelled

    def __len__(self) -> int:
        return len(self.images)


def joined(one: Pool, other: Pool, labelled: dict[str, Any] | None) -> Pool:
    """The crops of both; `labelled` as in `Pool`."""
    images, labels = (np.concatenate([getattr(one, k), getattr(other, k)]) for k in ("images", "labels"))
    return Pool(images, labels, labelled)


def load_backgrounds(folder: str) -> list[Array]:
    """Grey pictures of a folder, at most 1000 px wide, sorted by name."""
    out = []
    for path in sorted(Path(folder).glob("*")) if folder else []:
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            continue
        scale = min(1.0, 1000 / max(image.shape))
        out.append(cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    if folder and not out:
        raise ConfigError(
            f"backgrounds: no pictures in {folder!r}, seen from {os.getcwd()}; "
            "pass --backgrounds DIR, or --backgrounds none for drawn clutter only"
        )
    return out


_backgrounds: list[Array] = []


def _start_worker(folder: str) -> None:
    end_with_parent()
    cv2.setNumThreads(1)
    _backgrounds[:] = load_backgrounds(folder)


def _render_chunk(config: PoolConfig, numbers: range, path: Path) -> Path:
    images = np.zeros((len(numbers), config.size, config.size), np.uint8)
    labels = np.full((len(numbers), MOST_LABELS, 3), np.nan, np.float32)
    for k, number in enumerate(numbers):
        seed = config.seed * 100_000_000 + number
        image, label = random_crop(seed, config.size, PRESETS[config.ranges], _backgrounds)
        images[k] = image
        labels[k, : len(label)] = label[:MOST_LABELS]
    data = io.BytesIO()
    np.savez(data, images=images, labels=labels)
    write_bytes(path, data.getvalue())  # atomically: two trainings may render one pool, and either may be killed
    return path


def pool_folder(config: PoolConfig, root: Path) -> Path:
    """The folder of the pool with these settings."""
    key = hashlib.sha256(json.dumps(dataclasses.asdict(config), sort_keys=True).encode()).hexdigest()[:12]
    return root / f"pool-{key}"


def make_pool(
    config: PoolConfig, root: Path, workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> Pool:
    """Render the missing chunks of the pool (a killed run continues where it stopped) and load it.

    `workers`: processes, None = one per core; the pool doesn't depend on it. `progress` is called with (chunks done,
    all chunks). Raises ConfigError if chunks must be rendered and the folder of backgrounds contains no picture.
    """
    folder = pool_folder(config, root)
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "pool.json", json.dumps(dataclasses.asdict(config), indent=1))
    starts = range(0, config.count, CHUNK)
    chunks = {folder / f"{s:08d}.npz": range(s, min(s + CHUNK, config.count)) for s in starts}
    todo = [(numbers, path) for path, numbers in chunks.items() if not path.exists()]
    for done, _ in enumerate(_render(config, todo, workers), start=len(chunks) - len(todo) + 1):
        if progress:
            progress(done, len(chunks))
    images = np.empty((config.count, config.size, config.size), np.uint8)
    labels = np.empty((config.count, MOST_LABELS, 3), np.float32)
    for path, numbers in chunks.items():  # one by one, so that the pool is in memory only once
        with np.load(path) as part:
            images[numbers.start : numbers.stop] = part["images"]
            labels[numbers.start : numbers.stop] = part["labels"]
    return Pool(images, labels)


def _render(config: PoolConfig, todo: list[tuple[range, Path]], workers: int | None) -> Iterator[Path]:
    """Yields the path of each chunk of `todo` once it is on the disk. A single chunk is rendered in this process."""
    if not todo:
        return
    backgrounds = load_backgrounds(config.backgrounds)  # reports a wrong folder here, not in a worker
    if len(todo) == 1 or workers == 1:
        _backgrounds[:] = backgrounds
        yield from (_render_chunk(config, numbers, path) for numbers, path in todo)
        _backgrounds.clear()
        return
    spawn = multiprocessing.get_context("spawn")  # a forked worker would lack the parent's threads and hang
    with ProcessPoolExecutor(workers, spawn, initializer=_start_worker, initargs=(config.backgrounds,)) as executor:
        yield from executor.map(_render_chunk, repeat(config), *zip(*todo, strict=True))


class Windows(NamedTuple):
    """What is random about a batch of n windows. `crop` (n,): numbers of the crops; `turn` (n, 4) bool: mirrored left
    to right, upside down, transposed, inverted, in this order; `corner` (n, 2): x, y of the window in the turned crop,
    px; `span`, `base` (n,) float32: the grey level g becomes span · g + base."""

    crop: Array
    turn: Array
    corner: Array
    span: Array
    base: Array


def windows(crops: int, room: int, size: int, kind: str, seed: tuple[int, ...], often: Array | None = None) -> Windows:
    """Windows of a batch of `size`, from `crops` crops, each of which has `room` px more than a window; they depend on
    the arguments only. `often` (crops,): the cumulative sum of the crops' probabilities, by which every second window
    is drawn; the others are drawn evenly."""
    rng = np.random.default_rng(seed)
    crop, turn, corner = rng.integers(0, crops, size), rng.random((size, 4)) < 0.5, rng.integers(0, room + 1, (size, 2))
    span, base = np.ones(size, np.float32), np.zeros(size, np.float32)
    if kind == "minmax":
        some = rng.random(size) < 0.7  # a crop seldom spans its picture's whole range
        span[some] = rng.uniform(0.65, 1.0, size)[some]
        base = (rng.random(size) * (1 - span)).astype(np.float32)
    if often is not None:
        crop[::2] = np.searchsorted(often, rng.random(len(crop[::2])) * often[-1], side="right").clip(max=crops - 1)
    return Windows(crop, turn, corner, span, base)


def whole(crops: Array) -> Windows:
    """These crops as they are, not turned and not cut."""
    n = len(crops)
    still = np.zeros((n, 4), bool), np.zeros((n, 2), np.int64), np.ones(n, np.float32), np.zeros(n, np.float32)
    return Windows(crops, *still)


def _turned(image: Array, labels: Array, turn: Array) -> tuple[Array, Array]:
    """The sample under one of the eight symmetries of the square, and inverted, as `Windows.turn` says."""
    n = image.shape[0] - 1
    xy = labels[:, :2].copy()
    mirrored, upside_down, transposed, inverted = turn
    if mirrored:
        image, xy = image[:, ::-1], xy * [-1, 1] + [n, 0]
    if upside_down:
        image, xy = image[::-1], xy * [1, -1] + [0, n]
    if transposed:
        image, xy = image.T, xy[:, ::-1]
    if inverted:
        image = 255 - image
    return image, np.column_stack([xy, labels[:, 2]])


def draw(pool: Pool, chosen: Windows, k: int, side: int, kind: str) -> tuple[Array, Array]:
    """Window `k` of `chosen`, `side`² px: normalised grey float32 and its labels."""
    index = int(chosen.crop[k])
    labels = pool.labels[index]
    labels = labels[np.isfinite(labels[:, 0])]
    image, labels = _turned(pool.images[index], labels, chosen.turn[k])
    x, y = chosen.corner[k]
    grey = normalise(np.ascontiguousarray(image), kind)[y : y + side, x : x + side]
    return grey * chosen.span[k] + chosen.base[k], labels - [x, y, 0]


def targets(labels: list[Array], shape: tuple[int, int], ring: bool) -> Targets:
    """Label maps of a batch; `labels` in output pixels. `ring`: exclude the 8 neighbours of a corner from the loss."""
    owner = np.repeat(np.arange(len(labels)), [len(label) for label in labels])
    every = np.concatenate(labels) if labels else np.zeros((0, 3))
    return painted(torch.from_numpy(owner), torch.from_numpy(every.astype(float)), (len(labels), *shape), ring)


def painted(owner: Tensor, labels: Tensor, shape: tuple[int, int, int], ring: bool) -> Targets:
    """As `targets`, of `labels` (n, 3) that lie on the maps `owner` (n,); computed where these tensors are."""
    count, h, w = shape
    device = labels.device
    positive = torch.zeros(count * h * w, dtype=torch.bool, device=device)
    weight, heat = torch.ones(count * h * w, device=device), torch.zeros(count * h * w, device=device)
    near = torch.arange(-4, 5, device=device)
    gy, gx = (g.reshape(-1) for g in torch.meshgrid(near, near, indexing="ij"))
    base = torch.floor(labels[:, :2] + 0.5).long()
    px, py = base[:, :1] + gx, base[:, 1:] + gy  # (n, 81)
    d2 = (px - labels[:, :1]) ** 2 + (py - labels[:, 1:2]) ** 2
    ok = (px >= 0) & (px < w) & (py >= 0) & (py < h)
    sure = (labels[:, 2:] > 0).expand(-1, 81)
    flat = owner[:, None] * (h * w) + py * w + px
    heat.scatter_reduce_(0, flat[ok & sure], torch.exp(-d2[ok & sure] / 2).float(), "amax")
    weight[flat[ok & ~sure & (d2 < 16)]] = 0
    if ring:
        weight[flat[ok & sure & (torch.maximum(gx.abs(), gy.abs()) == 1)]] = 0
    own = flat[ok & sure & ((gx == 0) & (gy == 0))]
    positive[own] = True
    weight[own] = 1
    return Targets(positive.view(shape), weight.view(shape), heat.view(shape))


def cut(pool: Pool, chosen: Windows, arch: Architecture, side: int, kind: str, ring: bool) -> tuple[Tensor, Targets]:
    """The windows `chosen`, of `side` px: pictures (n, 1, side, side), and maps without the network's margins."""
    drawn = [draw(pool, chosen, k, side, kind) for k in range(len(chosen.crop))]
    before, after = arch.margins
    out = side - before - after
    image = torch.from_numpy(np.stack([g for g, _ in drawn]))[:, None]
    return image, targets([label - [before, before, 0] for _, label in drawn], (out, out), ring)


class Batches(torch.utils.data.IterableDataset):
    """Batches `start`, `start` + 1, … for a data loader; worker k of n yields every n-th batch, from the k-th on."""

    def __init__(self, make: Callable[[int], tuple[Tensor, Targets]], start: int, stop: int) -> None:
        self.make, self.start, self.stop = make, start, stop

    def __iter__(self) -> Iterator[tuple[Tensor, Targets]]:
        worker = torch.utils.data.get_worker_info()
        k, n = (worker.id, worker.num_workers) if worker else (0, 1)
        for step in range(self.start + k, self.stop, n):
            yield self.make(step)
