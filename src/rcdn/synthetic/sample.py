"""Random scenes. `Ranges` sets their difficulty; the random generator is seeded, so that a seed determines a scene."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from rcdn.errors import ConfigError
from rcdn.geometry import unproject
from rcdn.synthetic.background import KINDS
from rcdn.synthetic.lattice import from_upright, labels, middle, steps
from rcdn.synthetic.scene import Background, Bend, BoardSpec, Cover, Light, Scene, Sensor
from rcdn.synthetic.surface import board_to_pixels

Rng = np.random.Generator
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Ranges:
    """Difficulty of scenes. Probabilities end in `_p`; lengths are in px, noise in grey levels, tilt in degrees.

    `edge_shadow_p`: probability of a shadow whose edge crosses the neighbourhood of a corner, in addition to those of
    `shadow_p`, which fall anywhere. `deltille_p`: that a board is a deltille. `busy_p`: that a training window without
    a board shows a detailed part of a photograph. Corners are ignored in training and evaluation if the contrast around
    them is low (`faint`: smallest standard deviation over 9×9 px, as a share of the window's range of grey levels), or
    if they can't be localised to within `unsure` px.
    """

    pitch: tuple[float, float] = (14.0, 60.0)
    cells: tuple[int, int] = (4, 13)
    tilt: float = 50.0
    noise: float = 8.0
    noise_tail_p: float = 0.0
    blur: tuple[float, float] = (0.4, 1.2)
    wide_blur_p: float = 0.0
    motion_p: float = 0.0
    contrast: tuple[float, float] = (0.4, 0.9)
    fisheye_p: float = 0.1
    distortion: float = 0.15
    bend_p: float = 0.0
    cover_p: float = 0.0
    shadow_p: float = 0.1
    edge_shadow_p: float = 0.0
    glare_p: float = 0.05
    bleed_p: float = 0.1
    paint_p: float = 0.0
    coded_p: float = 0.0
    jpeg_p: float = 0.3
    process_p: float = 0.1
    light: float = 0.8
    invert_p: float = 0.0
    none_p: float = 0.0
    several_p: float = 0.0
    whole: bool = True
    images_p: float = 0.0
    busy_p: float = 0.0
    faint: float = 0.0
    unsure: float = 0.6
    deltille_p: float = 0.0


ORDINARY = Ranges()
"""Typical calibration pictures, similar to the data sets of the paper."""

HARD = Ranges(
    pitch=(6, 60), cells=(3, 14), tilt=75, noise=25, noise_tail_p=0.25, blur=(0.4, 2.0), wide_blur_p=0.25,
    motion_p=0.15, contrast=(0.12, 0.9), fisheye_p=0.3, distortion=0.4, bend_p=0.1, cover_p=0.2, shadow_p=0.3,
    glare_p=0.2, bleed_p=0.2, paint_p=0.1, coded_p=0.05, jpeg_p=0.3, process_p=0.2, light=1.5, invert_p=0.5,
    none_p=0.12, several_p=0.2, whole=False,
)  # fmt: skip
"""The fixed hard validation set: noise up to 60, blur up to 4 px, contrast from 18 grey levels, tilt up to 75°."""

TRAINING = replace(HARD, images_p=0.35, none_p=0.18, tilt=78, pitch=(5, 60), edge_shadow_p=0.3)
"""Training data of the networks: HARD, with photographs as backgrounds if available, and more hard shadows."""

PAPER = replace(
    HARD, pitch=(8, 60), tilt=60, noise=13, noise_tail_p=0, blur=(0.4, 1.2), wide_blur_p=0, motion_p=0,
    contrast=(0.45, 0.95), fisheye_p=0.15, distortion=0.25, bend_p=0.05, cover_p=0.15, shadow_p=0.2, glare_p=0.05,
    bleed_p=0.1, paint_p=0, coded_p=0, process_p=0.1, light=0.8, none_p=0.3, several_p=0.15, images_p=0.6,
    busy_p=0.75, faint=0.15, unsure=0.25,
)  # fmt: skip
"""Similar to the paper's own training set (section 3.2): clutter, distortion, occlusion, moderate noise and blur, half
of the pictures inverted; only corners that are easy to see.

Under the class-balanced loss of Eq. 1 a network responds wherever a corner is more probable than one in thousands, so
that training on corners that are too faint to recognise makes it respond everywhere.
"""

PAPER_NOISE = replace(PAPER, noise_tail_p=0.12, wide_blur_p=0.12)
"""PAPER with some scenes of strong noise and of wide blur."""

PAPER_WIDE = replace(
    PAPER, pitch=(6, 60), noise_tail_p=0.12, wide_blur_p=0.12, motion_p=0.05, contrast=(0.3, 0.95), light=1.2,
    edge_shadow_p=0.15,
)  # fmt: skip
"""PAPER with some scenes of strong noise, wide blur, low contrast, uneven light and hard shadows, for long training."""

DELTILLE = replace(ORDINARY, cells=(5, 12), deltille_p=1)
"""Calibration pictures of deltilles (paper section 4.5)."""

DELTILLE_TRAINING = replace(
    TRAINING, pitch=(9, 70), tilt=70, noise_tail_p=0.15, wide_blur_p=0.2, motion_p=0.1, coded_p=0.1, deltille_p=0.75
)
"""Training data for deltilles: TRAINING without the steepest and smallest boards; its checkerboards are clutter."""

PRESETS = {
    "ordinary": ORDINARY, "hard": HARD, "training": TRAINING, "paper": PAPER, "paper-noise": PAPER_NOISE,
    "paper-wide": PAPER_WIDE, "deltille": DELTILLE, "deltille-training": DELTILLE_TRAINING,
}  # fmt: skip


def random_scene(
    rng: Rng, ranges: Ranges = ORDINARY, size: tuple[int, int] = (640, 480), image_count: int = 0
) -> Scene:
    """A scene of `size` (width, height) with no, one or several boards.

    `image_count`: number of pictures available as backgrounds. Raises ConfigError if `ranges` requires whole boards
    that don't fit.
    """
    width, height = size
    scene = _empty(rng, ranges, width, height, image_count)
    if rng.random() < ranges.none_p:
        return scene
    count = int(rng.integers(2, 4)) if rng.random() < ranges.several_p else 1
    for _ in range(count):
        spec = _board_in(rng, ranges, scene)
        scene = replace(scene, boards=(*scene.boards, spec))
    scene = _with_covers(rng, ranges, scene)
    return _with_edge_shadow(rng, scene) if ranges.edge_shadow_p and _chance(rng, ranges.edge_shadow_p) else scene


def camera_view(seed: int, number: int, size: tuple[int, int] = (640, 480)) -> Scene:
    """Picture `number` of a calibration: one fully visible board of 9×6 corners at a random pose before a camera with
    barrel distortion. The camera depends only on `seed` and `size` (width, height)."""
    rng, (width, height) = np.random.default_rng((seed, 0)), size
    focal = float(rng.uniform(0.75, 0.95) * max(size))
    centre = (float(width * rng.uniform(0.48, 0.52)), float(height * rng.uniform(0.48, 0.52)))
    lens = (float(rng.uniform(-0.3, -0.2)), float(rng.uniform(0.05, 0.1)), *rng.normal(0, 0.001, 2).tolist())
    rng = np.random.default_rng((seed, number))
    sensor = Sensor(blur=float(rng.uniform(0.6, 1.0)), noise=float(rng.uniform(1, 4)))
    background = Background("shapes", int(rng.integers(1 << 31)))
    scene = Scene(width, height, focal, centre, "brown", lens, sensor=sensor, background=background, seed=number)
    while True:
        at = (float(rng.uniform(0.2, 0.8) * width), float(rng.uniform(0.2, 0.8) * height))
        pitch = float(rng.uniform(0.05, 0.1) * min(size))
        spec = _placed(BoardSpec(9, 6, (0, 0, 0), (0, 0, 0)), scene, _rotation(rng, 45), at, pitch)
        if _whole(spec, scene, least=0.03 * min(size)):
            return replace(scene, boards=(spec,))


def _chance(rng: Rng, p: float) -> bool:
    return bool(rng.random() < p)


def _log(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _empty(rng: Rng, r: Ranges, width: int, height: int, image_count: int) -> Scene:
    centre = (width / 2 + float(rng.normal(0, 10)), height / 2 + float(rng.normal(0, 10)))
    lens: dict[str, Any] = {"focal": _log(rng, 0.6, 2.0) * width}
    if _chance(rng, r.fisheye_p):
        lens = {"focal": width / float(np.deg2rad(rng.uniform(90, 185))), "model": "fisheye"}
        lens["distortion"] = tuple(float(v) for v in rng.uniform(-1, 1, 4) * [0.04, 0.01, 0.003, 0.001])
    elif _chance(rng, 0.8):
        d = r.distortion
        k = rng.uniform([-d, -d / 4, -0.005, -0.005, 0], [d * 0.6, d / 4, 0.005, 0.005, 0])
        lens |= {"model": "brown", "distortion": tuple(float(v) for v in k)}
        lens["focal"] = max(lens["focal"], 0.9 * width)  # if shorter, the polynomial folds inside the frame
    kind = "image" if image_count and _chance(rng, r.images_p) else str(rng.choice(list(KINDS)))
    background = Background(kind, int(rng.integers(2**31)), int(rng.integers(max(1, image_count))))
    return Scene(
        width, height, centre=centre, light=_light(rng, r, width, height), sensor=_sensor(rng, r),
        background=background, seed=int(rng.integers(2**31)), **lens,
    )  # fmt: skip


def _light(rng: Rng, r: Ranges, width: int, height: int) -> Light:
    gx, gy = rng.normal(0, r.light / 2, 2)
    shadows, glares = [], []
    for _ in range(int(rng.integers(1, 3)) if _chance(rng, r.shadow_p) else 0):
        a, far = float(rng.uniform(0, 2 * np.pi)), 2.0 * width
        x, y = rng.uniform(0.2, 0.8) * width, rng.uniform(0.2, 0.8) * height
        half = far if _chance(rng, 0.6) else _log(rng, 8, 150)
        shadows.append(shade((x, y), a, half, far, float(rng.uniform(0.15, 0.7)), _log(rng, 1, 25)))
    for _ in range(int(rng.integers(1, 3)) if _chance(rng, r.glare_p) else 0):
        spot = (float(rng.uniform(0, width)), float(rng.uniform(0, height)))
        glares.append((*spot, _log(rng, 8, 90), float(rng.uniform(0.2, 1.2))))
    wave = float(rng.normal(0, r.light / 4)) if _chance(rng, 0.4) else 0.0
    return Light(float(gx), float(gy), wave, int(rng.integers(2**31)), tuple(shadows), tuple(glares))


def shade(at: tuple[float, float], angle: float, half: float, far: float, value: float, soft: float) -> Cover:
    """A box 2·`half` px wide and 2·`far` px long with a long side through `at`: a half plane, or a bar."""
    c, s = np.cos(angle), np.sin(angle)
    cx, cy = at[0] - s * half, at[1] + c * half
    x0, y0, x1, y1 = map(float, (cx - c * far, cy - s * far, cx + c * far, cy + s * far))
    return Cover(x0, y0, x1, y1, half, value, True, soft)


def _with_edge_shadow(rng: Rng, scene: Scene) -> Scene:
    """The scene with an additional shadow, usually sharp, whose edge crosses the first board on or near its corners."""
    spec, far = scene.boards[0], 2.0 * scene.width
    uv = rng.uniform([-0.5, -0.5], [spec.cols - 0.5, spec.rows - 0.5], (1, 2))
    x, y = board_to_pixels(spec, scene.camera, from_upright(spec, uv))[0]
    half = far if _chance(rng, 0.7) else _log(rng, 4, 60)
    if not np.isfinite(x + y):
        return scene
    value, soft = float(rng.uniform(0.1, 0.7)), _log(rng, 0.3, 8)
    edge = shade((x, y), float(rng.uniform(0, 2 * np.pi)), half, far, value, soft)
    return replace(scene, light=replace(scene.light, shadows=(*scene.light.shadows, edge)))


def _sensor(rng: Rng, r: Ranges) -> Sensor:
    blur = float(rng.uniform(*r.blur))
    disk = 0.0
    if _chance(rng, r.wide_blur_p):
        blur, disk = (float(rng.uniform(1.5, 4)), 0.0) if _chance(rng, 0.6) else (0.5, float(rng.uniform(1.5, 6)))
    noise = abs(float(rng.normal(0, r.noise / 2))) + 0.3
    if _chance(rng, r.noise_tail_p):
        noise = float(rng.uniform(r.noise, 60))
    contrast = _log(rng, *r.contrast) if _chance(rng, 0.5) else float(rng.uniform(*r.contrast))
    noise = min(noise, 110 * contrast)  # with more noise, nothing is recognisable
    process = _chance(rng, r.process_p)
    return Sensor(
        blur=blur, disk=disk, noise=noise, shot=float(rng.uniform(0, 6)) if _chance(rng, 0.3) else 0.0,
        motion=float(rng.uniform(2, 9)) if _chance(rng, r.motion_p) else 0.0, motion_angle=float(rng.uniform(0, np.pi)),
        gain=contrast, offset=float(rng.uniform(0, max(0.0, 0.95 - contrast))), gamma=float(rng.uniform(0.6, 1.7)),
        smooth=float(rng.uniform(0.4, 1.0)) if process and _chance(rng, 0.5) else 0.0,
        sharpen=float(rng.uniform(0.3, 1.5)) if process and _chance(rng, 0.6) else 0.0,
        jpeg=int(rng.integers(25, 95)) if _chance(rng, r.jpeg_p) else 0, invert=_chance(rng, r.invert_p),
    )  # fmt: skip


def _print(rng: Rng, r: Ranges) -> BoardSpec:
    """A board without its pose."""
    low, high = r.cells
    cols, rows = int(rng.integers(low, high + 1)), int(rng.integers(low, high + 1))
    black = float(rng.uniform(0, 0.3))
    white = float(rng.uniform(black + 0.35, 1.0))
    margin = 0.0 if _chance(rng, 0.15) else float(rng.uniform(0.1, 1.5))
    margin_value = white if _chance(rng, 0.7) else float(rng.uniform(0, 1))
    painted = tuple(
        (int(rng.integers(0, cols + 1)), int(rng.integers(0, rows + 1)), float(rng.uniform(0, 1)))
        for _ in range(int(rng.integers(1, 4)) if _chance(rng, r.paint_p) else 0)
    )
    spec = BoardSpec(
        cols, rows, (0, 0, 0), (0, 0, 1),
        aspect=float(rng.uniform(0.8, 1.25)) if _chance(rng, 0.15) and not r.whole else 1.0,
        margin=margin, margin_value=margin_value, black=black, white=white, swap=_chance(rng, 0.5),
        bleed=float(rng.uniform(-0.06, 0.06)) if _chance(rng, r.bleed_p) else 0.0,
        bend=_bend(rng, max(cols, rows)) if _chance(rng, r.bend_p) else None, painted=painted,
        coded=int(rng.integers(4, 7)) if _chance(rng, r.coded_p) else 0,
    )  # fmt: skip
    return _deltille(spec) if r.deltille_p and _chance(rng, r.deltille_p) else spec


def _deltille(spec: BoardSpec) -> BoardSpec:
    """The board with triangles instead of squares; the labels of painted rhombi are shifted so that they stay at the
    horizontal positions of the painted squares."""
    painted = tuple((i - j // 2, j, value) for i, j, value in spec.painted)
    return replace(spec, pattern="deltille", painted=painted, coded=0)


def _bend(rng: Rng, size: int) -> Bend:
    angle = float(rng.uniform(0, np.pi))
    if _chance(rng, 0.5):
        return Bend(curvature=float(rng.choice([-1, 1])) / (size * float(rng.uniform(1, 5))), angle=angle)
    period = size * float(rng.uniform(0.6, 2))
    amplitude = period * float(rng.uniform(0.01, 0.06))
    return Bend(amplitude=amplitude, period=period, phase=float(rng.uniform(0, 6.3)), angle=angle)


def _rotation(rng: Rng, max_tilt: float) -> Triple:
    """Rotation vector of a roll about the normal followed by a tilt about an axis in the plane; a third of the tilts
    are drawn from the steep end of the range."""
    tilt = rng.uniform(0, max_tilt) if _chance(rng, 0.67) else rng.uniform(0.6 * max_tilt, max_tilt)
    a, roll = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    lean = cv2.Rodrigues(np.deg2rad(tilt) * np.array([np.cos(a), np.sin(a), 0]))[0]
    turn = cv2.Rodrigues(np.array([0, 0, roll]))[0]
    x, y, z = cv2.Rodrigues(lean @ turn)[0].ravel()
    return float(x), float(y), float(z)


def _placed(spec: BoardSpec, scene: Scene, rvec: Triple, at: tuple[float, float], pitch: float) -> BoardSpec:
    """The board rotated by `rvec` about its middle, which projects to the pixel `at`; a fronto-parallel square there
    would have a side of about `pitch` px."""
    ray = unproject(scene.camera, np.array(at))
    if not np.isfinite(ray).all():
        ray = np.array([0.0, 0.0, 1.0])
    ray = ray / np.linalg.norm(ray)
    face = _facing(ray) if scene.model == "fisheye" else np.eye(3)
    R = face @ cv2.Rodrigues(np.array(rvec))[0]
    centre = np.array([*middle(spec), 0])
    t = ray * (scene.focal / pitch) / (ray[2] if scene.model != "fisheye" else 1.0) - R @ centre
    r = cv2.Rodrigues(R)[0].ravel()
    return replace(spec, rvec=(float(r[0]), float(r[1]), float(r[2])), tvec=(float(t[0]), float(t[1]), float(t[2])))


def _facing(ray: np.ndarray) -> np.ndarray:
    """Rotation that takes the optical axis to a ray, so that boards far off a fisheye's axis still face the camera."""
    axis = np.cross([0, 0, 1], ray)
    s = float(np.linalg.norm(axis))
    return cv2.Rodrigues(axis / s * np.arctan2(s, ray[2]))[0] if s > 1e-9 else np.eye(3)


def _board_in(rng: Rng, r: Ranges, scene: Scene) -> BoardSpec:
    """A board with a random pose; with `whole`, poses are drawn until every corner is inside the frame."""
    w, h = scene.width, scene.height
    for _ in range(200):
        spec = _print(rng, r)
        at = (float(rng.uniform(0.2, 0.8) * w), float(rng.uniform(0.2, 0.8) * h))
        low, high = r.pitch
        if r.whole:
            high = min(high, 0.9 * max(w, h) / max(spec.cols, spec.rows))
        spec = _placed(spec, scene, _rotation(rng, r.tilt), at, _log(rng, low, max(high, low + 1)))
        if not r.whole or _whole(spec, scene, least=0.5 * low):
            return spec
    raise ConfigError(f"ranges: no whole board of pitch {r.pitch} fits a frame of {w} × {h} px; take a larger `size`")


def _whole(spec: BoardSpec, scene: Scene, least: float) -> bool:
    xy = board_to_pixels(spec, scene.camera, labels(spec))
    if not np.isfinite(xy).all() or (xy < 10).any() or (xy > [scene.width - 11, scene.height - 11]).any():
        return False
    if spec.pattern == "deltille":
        around = [board_to_pixels(spec, scene.camera, labels(spec) + step) for step in steps(spec)[:3]]
        return bool(min(np.linalg.norm(other - xy, axis=1).min() for other in around) > least)
    grid = xy.reshape(spec.rows, spec.cols, 2)
    lengths = [np.linalg.norm(np.diff(grid, axis=a), axis=-1).min() for a in (0, 1)]
    return bool(min(lengths) > least)


def _with_covers(rng: Rng, r: Ranges, scene: Scene) -> Scene:
    if not _chance(rng, r.cover_p):
        return scene
    covers = []
    spec = scene.boards[0]
    for _ in range(int(rng.integers(1, 4))):
        uv = rng.uniform([-1, -1], [spec.cols, spec.rows], (2, 2))
        ends = np.nan_to_num(board_to_pixels(spec, scene.camera, from_upright(spec, uv)))
        if _chance(rng, 0.5):
            ends[1] = ends[0] + (ends[1] - ends[0]) * rng.uniform(0, 0.5)
        value, soft = float(rng.uniform(0, 1)), float(rng.choice([1.0, 1.0, 3.0]))
        x0, y0, x1, y1 = map(float, ends.ravel())
        covers.append(Cover(x0, y0, x1, y1, _log(rng, 4, 60), value, _chance(rng, 0.5), soft))
    return replace(scene, covers=tuple(covers))
