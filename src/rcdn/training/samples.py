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
from typing import Any

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


def _turned(image: Array, labels: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """The sample under a random one of the eight symmetries of the square, inverted with probability ½."""
    n = image.shape[0] - 1
    xy = labels[:, :2].copy()
    if rng.random() < 0.5:
        image, xy = image[:, ::-1], xy * [-1, 1] + [n, 0]
    if rng.random() < 0.5:
        image, xy = image[::-1], xy * [1, -1] + [0, n]
    if rng.random() < 0.5:
        image, xy = image.T, xy[:, ::-1]
    if rng.random() < 0.5:
        image = 255 - image
    return image, np.column_stack([xy, labels[:, 2]])


def draw(pool: Pool, index: int, side: int, kind: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """One sample: a random `side`² window of a crop under a random symmetry; normalised grey float32 and its labels."""
    labels = pool.labels[index]
    labels = labels[np.isfinite(labels[:, 0])]
    image, labels = _turned(pool.images[index], labels, rng)
    x, y = rng.integers(0, image.shape[0] - side + 1, 2)
    grey = normalise(np.ascontiguousarray(image), kind)[y : y + side, x : x + side]
    if kind == "minmax" and rng.random() < 0.7:  # a crop seldom spans its picture's whole range
        span = rng.uniform(0.65, 1.0)
        grey = grey * np.float32(span) + np.float32(rng.uniform(0, 1 - span))
    return grey, labels - [x, y, 0]


def targets(labels: list[Array], shape: tuple[int, int], ring: bool) -> Targets:
    """Label maps of a batch; `labels` in output pixels. `ring`: exclude the 8 neighbours of a corner from the loss."""
    h, w = shape
    positive = np.zeros((len(labels), h, w), bool)
    weight, heat = np.ones((len(labels), h, w), np.float32), np.zeros((len(labels), h, w), np.float32)
    gy, gx = np.mgrid[-4:5, -4:5].reshape(2, -1)
    for b, label in enumerate(labels):
        base = np.floor(label[:, :2] + 0.5).astype(int)
        px, py = base[:, :1] + gx, base[:, 1:] + gy  # (n, 81)
        d2 = (px - label[:, :1]) ** 2 + (py - label[:, 1:2]) ** 2
        ok = (px >= 0) & (px < w) & (py >= 0) & (py < h)
        sure = np.repeat(label[:, 2:] > 0, 81, axis=1)
        np.maximum.at(heat[b], (py[ok & sure], px[ok & sure]), np.exp(-d2[ok & sure] / 2).astype(np.float32))
        blind = ok & ~sure & (d2 < 16)
        weight[b][py[blind], px[blind]] = 0
        if ring:
            near = ok & sure & (np.maximum(np.abs(gx), np.abs(gy)) == 1)
            weight[b][py[near], px[near]] = 0
        own = ok & sure & ((gx == 0) & (gy == 0))
        positive[b][py[own], px[own]] = True
        weight[b][py[own], px[own]] = 1
    return Targets(torch.from_numpy(positive), torch.from_numpy(weight), torch.from_numpy(heat))


def batch(
    pool: Pool, arch: Architecture, side: int, size: int, kind: str, ring: bool, seed: tuple[int, ...]
) -> tuple[Tensor, Targets]:
    """Batch of `size` windows of `side` px.

    It depends on its arguments only, so that a resumed run gets the same batches as an uninterrupted one.
    """
    rng = np.random.default_rng(seed)
    chosen = [draw(pool, int(i), side, kind, rng) for i in rng.integers(0, len(pool), size)]
    before, after = arch.margins
    out = side - before - after
    image = torch.from_numpy(np.stack([g for g, _ in chosen]))[:, None]
    return image, targets([label - [before, before, 0] for _, label in chosen], (out, out), ring)


class Batches(torch.utils.data.IterableDataset):
    """Batches `start`, `start` + 1, … for a data loader; worker k of n yields every n-th batch, from the k-th on."""

    def __init__(self, make: Callable[[int], tuple[Tensor, Targets]], start: int, stop: int) -> None:
        self.make, self.start, self.stop = make, start, stop

    def __iter__(self) -> Iterator[tuple[Tensor, Targets]]:
        worker = torch.utils.data.get_worker_info()
        k, n = (worker.id, worker.num_workers) if worker else (0, 1)
        for step in range(self.start + k, self.stop, n):
            yield self.make(step)
