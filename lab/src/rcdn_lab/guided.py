"""The benefit of guidance: simulated people who hold a board where the guide wants it, at random, or where the sensor
is not covered yet.

The error of each camera at the corners of the frame after 4, 6, 8, … pictures, and the number from which on it stays
below a target.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

import rcdn
import rcdn_lab
from rcdn.calibration import calibrate
from rcdn.calibration.candidates import GRID, frame_grid
from rcdn.calibration.difference import difference
from rcdn.calibration.guidance import Guide
from rcdn.calibration.guidance.progress import reach_of
from rcdn.errors import CalibrationError
from rcdn.geometry import rotation, unproject
from rcdn.types import SQUARES, Array, Board, Calibration, Camera
from rcdn_lab.camera_scenes import CAMERAS, SIZE, SPACING, detected, random_pose, see
from rcdn_lab.real_boards import uneven_board
from rcdn_lab.repeatability import projection_deviation
from rcdn_lab.share_out import share_out

LENSES = {
    "pinhole": CAMERAS["brown"],
    "wide": Camera(
        np.array([[330.0, 0, 322], [0, 329, 238], [0, 0, 1]]),
        np.array([-0.24, 0.05, 0.0004, -0.0003, -0.004]),
        (640, 480),
    ),
    "fisheye": CAMERAS["fisheye"],
}
BOARDS = ("flat", "bent")
STRETCH, PRINT_ERROR, BEND = 0.002, 0.00005, 0.0005
"""of a bent board: as in `trust`"""
NOISE = 0.1
"""px"""
TURN, NEARER, ASIDE = 6.0, 0.07, 0.04
"""deviations of people from the wanted pose, standard deviations: degrees about each axis, share of the distance,
tangent of the sideways angle"""
TILT = 45.0
"""largest tilt of a random pose, degrees"""
FEWEST_SEEN = 20
"""least number of corners in the frame"""
TRIES = 30
"""random poses, of which the one that newly covers most of the sensor is taken"""
CELLS, COVERED = (12, 9), 0.95
"""equal parts of the sensor, and the share of them after which coverage starts again"""
COUNTS = (4, 5, 6, 7, 8, 9, 10, 12, 14, 17, 20, 24, 29, 35, 42, 50, 60)
"""numbers of pictures after which a camera is evaluated"""
TARGETS = (0.1, 0.3)
"""px, in the corners of the frame: the goal, and what bent boards allow"""
COMPARED_FROM = 6
"""least number of pictures for which stated deviations are compared with errors"""
MIDDLE = np.array([(SIZE[0] - 1) / 2, (SIZE[1] - 1) / 2, 0]) * SPACING

Person = Callable[["Scene", int, int], list[Calibration | None]]


@dataclass(frozen=True, eq=False)
class Scene:
    """A `camera`, and a board whose corners are displaced by `offsets` (N, 3) m."""

    camera: Camera
    offsets: Array | None

    def picture(self, T: Array, rng: np.random.Generator) -> Board | None:
        """The board at `T`, with noise; None if too little of it is in the frame."""
        ij, xy = see(self.camera, T, offsets=self.offsets)
        if len(ij) < FEWEST_SEEN:
            return None
        noisy = xy + rng.normal(0, NOISE, xy.shape)
        return detected(ij, noisy, self.camera.image_size, np.full(len(xy), NOISE))

    def somewhere(self, rng: np.random.Generator) -> Board:
        """The board at a `random_pose` at which enough of it is visible."""
        while True:
            seen = self.picture(random_pose(rng), rng)
            if seen is not None:
                return seen

    def anywhere(self, rng: np.random.Generator) -> Board:
        """The board with its centre anywhere in the frame, at distances within the range of the guide, tilted by up to
        TILT."""
        distances = reach_of(self.camera, SIZE, SQUARES, SPACING)
        while True:
            spot = rng.uniform(0, 1, 2) * self.camera.image_size
            ray = unproject(self.camera, spot[None])[0]
            distance = 1 / rng.uniform(1 / distances[-1], 1 / distances[0])
            lean, turn = rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(0, TILT))
            R = (
                _facing(ray)
                @ rotation(turn * np.array([np.cos(lean), np.sin(lean), 0]))
                @ rotation(rng.normal(0, 0.3, 3) * [0, 0, 1])
            )
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = R, ray / np.linalg.norm(ray) * distance - R @ MIDDLE
            seen = self.picture(T, rng)
            if np.isfinite(T).all() and seen is not None:
                return seen


def guided(scene: Scene, seed: int, most: int) -> list[Calibration | None]:
    """Cameras after 1, 2, … `most` pictures of a person who follows the guide approximately."""
    rng = np.random.default_rng([seed, 1])
    guide = Guide(scene.camera.image_size, SPACING, model=scene.camera.model, size=SIZE)
    done: list[Calibration | None] = []
    while len(done) < most:
        wanted = guide.progress.wanted
        seen = None if wanted is None else scene.picture(_followed(wanted.pose.T_cam_board, rng), rng)
        done.append(guide.add(seen or scene.anywhere(rng), str(len(done))).calibration)
    return done


def at_random(scene: Scene, seed: int, most: int) -> list[Calibration | None]:
    """The same for a person who holds the board at a `random_pose`, as in all our simulations: 0.3 to 0.8 m away,
    tilted by up to 46°."""
    rng = np.random.default_rng([seed, 2])
    return _calibrated(scene, [scene.somewhere(rng) for _ in range(most)])


def by_coverage(scene: Scene, seed: int, most: int) -> list[Calibration | None]:
    """The same for a person who takes, of several such poses, the one that newly covers most of the sensor."""
    rng, covered = np.random.default_rng([seed, 3]), np.zeros(CELLS, bool)
    boards: list[Board] = []
    for _ in range(most):
        some = [scene.somewhere(rng) for _ in range(TRIES)]
        boards.append(some[int(np.argmax([int((_cells(b) & ~covered).sum()) for b in some]))])
        covered |= _cells(boards[-1])
        if covered.mean() > COVERED:
            covered[:] = False  # start again
    return _calibrated(scene, boards)


def by_the_book(scene: Scene, seed: int, most: int) -> list[Calibration | None]:
    """The same for an expert: the board anywhere in the frame up to its border, at distances within the range of the
    guide, tilted by up to TILT."""
    rng = np.random.default_rng([seed, 5])
    return _calibrated(scene, [scene.anywhere(rng) for _ in range(most)])


PEOPLE: dict[str, Person] = {"guided": guided, "random": at_random, "coverage": by_coverage, "expert": by_the_book}


@dataclass(frozen=True, eq=False)
class Curve:
    """After `counts` (K,) pictures of each of R runs: root mean square error in the corners of the frame, `off` (R, K)
    px, and the `stated` (R, K) one; NaN without a camera."""

    counts: Array
    off: Array
    stated: Array

    @property
    def typical(self) -> Array:
        """(K,) median error over the runs, px; infinite where half of them have no camera."""
        return np.asarray(np.median(np.where(np.isfinite(self.off), self.off, np.inf), axis=0))

    def needed(self, target: float) -> float:
        """Number of pictures from which on the typical error stays below `target` px, interpolated; infinite if it does
        not."""
        off = self.typical
        above = np.flatnonzero(~(off <= target))
        if not len(above):
            return float(self.counts[0])
        k = above[-1]
        if k + 1 == len(self.counts) or not np.isfinite(off[k]):
            return float("inf") if k + 1 == len(self.counts) else float(self.counts[k + 1])
        share = np.log(off[k] / target) / np.log(off[k] / off[k + 1])
        return float(self.counts[k] + share * (self.counts[k + 1] - self.counts[k]))

    @property
    def stated_by_true(self) -> float:
        """1 ÷ the root mean square of error ÷ stated deviation, over all runs, from COMPARED_FROM pictures on: 1 if
        deviations are what they say, less if errors are larger."""
        ratio = (self.off / self.stated)[:, self.counts >= COMPARED_FROM]
        return float(1 / np.sqrt(np.nanmean(ratio**2)))


@dataclass(frozen=True)
class Run:
    """One simulated person: of PEOPLE, with a camera of LENSES and a board of BOARDS, taking `most` pictures."""

    person: str
    lens: str
    boards: str
    seed: int
    most: int

    @property
    def counts(self) -> list[int]:
        """Numbers of pictures after which the camera is evaluated."""
        return [n for n in COUNTS if n <= self.most]


def errors_of(run: Run) -> Array:
    """(2, K) error in the corners of the frame and its stated deviation, px, after `run.counts` pictures; NaN without a
    camera."""
    rng = np.random.default_rng([run.seed, 4])
    scene = Scene(LENSES[run.lens], uneven_board(rng, STRETCH, PRINT_ERROR, BEND) if run.boards == "bent" else None)
    cameras = PEOPLE[run.person](scene, run.seed, run.most)
    found = [cameras[n - 1] for n in run.counts]
    each = [
        (np.nan, np.nan) if c is None else (corner_error(c.camera, scene.camera), corner_deviation(c)) for c in found
    ]
    return np.array(each).T


def corner_error(found: Camera, truth: Camera) -> float:
    """Root mean square error of `found` along one axis, px, over the frame's corners in which both have rays, after the
    best rotation."""
    vectors, _ = difference(truth, found, frame_grid(truth.image_size))
    return _root_mean(vectors[_corner_index()] ** 2)


def corner_deviation(found: Calibration) -> float:
    """The standard deviation that the calibration states for `corner_error`."""
    cov = projection_deviation(found, frame_grid(found.camera.image_size))[_corner_index()]
    return _root_mean(np.einsum("nii->ni", cov))


def _root_mean(values: Array) -> float:
    """The root of the mean of the finite values; NaN if there are none."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(known.mean())) if len(known) else float("nan")


@dataclass(frozen=True)
class Kept:
    """The errors of runs in the file `path`, a line for each, so that a long evaluation goes on where it was ended;
    `code`: digest of the code, lines of another one don't count."""

    path: Path
    code: str

    def read(self) -> dict[Run, Array]:
        """(2, K) errors and stated deviations of each run that the file holds; a line that was cut off holds none."""
        found = {}
        for line in self.path.read_text("utf-8").splitlines() if self.path.exists() else []:
            with suppress(json.JSONDecodeError):
                record = json.loads(line)
                if record["code"] == self.code:
                    found[Run(**record["run"])] = np.array(record["errors"], float)
        return found

    def add(self, run: Run, errors: Array) -> None:
        """Append a line."""
        record = {"code": self.code, "run": asdict(run), "errors": errors.tolist()}
        with self.path.open("a", encoding="utf-8") as file:
            file.write(f"\n{json.dumps(record)}")  # apart from a line that was cut off


def code_digest() -> str:
    """SHA-256 of the source files of both distributions."""
    digest = hashlib.sha256()
    for package in (rcdn, rcdn_lab):
        for path in sorted(Path(str(package.__file__)).parent.rglob("*.py")):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def rows_of(
    runs: int,
    most: int,
    workers: int,
    progress: Callable[[int, int], None] | None = None,
    kept: Kept | None = None,
) -> list[dict[str, Any]]:
    """The figures of each lens and kind of board, from `runs` people of each kind, by `workers` processes; those that
    are `kept` are not computed again."""
    cells = list(product(LENSES, BOARDS))
    tasks = [Run(p, *cell, seed, most) for cell in cells for p in PEOPLE for seed in range(runs)]
    found = {} if kept is None else kept.read()
    missing = [task for task in tasks if task not in found]
    for task, errors in zip(missing, share_out(errors_of, missing, workers, progress=progress), strict=True):
        found[task] = errors
        if kept is not None:
            kept.add(task, errors)
    rows = []
    for cell in cells:
        curves = {}
        for person in PEOPLE:
            some = [t for t in tasks if (t.person, t.lens, t.boards) == (person, *cell)]
            off, stated = np.stack([found[t] for t in some], axis=1)
            curves[person] = Curve(np.array(some[0].counts), off, stated)
        rows.append({"lens": cell[0], "boards": cell[1], "runs": runs, **_figures(curves, most)})
    return rows


def _figures(curves: dict[str, Curve], most: int) -> dict[str, float]:
    """The figures of the people of one cell; for those who do not reach a target within `most` pictures the ratios are
    upper bounds."""
    row: dict[str, float] = {}
    for target in TARGETS:
        needed = {name: c.needed(target) for name, c in curves.items()}
        row |= {f"{name}_to_{target}": n for name, n in needed.items()}
        row |= {f"of_{name}_to_{target}": needed["guided"] / min(n, most) for name, n in needed.items()}
        del row[f"of_guided_to_{target}"]
    row |= {f"{name}_at_10": float(c.typical[list(c.counts).index(10)]) for name, c in curves.items()}
    return row | {"stated_by_true": curves["guided"].stated_by_true}


def _corner_index() -> list[int]:
    cols, rows = GRID
    return [0, cols - 1, cols * (rows - 1), cols * rows - 1]


def _followed(T: Array, rng: np.random.Generator) -> Array:
    """A pose near `T`."""
    R = rotation(np.radians(rng.normal(0, TURN, 3))) @ T[:3, :3]
    at = T[:3, :3] @ MIDDLE + T[:3, 3]
    at = at * (1 + rng.normal(0, NEARER)) + rng.normal(0, ASIDE, 3) * [1, 1, 0] * np.linalg.norm(at)
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = R, at - R @ MIDDLE
    return out


def _facing(ray: Array) -> Array:
    """(3, 3) the smallest rotation that takes the z axis to `ray`."""
    axis = np.array([-ray[1], ray[0], 0.0])
    sine = float(np.linalg.norm(axis))
    return np.asarray(rotation(axis * (np.arctan2(sine, ray[2]) / max(sine, 1e-12))))


def _cells(seen: Board) -> Array:
    """CELLS bool: the parts of the sensor that contain a corner."""
    size = np.array(seen.image_size) / CELLS
    out = np.zeros(CELLS, bool)
    at = np.clip((seen.xy / size).astype(int), 0, np.array(CELLS) - 1)
    out[at[:, 0], at[:, 1]] = True
    return out


def _calibrated(scene: Scene, boards: list[Board]) -> list[Calibration | None]:
    """Calibrations after COUNTS pictures; None in between."""
    done: list[Calibration | None] = [None] * len(boards)
    for n in COUNTS:
        if n <= len(boards):
            try:
                done[n - 1] = calibrate(boards[:n], SPACING, model=scene.camera.model, size=SIZE)
            except CalibrationError:
                done[n - 1] = None
    return done
