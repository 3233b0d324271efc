"""What a rendered picture consists of: plain values that go to JSON and back, so that it can be rendered again.

Lengths on a board are in squares: inner corner (i, j) lies at (i, j); its z axis points away from the camera.
Lengths in the picture are in px; grey values and reflectances lie in 0..1 until the sensor, noise in grey levels
of 255.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass

import numpy as np

from rcdn.types import Array, Camera, CameraModel, Pattern


@dataclass(frozen=True)
class Bend:
    """Height of the sheet over its plane, ½·curvature·s² + amplitude·sin(2πs/period + phase).

    s runs along `angle` from the centre.
    """

    curvature: float = 0.0
    amplitude: float = 0.0
    period: float = 8.0
    phase: float = 0.0
    angle: float = 0.0


@dataclass(frozen=True)
class BoardSpec:
    """One board: `cols` × `rows` inner corners, pose (Rodrigues vector, translation in squares) and print.

    `margin`: quiet zone, squares, of reflectance `margin_value`; the square between corners (0, 0) and (1, 1) is dark,
    with `swap` bright; `bleed`: how far white runs into black (negative: black into white), squares;
    `painted`: squares (i, j, value) painted over, each named by the corner at its end; `coded`: bits per side of the
    marker in white squares, 0 = none.

    `pattern` deltille: triangles instead of squares, `cols` × `rows` inner corners in rows that are set off by half an edge in turn; corner
    (i, j) lies at (i + j/2, j·√3/2) edges, i from −⌊j/2⌋ on. All triangles at these corners are printed, and no others; the one
    between (0, 0), (1, 0) and (0, 1) is dark. `painted` names rhombi; `coded` counts for squares only.
    """

    cols: int
    rows: int
    rvec: tuple[float, float, float]
    tvec: tuple[float, float, float]
    aspect: float = 1.0
    margin: float = 0.5
    margin_value: float = 0.9
    black: float = 0.05
    white: float = 0.9
    swap: bool = False
    bleed: float = 0.0
    bend: Bend | None = None
    painted: tuple[tuple[int, int, float], ...] = ()
    coded: int = 0
    pattern: Pattern = "checker"


@dataclass(frozen=True)
class Cover:
    """A capsule (segment with a radius) or, with `square`, a box around it; px. Covers boards, or shades them."""

    x0: float
    y0: float
    x1: float
    y1: float
    radius: float
    value: float = 0.5
    square: bool = False
    soft: float = 1.0


@dataclass(frozen=True)
class Light:
    """Illumination: exp(gx·X + gy·Y + wave), X, Y in −½..½ of the frame; shadows multiply by `value`; glares add."""

    gx: float = 0.0
    gy: float = 0.0
    wave: float = 0.0
    wave_seed: int = 0
    shadows: tuple[Cover, ...] = ()
    glares: tuple[tuple[float, float, float, float], ...] = ()
    """(x, y, sigma px, strength)"""


@dataclass(frozen=True)
class Sensor:
    """From irradiance to grey levels: defocus, motion, gain, gamma, noise, processing, JPEG.

    Blur in px, noise in grey levels.
    """

    blur: float = 0.7
    disk: float = 0.0
    motion: float = 0.0
    motion_angle: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    gamma: float = 1.0
    noise: float = 2.0
    shot: float = 0.0
    smooth: float = 0.0
    sharpen: float = 0.0
    jpeg: int = 0
    invert: bool = False


@dataclass(frozen=True)
class Background:
    """`kind`: plain, noise, shapes, text, tiles, blocks, image. `seed` draws it; `image`: a picture's index."""

    kind: str = "noise"
    seed: int = 0
    image: int = -1


@dataclass(frozen=True)
class Scene:
    """Everything a picture is made from; `seed` draws its noise."""

    width: int
    height: int
    focal: float
    centre: tuple[float, float]
    model: CameraModel = "pinhole"
    distortion: tuple[float, ...] = ()
    boards: tuple[BoardSpec, ...] = ()
    covers: tuple[Cover, ...] = ()
    light: Light = dataclasses.field(default_factory=Light)
    sensor: Sensor = dataclasses.field(default_factory=Sensor)
    background: Background = dataclasses.field(default_factory=Background)
    seed: int = 0

    @property
    def camera(self) -> Camera:
        """The scene's camera."""
        (cx, cy), f = self.centre, self.focal
        K = np.array([[f, 0, cx], [0, f, cy], [0, 0, 1]])
        return Camera(K, np.array(self.distortion), (self.width, self.height), self.model)

    def to_json(self) -> str:
        """JSON text that `scene_from_json` reads back to an equal value."""
        return json.dumps(dataclasses.asdict(self))


@dataclass(frozen=True, eq=False)
class BoardTruth:
    """Exact corners of one rendered board.

    `xy` (cols·rows, 2) px, NaN where the lens can't see; `ij` (cols·rows, 2) column and row (of a deltille: along its two
    axes), row by row.
    `visible` (N,): plainly in the picture; `ignore` (N,): in the picture, but too damaged to demand or to forbid
    (half covered, at the frame, a painted square beside it, under 4 px of pitch, 7 px of a deltille, seen from under 10°).
    `pitch` (N,): distance to the nearest of the four (six) neighbours, px.
    """

    xy: Array
    ij: Array
    visible: Array
    ignore: Array
    pitch: Array
