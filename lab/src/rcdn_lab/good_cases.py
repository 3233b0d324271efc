"""Sets of pictures from which a usable camera can be calibrated: simulated lenses, noise, parts, a few wrong corners.
None may be judged bad or unsure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rcdn.types import Board, Camera
from rcdn_lab.bad_cases import CaseInput, circle_centres
from rcdn_lab.camera_scenes import CAMERAS, random_boards
from rcdn_lab.real_boards import curved_board


@dataclass(frozen=True)
class GoodCase:
    """A usual case in words, and the function `make` that simulates it."""

    name: str
    make: Callable[[np.random.Generator], CaseInput]


def _set(lens: str, views: int, noise: float, scale: float = 1.0, **options: float | bool) -> GoodCase:
    """Boards of `camera_scenes`, in a picture `scale` times as large as there."""

    def make(rng: np.random.Generator) -> CaseInput:
        camera = larger(CAMERAS[lens], scale)
        boards, _ = random_boards(camera, int(rng.integers(1 << 30)), views, noise, **options)  # type: ignore[arg-type]
        return _named(boards)

    what = "".join(f", {key} {value:g}" for key, value in options.items() if not isinstance(value, bool))
    whole = ", whole boards" if options.get("whole") else ""
    size = f", {640 * scale:g} px" if scale != 1 else ""
    return GoodCase(f"{lens}, {views} views, noise {noise:g} px{size}{what}{whole}", make)


def _named(boards: list[Board]) -> CaseInput:
    return CaseInput(boards, [f"img{k:02d}.png" for k in range(len(boards))])


def larger(camera: Camera, scale: float) -> Camera:
    """`camera` with `scale` times as many pixels along each side."""
    if scale == 1:
        return camera
    K = camera.K * [[scale], [scale], [1]]
    K[:2, 2] += (scale - 1) / 2  # pixel (0, 0) is the centre of the first pixel
    width, height = (round(n * scale) for n in camera.image_size)
    return replace(camera, K=K, image_size=(width, height))


def _slightly_bent(rng: np.random.Generator) -> CaseInput:
    offsets = curved_board((0.0005, -0.0003))
    return _named(random_boards(CAMERAS["brown"], int(rng.integers(1 << 30)), 24, 0.15, offsets=offsets)[0])


CASES = (
    _set("pinhole", 20, 0.1),
    _set("pinhole", 15, 0.3, outliers=0.02),
    _set("brown", 12, 0.1),
    _set("brown", 15, 0.05, whole=True),
    _set("brown", 20, 0.1),
    _set("brown", 20, 0.3, outliers=0.02),
    _set("brown", 40, 0.2),
    _set("brown", 25, 0.05, outliers=0.03),
    _set("brown", 20, 0.3, scale=3.0),
    _set("rational", 20, 0.1),
    _set("rational", 30, 0.2, outliers=0.02),
    _set("fisheye", 15, 0.1, spread=1.0),
    _set("fisheye", 20, 0.2, spread=1.0, outliers=0.02),
    _set("fisheye", 30, 0.1, scale=2.0, spread=1.0),
    GoodCase("brown, 24 views, a board bent by half a millimetre", _slightly_bent),
    GoodCase("brown, 20 views, centroids of circles", circle_centres),
)
