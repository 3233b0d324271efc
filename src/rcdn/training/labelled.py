"""Crops of labelled pictures of one's own, beside the rendered ones (docs/training.md,
"Your own labelled pictures")."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, FormatError, shown
from rcdn.geometry.near import nearest
from rcdn.io import ImageResult, is_video, read_detections
from rcdn.io.fields import numbers, read_json, read_text, take
from rcdn.io.images import read_named_image
from rcdn.pyramid import View, whole_views
from rcdn.synthetic.crops import BEYOND, NEAR, OFTEN
from rcdn.synthetic.render import LEAST_PITCH
from rcdn.training.samples import MOST_LABELS, Pool
from rcdn.types import Array, Status
from rcdn.types.arrays import Real, Shaped
from rcdn.types.plane import Pattern
from rcdn.types.ranges import POSITION

PITCH = (6.0, 60.0)
"""px; the distances of neighbouring corners that networks are trained for: pictures are enlarged or reduced to them"""
RIM = 2.0
"""px; nor are corners nearer to the frame"""
SAME = 1.0
"""px; a single corner this near to one of a board is that corner"""


@dataclass(frozen=True)
class LabelledPicture:
    """A picture (H, W) uint8 and its corners `labels` (N, 3): x, y, px, and a class: 1 for a corner, 0 for a position
    that is neither demanded nor forbidden; of boards of `pattern`."""

    path: Path
    image: Array
    labels: Array
    pattern: Pattern = "checker"


def read_labelled(source: str | Path, pattern: Pattern = "checker") -> list[LabelledPicture]:
    """The labelled pictures that a file names, in its order.

    `source`: detections as `rcdn detect --json` writes them, or a `truth.json` as `rcdn render` writes it, or a folder
    that holds one (docs/formats.md). Of detections the corners of boards of `pattern` ("checker" or "deltille") are
    demanded; single corners, and those whose position wasn't refined, are neither demanded nor forbidden; pictures
    without a board are left out. Paths of detections start at the current folder or at the file's own.

    Raises FormatError if the file has another structure, or labels of another size than its picture; ImageError if a
    picture can't be read; ConfigError if there is no labelled corner at all.
    """
    path = Path(source)
    if path.is_dir():
        path = path / "truth.json"
        if not path.is_file():
            raise ConfigError(f"labelled: no truth.json in {shown(str(source))}; name the file with the labels")
    data = read_json(path, read_text(path), "name the file that `rcdn detect --json` or `rcdn render` wrote")
    detections = isinstance(data, dict) and "images" in data
    found = list(_of_detections(path, pattern) if detections else _of_truth(path, data, pattern))
    if not any((picture.labels[:, 2] > 0).any() for picture in found):
        raise ConfigError(f"labelled: {path} has no corner of a {pattern} board; label some, or train without it")
    return found


def _of_detections(path: Path, pattern: Pattern) -> Iterator[LabelledPicture]:
    for image in read_detections(path)[0]:
        if not any(board.pattern == pattern for board in image.boards):
            continue
        file = _file(image.path, [Path(image.path), path.parent / image.path], path)
        picture = _picture(file)
        if picture.shape != (image.height, image.width):
            size = f"{picture.shape[1]}×{picture.shape[0]}"
            raise FormatError(
                f"{path}: {file} has {size} px, not {image.width}×{image.height}; label the picture itself"
            )
        yield LabelledPicture(file, picture, _labels(image, pattern), pattern)


def _labels(image: ImageResult, pattern: str) -> Real[Array, "n 3"]:
    """Labels of one picture's detections."""
    parts, every = [np.zeros((0, 3))], [np.zeros((0, 2))]
    for board in image.boards:
        every.append(board.xy)
        if board.pattern == pattern:
            parts.append(np.column_stack([board.xy, board.status != Status.SEED]))
    single = image.corners.xy
    single = single[nearest(np.concatenate(every), single)[0][:, 0] > SAME] if len(single) else np.zeros((0, 2))
    return np.concatenate([*parts, np.column_stack([single, np.zeros(len(single))])])


def _of_truth(path: Path, data: Any, pattern: Pattern) -> Iterator[LabelledPicture]:
    if not isinstance(data, dict):
        raise FormatError(f"{path}: neither detections of `rcdn detect --json` nor a truth.json of `rcdn render`")
    for name in data:
        record = take(data, name, dict, str(path))
        if record.get("exhaustive", True) is not True:
            raise FormatError(
                f"{path}: {name}: not `exhaustive`, and corners without a label would be learnt as none; label them all"
            )
        images = take(record, "images", dict, f"{path}: {name}")
        for file in images:
            where = f"{path}: {name}: {file}"
            known = take(images, file, dict, where)
            if known.get("xy", []) is None:  # not labelled
                continue
            found = _file(file, [path.parent / name / file, path.parent / file, Path(file)], path)
            picture = _picture(found)
            sure = _positions(known, "xy", where, picture.shape)
            open_ = _positions({"ignore": known.get("ignore") or []}, "ignore", where, picture.shape)
            classes = np.repeat([1.0, 0.0], [len(sure), len(open_)])
            labels = np.column_stack([np.concatenate([sure, open_]), classes])
            yield LabelledPicture(found, picture, labels, pattern)


def _positions(record: dict[str, Any], key: str, where: str, shape: tuple[int, ...]) -> Real[Array, "n 2"]:
    if record.get(key) == []:
        return np.zeros((0, 2))
    xy = numbers(record, key, where, shape=(-1, 2), finite=True, within=POSITION)
    outside = (xy < -0.5) | (xy > np.array(shape[::-1]) - 0.5)
    if key == "xy" and outside.any():
        wrong = xy[outside.any(axis=1)][0].tolist()
        size = f"{shape[1]}×{shape[0]}"
        raise FormatError(
            f"{where}: the corner {wrong} lies outside the picture of {size} px; label the picture itself"
        )
    return xy


def _file(name: str, places: list[Path], labels: Path) -> Path:
    """The first of `places` that is a file."""
    for place in places:
        if place.is_file():
            return place
    if is_video(name.partition("#")[0]):
        raise FormatError(f"{labels}: {name} is a frame of a video; save the frames as pictures, and detect in these")
    raise FormatError(f"{labels}: no picture {name}, seen from {os.getcwd()} and from {labels.parent}")


def _picture(path: Path) -> Shaped[Array, "h w"]:
    grey = read_named_image(path)
    return grey if grey.dtype == np.uint8 else np.rint(grey).astype(np.uint8)


def fingerprint(pictures: list[LabelledPicture]) -> dict[str, Any]:
    """What a network was trained on, for its provenance: numbers of pictures and corners, and the sha256 of all pixels
    and labels."""
    digest = hashlib.sha256()
    for picture in pictures:
        digest.update(str(picture.image.shape).encode() + picture.image.tobytes() + picture.labels.tobytes())
    corners = sum(int((picture.labels[:, 2] > 0).sum()) for picture in pictures)
    return {"pictures": len(pictures), "corners": corners, "sha256": digest.hexdigest()}


def scaled(picture: LabelledPicture, size: int) -> list[tuple[Array, Array]]:
    """The picture and its labels at each scale at which detection looks at it (`pyramid.whole_views`), a crop of `size`
    px has room, and its squares have the sizes of `PITCH`; at the nearest scale if there is none.

    Raises ConfigError if the picture has no room for a crop.
    """
    views = [v for v in whole_views(picture.image.shape) if min(v.of(picture.image).shape) >= size]
    if not views:
        h, w = picture.image.shape
        raise ConfigError(f"labelled: {picture.path} has {w}×{h} px, too few for crops of pool.size = {size} px")
    labels, spans = picture.labels, [1.0] * len(views)
    if len(labels) > 1:
        pitch = float(np.median(nearest(labels[:, :2], labels[:, :2], 2)[0][:, 1]))
        spans = [max(PITCH[0] / (pitch * v.scale), pitch * v.scale / PITCH[1], 1.0) for v in views]
    chosen = [v for v, span in zip(views, spans, strict=True) if span == min(spans)]
    return [(view.of(picture.image), _at_scale(labels, view, LEAST_PITCH[picture.pattern])) for view in chosen]


def _at_scale(labels: Real[Array, "n 3"], view: View, least: float) -> Real[Array, "n 3"]:
    """Labels of the picture in pixels of a view of it; those near the frame or nearer to each other than `least` px are
    neither demanded nor forbidden, as in rendered crops."""
    xy = view.from_picture(labels[:, :2])
    x1, y1 = (np.array(view.box[2:]) * view.ratio()).round()
    sure = ((xy >= RIM) & (xy <= [x1 - 1 - RIM, y1 - 1 - RIM])).all(axis=1)
    if len(xy) > 1:
        sure &= nearest(xy, xy, 2)[0][:, 1] >= least
    return np.column_stack([xy, labels[:, 2] * sure])


def labelled_pool(pictures: list[LabelledPicture], count: int, size: int, seed: int) -> Pool:
    """`count` crops of `size` px, of all pictures in turn; the same arguments give the same crops."""
    images = np.zeros((count, size, size), np.uint8)
    labels = np.full((count, MOST_LABELS, 3), np.nan, np.float32)
    for first, picture in enumerate(pictures):
        views = scaled(picture, size)
        for k in range(first, count, len(pictures)):
            rng = np.random.default_rng((seed, k))
            images[k], label = crop(*views[rng.integers(len(views))], size, rng)
            labels[k, : len(label)] = label[:MOST_LABELS]
    return Pool(images, labels)


def crop(image: Array, labels: Array, size: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """A random window (size, size) and its labels (N, 3), chosen as `random_crop` chooses its own."""
    room = np.array(image.shape[::-1]) - size
    corners = labels[labels[:, 2] > 0, :2]
    if len(corners) and rng.random() < OFTEN:
        middle = corners[rng.integers(len(corners))] + rng.uniform(-NEAR, NEAR, 2) * rng.random()
    else:
        middle = size / 2 + rng.uniform(0, 1, 2) * room
    x, y = np.clip(np.rint(middle - size / 2), 0, room).astype(int)
    return window(image, labels, (int(x), int(y)), size)


def window(image: Array, labels: Array, at: tuple[int, int], size: int) -> tuple[Array, Array]:
    """The window (size, size) whose first pixel is `at` (x, y), and the labels (N, 3) in and around it."""
    x, y = at
    xy = labels[:, :2] - [x, y]
    near = ((xy > -BEYOND) & (xy < size + BEYOND)).all(axis=1)
    return image[y : y + size, x : x + size], np.column_stack([xy, labels[:, 2]])[near]
