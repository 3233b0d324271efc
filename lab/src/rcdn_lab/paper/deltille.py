"""Deltilles (paper section 4.5): detection on rendered scenes, false alarms, real pictures, and calibration and pose
from rendered views.

The paper used 500 pictures of a deltille, which are not public, and gives two figures. Here all pictures except the
real ones are rendered, so that the truth is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rcdn.calibration import calibrate, estimate_pose
from rcdn.config import DetectorConfig
from rcdn.detector import Detector
from rcdn.geometry.rules import TRIANGLES
from rcdn.io import read_image
from rcdn.metrics import match, within_radius
from rcdn.synthetic import DELTILLE, ORDINARY, BoardSpec, Scene, Sensor, random_scene, render, truth
from rcdn.synthetic.degrade import expose, legible
from rcdn.synthetic.render import irradiance
from rcdn.synthetic.surface import board_to_pixels
from rcdn.types import Array, Board
from rcdn_lab.paper.claim import Claim

FIRST, FIRST_CLUTTER, FIRST_VIEW = 7_450_000_000, 7_451_000_000, 7_452_000_000
"""seeds that are not used in training"""
RADIUS = 2.0
"""px within which a detection matches a corner"""
UNSURE = 0.25
"""px: a corner that no method can locate better than this in the noise (`legible`: computed as for an X-corner) is not
demanded; this happens in deep shadows"""
PAPER_CALIBRATION, PAPER_POSE = 0.3431, 0.3774
"""px, root mean square: section 4.5"""
NOISE, BLUR = 5.0, 1.0
"""noise, grey levels, and blur, px, of the views for calibration"""
SIZE, FOCAL, LENS = (640, 480), 560.0, (-0.18, 0.06, 0.001, -0.0007, 0.0)
PICTURES = "deltille-libcbdetect"
"""folder of the two real pictures (from libcbdetect's examples)"""
Step = Callable[[int, int], None] | None


class Counts(NamedTuple):
    """Counts over boards: `corners` in the picture, `found` ones among them, `false` ones, `wrong` labels, `whole`
    boards; `plain` corners, those that can be located, and `read`, those of them that were found; `gap`: sum of
    distances, px."""

    corners: int = 0
    found: int = 0
    false: int = 0
    wrong: int = 0
    whole: int = 0
    plain: int = 0
    read: int = 0
    gap: float = 0.0

    def plus(self, more: Counts) -> Counts:
        """The sum of both."""
        a, b, c, d, e, f, g = (mine + other for mine, other in zip(self[:7], more[:7], strict=True))
        return Counts(a, b, c, d, e, f, g, self.gap + more.gap)


def detector() -> Detector:
    """A detector for deltilles. Raises RcdnError if the network's weights are missing."""
    return Detector(DetectorConfig(pattern="deltille", threads=1))


def same_lattice(ij: Array, expected: Array, swapped: bool) -> Array:
    """(M,) bool: which labels `ij` (M, 2) agree with `expected` (M, 2) up to a translation and the rotations that the
    colours allow; for the best of those.

    `swapped`: the picture's colours are opposite to those that the labels of `expected` assume, so that only odd sixths
    of a turn are possible.
    """
    best = np.zeros(len(ij), bool)
    for sixth in range(int(swapped), 6, 2) if len(ij) else ():
        shift = TRIANGLES.turned(ij, sixth) - expected
        values, counts = np.unique(shift, axis=0, return_counts=True)
        agrees = (shift == values[counts.argmax()]).all(axis=1)
        best = agrees if agrees.sum() > best.sum() else best
    return best


def score(scene: Scene, boards: list[Board], locatable: Array | None = None) -> Counts:
    """Boards found in the picture of a scene with one deltille, compared with the truth. Corners that are neither
    demanded nor forbidden do not count.

    `locatable` (cols·rows,) bool: corners that can be located in the picture (None: all).
    """
    known, spec = truth(scene)[0], scene.boards[0]
    sure = np.flatnonzero(known.visible)
    plain = np.ones(len(sure), bool) if locatable is None else locatable[sure]
    found = false = wrong = read = 0
    gap = 0.0
    for board in boards:
        pairs, gaps = match(board.xy, known.xy[sure], RADIUS)
        other = np.setdiff1d(np.arange(len(board)), pairs[:, 0])
        false += int((~within_radius(board.xy[other], known.xy[known.ignore], RADIUS)).sum())
        swapped = spec.swap != scene.sensor.invert
        good = same_lattice(board.ij[pairs[:, 0]], known.ij[sure[pairs[:, 1]]], swapped)
        wrong += int((~good).sum())
        found, gap = found + len(pairs), gap + float(gaps.sum())
        read += int(plain[pairs[:, 1]].sum())
    whole = int(len(boards) == 1 and read == plain.sum() and false + wrong == 0)
    return Counts(len(sure), found, false, wrong, whole, int(plain.sum()), read, gap)


def scenes(count: int, step: Step = None) -> dict[str, Any]:
    """A row of figures of `count` rendered scenes: corners found in boards, among those that can be located, and among
    all."""
    find, total = detector(), Counts()
    for k in range(count):
        scene = random_scene(np.random.default_rng(FIRST + k), DELTILLE, SIZE)
        light, known = irradiance(scene), truth(scene)[0]
        picture = expose(light, scene.sensor, np.random.default_rng(scene.seed))
        locatable = legible(light, scene.sensor, np.nan_to_num(known.xy), known.pitch, UNSURE)
        total = total.plus(score(scene, find.boards(picture), locatable))
        if step:
            step(k + 1, count)
    return {
        "what": "rendered scenes", "pictures": count, "corners": total.plain,
        "recall": total.read / max(total.plain, 1), "precision": total.found / max(total.found + total.false, 1),
        "wrong labels": total.wrong, "whole": total.whole, "error px": total.gap / max(total.found, 1),
        "recall of all": total.found / max(total.corners, 1),
    }  # fmt: skip


def clutter(count: int, step: Step = None) -> dict[str, Any]:
    """Boards "found" in `count` rendered pictures without any deltille, half of them with a checkerboard."""
    find, alarms = detector(), 0
    for k in range(count):
        ranges = replace(ORDINARY, none_p=float(k % 2))
        scene = random_scene(np.random.default_rng(FIRST_CLUTTER + k), ranges, SIZE)
        alarms += len(find.boards(render(scene)))
        if step:
            step(k + 1, count)
    return {"what": "rendered clutter", "pictures": count, "false boards": alarms}


def real(data: Path | None) -> list[dict[str, Any]]:
    """Boards found in the real pictures under `data`, a row each; [] if the pictures are missing."""
    folder = None if data is None else data / PICTURES
    if folder is None or not folder.is_dir():
        return []
    find, rows = detector(), []
    for path in sorted(folder.glob("*.png")):
        boards = find.boards(read_image(path))
        rows.append({"what": path.stem, "boards": len(boards), "corners": ", ".join(str(len(b)) for b in boards)})
    return rows


# ---- calibration


@dataclass(frozen=True)
class View:
    """One view: its board as detected, and the distances of its corners from the truth, px."""

    board: Board
    gaps: Array


def view_scene(index: int) -> Scene:
    """A 10×9 deltille in front of the camera common to all views, at a random position and tilt, wholly in the
    picture."""
    rng = np.random.default_rng(FIRST_VIEW + index)
    width, height = SIZE
    scene = Scene(
        width, height, FOCAL, (width / 2 - 3.3, height / 2 + 4.1), "brown", LENS,
        sensor=Sensor(blur=BLUR, noise=NOISE, gain=0.8, offset=0.1), seed=int(rng.integers(2**31)),
    )  # fmt: skip
    while True:
        tilt, turn, roll = rng.uniform(0, 0.85), rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
        spec = _placed(scene, tilt, turn, roll, rng.uniform(24, 40), rng.uniform(0.3, 0.7, 2) * SIZE)
        known = truth(replace(scene, boards=(spec,)))[0]
        if known.visible.all():
            return replace(scene, boards=(spec,))


def _placed(scene: Scene, tilt: float, turn: float, roll: float, pitch: float, at: Array) -> BoardSpec:
    import cv2

    lean = cv2.Rodrigues(tilt * np.array([np.cos(turn), np.sin(turn), 0.0]))[0]
    R = lean @ cv2.Rodrigues(np.array([0, 0, roll]))[0]
    depth = scene.focal / pitch
    middle = np.array([4.75, 4 * 0.75**0.5, 0])
    t = np.array([*(at - scene.centre) / scene.focal * depth, depth]) - R @ middle
    r = cv2.Rodrigues(R)[0].ravel()
    return BoardSpec(
        10,
        9,
        (*map(float, r),),  # type: ignore[arg-type]
        (*map(float, t),),  # type: ignore[arg-type]
        margin=1.0,
        pattern="deltille",
    )


def views(count: int, step: Step = None) -> Iterator[View]:
    """The boards detected in `count` views, and their corners' errors."""
    find = detector()
    for k in range(count):
        scene = view_scene(k)
        boards = find.boards(render(scene))
        if boards:
            known = board_to_pixels(scene.boards[0], scene.camera, truth(scene)[0].ij)
            gaps = match(boards[0].xy, known, RADIUS)[1]
            yield View(boards[0], gaps)
        if step:
            step(k + 1, count)


def calibration(count: int, step: Step = None) -> dict[str, Any]:
    """Calibrate from every second view, then solve only the poses of the others, as in section 4.4; root mean squares,
    px."""
    seen = list(views(count, step))
    boards = [view.board for view in seen]
    camera = calibrate(boards[::2], 0.03, model="brown")
    gaps = [estimate_pose(board, camera.camera, 0.03).residuals for board in boards[1::2]]
    residuals = np.concatenate([v.residuals for v in camera.views if not v.reason])
    true = np.concatenate([view.gaps for view in seen])
    return {
        "what": "calibration", "pictures": count, "boards": len(boards), "corners": sum(map(len, boards)),
        "cal": _rms(residuals), "paper's cal": PAPER_CALIBRATION, "pose": _rms(np.concatenate(gaps)),
        "paper's pose": PAPER_POSE, "error px": _rms(true[:, None]),
        "focal length off": abs(float(camera.camera.K[0, 0]) / FOCAL - 1),
    }  # fmt: skip


def _rms(gaps: Array) -> float:
    return float(np.sqrt(np.nanmean((gaps**2).sum(axis=1))))


def claims(
    rendered: dict[str, Any], alarms: dict[str, Any], pictures: list[dict[str, Any]], cal: dict[str, Any]
) -> list[Claim]:
    """The paper's claims, and our requirements."""
    both = [row["boards"] for row in pictures]
    return [
        Claim(
            "calibration from deltilles at 0.3431 px or less",
            bool(cal["cal"] <= PAPER_CALIBRATION),
            f"{cal['cal']:.4f} px",
        ),
        Claim("poses at 0.3774 px or less", bool(cal["pose"] <= PAPER_POSE), f"{cal['pose']:.4f} px"),
        Claim(
            "recall of 0.99 on rendered scenes",
            bool(rendered["recall"] >= 0.99),
            f"{rendered['recall']:.4f}",
            ours=True,
        ),
        Claim("no wrong label", rendered["wrong labels"] == 0, str(rendered["wrong labels"]), ours=True),
        Claim("no board in clutter", alarms["false boards"] == 0, str(alarms["false boards"]), ours=True),
        Claim("a board in each real picture", min(both) > 0 if both else None, f"{both or 'no pictures'}", ours=True),
    ]
