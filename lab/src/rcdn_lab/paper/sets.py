"""The pictures of section 4.1: the available photographs of its three data sets, and rendered substitutes."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from rcdn.errors import ConfigError, FormatError, present
from rcdn.io import as_grey, read_image
from rcdn.synthetic import Background, BoardSpec, Light, Scene, Sensor, render, truth
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Array, CameraModel
from rcdn_lab.sweep.pictures import placed

FIRST = 8_100_000_000
"""No training and no other suite uses this seed."""
SIZE = (9, 6)
BORDER = 9.0
"""least distance of corners of rendered boards from the frame, px, so that the border rule does not affect them"""
RIM = 2.0
"""least distance of their outermost squares from the frame, px"""
TRIES = 2000
Rng = np.random.Generator
Span = tuple[float, float]


@dataclass(frozen=True)
class Recipe:
    """Parameters of a rendered set; spans are ranges of uniform distributions.

    `focal`: in widths of the picture; `lens`: spans of the distortion coefficients; `pitch`: squares seen frontally,
    px; `least`: least distance between neighbours, px; `tilt`: degrees, at most; `noise`: σ, grey levels; `blur`: σ,
    px; `gain`: contrast after exposure; `light`: spread of the illumination gradient across the picture; `jpeg`:
    qualities, (0, 0): none; `clutter`: kinds of background.
    """

    size: tuple[int, int]
    model: CameraModel
    focal: Span
    lens: tuple[Span, ...]
    pitch: Span
    least: float
    tilt: float
    noise: Span
    blur: Span
    gain: Span
    light: float
    jpeg: tuple[int, int]
    clutter: tuple[str, ...]


@dataclass(frozen=True)
class PictureSet:
    """Pictures of one 9×6 board each.

    `column`: the data set of the paper to which they belong or which they replace; `total` pictures in all, of which
    `default` are used without `--full`; `folder` in the data folder, for photographs; `recipe`, for rendered ones.
    """

    name: str
    column: str
    total: int
    default: int
    folder: str = ""
    recipe: Recipe | None = None


SETS = {
    s.name: s
    for s in (
        PictureSet("mesa-like", "Mesa", 206, 206, recipe=Recipe(
            size=(176, 144), model="brown", focal=(1.3, 1.5), lens=((-0.25, -0.05), *[(0, 0)] * 4), pitch=(5.5, 9),
            least=5, tilt=40, noise=(8, 20), blur=(0.4, 0.8), gain=(0.6, 0.95), light=0.6, jpeg=(0, 0),
            clutter=("plain", "noise", "shapes"),
        )),
        PictureSet("ueye-like", "uEye", 206, 24, recipe=Recipe(
            size=(1280, 1024), model="brown", focal=(1.1, 1.6), lens=((-0.06, 0.02), *[(0, 0)] * 4), pitch=(33, 62),
            least=20, tilt=55, noise=(3, 8), blur=(0.5, 1.2), gain=(0.2, 0.5), light=0.5, jpeg=(0, 0),
            clutter=("shapes", "text", "tiles", "blocks"),
        )),
        PictureSet("ueye", "uEye", 5, 5, folder="rochade-ueye"),
        PictureSet("gopro-like", "GoPro", 100, 10, recipe=Recipe(
            size=(2000, 1500), model="fisheye", focal=(0.45, 0.5), lens=((-0.03, 0.03), (-0.01, 0.01), (0, 0), (0, 0)),
            pitch=(45, 110), least=25, tilt=60, noise=(1, 4), blur=(0.7, 1.3), gain=(0.6, 0.9), light=0.6,
            jpeg=(80, 95), clutter=("noise", "shapes", "text", "tiles", "blocks"),
        )),
        PictureSet("gopro", "GoPro", 30, 30, folder="rochade-gopro-a"),
    )
}  # fmt: skip
"""The paper has 206 pictures of Mesa, 206 of uEye and 100 of GoPro; 5 and 30 of the latter two are available as
photographs."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A picture and its true corners: `xy` (N, 2) px; `ignore` (M, 2) px: neither demanded nor forbidden.

    `identity`: checksum of everything from which the picture is made; `size`: (width, height).
    """

    set: str
    name: str
    source: Scene | Path
    xy: Array
    ignore: Array
    identity: str
    size: tuple[int, int]

    def image(self) -> Array:
        """(H, W) uint8 grey levels; rendered or read on each call. Raises ImageError for a file that is no picture."""
        return render(self.source) if isinstance(self.source, Scene) else as_grey(read_image(self.source))


def shots(wanted: PictureSet, data: Path | None = None, most: int | None = None) -> list[Shot]:
    """The pictures of a set, or `most` of them; always the same ones.

    Of photographs every n-th is taken, of rendered ones the first. `data`: the folder that contains the sets' folders
    and truth.json. Raises FormatError for an invalid truth.json.
    """
    count = min(wanted.total, most or wanted.total)
    if wanted.recipe is not None:
        return [_rendered(wanted, k) for k in range(count)]
    return _photographs(wanted, present(data, "the folder of photographs"), count)


def missing(wanted: PictureSet, data: Path | None) -> str | None:
    """The reason why a set is not available, or None."""
    if wanted.recipe is not None:
        return None
    if data is None:
        return "photographs: no data folder; name it by --data or RCDN_DATA"
    for path in (data / "truth.json", data / wanted.folder):
        if not path.exists():
            return f"photographs: {path} is absent; name the folder of the sets by --data or RCDN_DATA"
    return None


# ---- photographs


def _photographs(wanted: PictureSet, data: Path, count: int) -> list[Shot]:
    try:
        images = json.loads((data / "truth.json").read_text())[wanted.folder]["images"]
        known = {name: record for name, record in sorted(images.items()) if record["xy"]}
        names = list(known)[:: max(1, -(-len(known) // count))][:count]
        return [_photograph(wanted, data / wanted.folder / name, known[name]) for name in names]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise FormatError(f"{data / 'truth.json'}: no truth of {wanted.folder} can be read: {error!r}") from error


def _photograph(wanted: PictureSet, path: Path, record: dict[str, Any]) -> Shot:
    data = path.read_bytes()
    image = read_image(path)
    xy, ignore = (np.array(record.get(key) or [], float).reshape(-1, 2) for key in ("xy", "ignore"))
    size = (int(image.shape[1]), int(image.shape[0]))
    return Shot(wanted.name, path.name, path, xy, ignore, hashlib.sha256(data).hexdigest(), size)


# ---- rendered


def _rendered(wanted: PictureSet, index: int) -> Shot:
    made = scene(wanted, index)
    boards = truth(made)
    xy = np.concatenate([b.xy[b.visible] for b in boards])
    ignore = np.concatenate([b.xy[b.ignore] for b in boards])
    identity = hashlib.sha256(made.to_json().encode()).hexdigest()
    return Shot(wanted.name, f"{index:03d}", made, xy, ignore, identity, (made.width, made.height))


def scene(wanted: PictureSet, index: int) -> Scene:
    """Picture `index` of a rendered set: one board, wholly visible. The same arguments give the same scene."""
    recipe = present(wanted.recipe, "the recipe of a set")
    rng = np.random.default_rng([FIRST, list(SETS).index(wanted.name), index])
    made = _empty(rng, recipe)
    return replace(made, boards=(_board(rng, recipe, made),))


def _empty(rng: Rng, r: Recipe) -> Scene:
    """Frame, lens, illumination, sensor and background."""
    width, height = r.size
    lens = tuple(float(rng.uniform(*span)) for span in r.lens)
    cx, cy = (np.array(r.size) - 1) / 2 + rng.normal(0, 0.01, 2) * r.size
    gx, gy, wave = rng.normal(0, r.light / 2, 3) * [1, 1, 0.5]
    gain = float(rng.uniform(*r.gain))
    sensor = Sensor(
        blur=float(rng.uniform(*r.blur)), noise=float(rng.uniform(*r.noise)), gain=gain,
        offset=float(rng.uniform(0, 0.3 * (1 - gain))), jpeg=int(rng.integers(r.jpeg[0], r.jpeg[1] + 1)),
    )  # fmt: skip
    return Scene(
        width, height, float(rng.uniform(*r.focal)) * width, (float(cx), float(cy)), r.model, lens,
        light=Light(float(gx), float(gy), float(wave), int(rng.integers(2**31))), sensor=sensor,
        background=Background(str(rng.choice(list(r.clutter))), int(rng.integers(2**31))),
        seed=int(rng.integers(2**31)),
    )  # fmt: skip


def _board(rng: Rng, r: Recipe, frame: Scene) -> BoardSpec:
    """A board with random position and pose, drawn repeatedly until all of it is visible."""
    white = float(rng.uniform(0.75, 0.95))
    blank = BoardSpec(
        *SIZE, (0, 0, 0), (0, 0, 1), black=float(rng.uniform(0.05, 0.2)), white=white,
        margin=float(rng.uniform(0.3, 1.0)), margin_value=white, swap=bool(rng.random() < 0.5),
    )  # fmt: skip
    for _ in range(TRIES):
        at = rng.uniform(0.2, 0.8, 2) * r.size
        pitch, tilt = float(rng.uniform(*r.pitch)), float(np.deg2rad(rng.uniform(0, r.tilt)))
        axis, roll = rng.uniform(0, 2 * np.pi, 2)
        spec = placed(blank, frame.camera, at, pitch, tilt, float(axis), float(roll))
        if spec is not None and _shown(spec, frame, r.least):
            return spec
    raise ConfigError(f"sets: no board of {SIZE} corners fits a picture of {r.size} as {r} wants it")


def _shown(spec: BoardSpec, frame: Scene, least: float) -> bool:
    """Whether all squares are in the picture, and all corners visible, off the border, and at least `least` px
    apart."""
    outline = np.array([(i, j) for i in range(-1, spec.cols + 1) for j in range(-1, spec.rows + 1)], float)
    if not _inside(board_to_pixels(spec, frame.camera, outline), frame, RIM):
        return False
    known = truth(replace(frame, boards=(spec,)))[0]
    return _inside(known.xy, frame, BORDER) and bool(known.visible.all()) and float(known.pitch.min()) >= least


def _inside(xy: Array, frame: Scene, border: float) -> bool:
    with np.errstate(invalid="ignore"):
        return bool(((xy >= border) & (xy <= np.array([frame.width, frame.height]) - 1 - border)).all())
