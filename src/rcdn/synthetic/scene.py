"""Description of a rendered picture by plain values, which can be saved as JSON and rendered again.

Lengths on a board are in squares: inner corner (i, j) lies at (i, j); its z axis points away from the camera.
Lengths in the picture are in px; grey values and reflectances lie in 0..1 up to the sensor, noise is in grey levels of
255.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from rcdn.geometry.rigid import motion
from rcdn.types import Array, Camera, CameraModel, Pattern, Pose


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
    with `swap` bright; `bleed`: displacement of the edges into black (negative: into white), squares;
    `painted`: squares (i, j, value) painted over, where (i, j) is the corner at the square's far end; `coded`: bits per
    side of the marker in white squares, 0 = none.

    `pattern` deltille: triangles instead of squares, `cols` × `rows` inner corners in rows alternately offset by half
    an edge; corner (i, j) lies at (i + j/2, j·√3/2) edges, with i from −⌊j/2⌋. All triangles at these corners are
    printed, and no others; the one between (0, 0), (1, 0) and (0, 1) is dark. `painted` refers to rhombi; `coded`
    applies to squares only.
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

    @cached_property
    def pose(self) -> Pose:
        """T_cam_board, in squares."""
        return Pose(motion(cv2.Rodrigues(np.array(self.rvec, float))[0], np.array(self.tvec)))


@dataclass(frozen=True)
class Cover:
    """A capsule (segment with a radius) or, with `square`, a box around it; px. It occludes or shades boards."""

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
    """Imaging from irradiance to grey levels: defocus, motion, gain, gamma, noise, processing, JPEG.

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
    """`kind`: plain, noise, shapes, text, tiles, blocks, image; `seed` of its randomness; `image`: a picture's
    index."""

    kind: str = "noise"
    seed: int = 0
    image: int = -1


@dataclass(frozen=True)
class Scene:
    """Complete description of a picture; `seed` determines its noise."""

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

    @cached_property
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

    `xy` (cols·rows, 2) px, NaN where the lens can't see them; `ij` (cols·rows, 2) column and row (for a deltille: along
    its two axes), row by row.
    `visible` (N,): clearly visible; `ignore` (N,): in the picture, but too damaged to count as a true or a false
    positive (partly covered, at the frame's border, next to a painted square, a pitch under 4 px, 7 px for a deltille,
    or seen at less than 10° to the sheet).
    `pitch` (N,): distance to the nearest of the four (six) neighbours, px.
    """

    xy: Array
    ij: Array
    visible: Array
    ignore: Array
    pitch: Array
